//! The loop that lets visitors in.

use crate::router;
use avln_store::Reader;
use std::future::Future;
use tokio::net::TcpListener;

/// The door could not be kept open.
#[derive(Debug, thiserror::Error)]
#[error("the web server stopped: {0}")]
pub struct WebError(#[from] std::io::Error);

/// Answers visitors until `shutdown` ends; answers that were begun are finished.
///
/// # Errors
/// When the listener fails.
pub async fn serve(
    listener: TcpListener,
    reader: Reader,
    shutdown: impl Future<Output = ()> + Send + 'static,
) -> Result<(), WebError> {
    Ok(axum::serve(listener, router(reader)).with_graceful_shutdown(shutdown).await?)
}
