//! Logs of runs that are over, for those who may see their replays: a log tells episodes, actions and scores.

use crate::{
    guard::Streamed,
    trouble::Trouble,
    visit::{Asked, Nothing, Visit},
};
use avln_store::LogAccess;
use axum::{
    Extension,
    body::Body,
    extract::Path,
    http::header,
    response::{IntoResponse, Response},
};
use std::{io, path::PathBuf};
use tokio::fs::File;
use tokio_util::io::ReaderStream;

/// Where the logs of runs lie, and by which key they are signed.
#[derive(Clone, Debug)]
pub struct SignedLogs {
    /// The folder with a file for each run.
    pub folder: PathBuf,
    /// The server's public key, hexadecimal.
    pub key: String,
}

/// The log of a run.
pub(crate) async fn log(
    visit: Visit,
    Path(run): Path<String>,
    Extension(logs): Extension<Option<SignedLogs>>,
    _: Asked<Nothing>,
) -> Result<Response, Trouble> {
    let none = || Trouble::Unknown { what: "log of run", name: run.clone() };
    match visit.reader.log_access(&visit.viewer, &run).await? {
        LogAccess::None => return Err(none()),
        LogAccess::Later => {
            let message = format!("run '{run}' is not over; its log is signed and given out when it is");
            return Err(Trouble::Invalid(message));
        }
        LogAccess::Now => {}
    }
    let SignedLogs { folder, .. } = logs.ok_or_else(none)?;
    // The store knows the run, so that its id is no path to anywhere else.
    let path = folder.join(format!("{run}.log"));
    let file = File::open(&path).await.map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => none(),
        _ => {
            tracing::error!(%error, run, "a run log cannot be read");
            Trouble::Internal
        }
    })?;
    let headers = [
        (header::CONTENT_TYPE, "text/plain; charset=utf-8".to_owned()),
        (header::CACHE_CONTROL, "private, no-store".to_owned()),
        (header::CONTENT_DISPOSITION, format!("attachment; filename=\"{run}.log\"")),
    ];
    Ok((headers, Extension(Streamed), Body::from_stream(ReaderStream::new(file))).into_response())
}
