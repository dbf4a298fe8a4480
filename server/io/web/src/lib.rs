//! Web server: pages, REST API, live events, replays and management.
//!
//! [`router`] is the entry point. `pages` renders HTML, `api` serves JSON and CSV, `middleware` wraps both, and the traits
//! [`Management`], [`ReplayRenderer`] and [`LiveStatus`] connect a running arena.
//!
//! This crate never depends on the ground truth. The store's [`avln_store::Reader`] applies visibility, and
//! this crate cannot name hidden types:
//!
//! ```compile_fail,E0433
//! let truth: avln_truth::EpisodeTruth;
//! ```

mod api;
mod documents;
mod error;
mod format;
mod freeze;
mod leaderboard;
mod live;
mod management;
mod middleware;
mod pages;
mod plot;
mod replay;
mod replay_renderer;
mod request;
mod server;

pub use api::SignedLogs;
pub use async_trait::async_trait;
pub use documents::Documents;
pub use error::ActionError;
pub use freeze::{FreezeError, freeze};
pub use live::{LiveSession, LiveSlot, LiveStatus};
pub use management::{
    ActionOrigin, ActionOutcome, Management, OrganiserAction, ServerHealth, TeamAction, TeamCredential,
};
pub use replay_renderer::{
    RenderError, RenderedSound, RenderedView, ReplayRenderer, SoundRequest, ViewRequest,
};
pub use server::{ProxyRangeError, TrustedProxy, WebError, serve, serve_router};

use avln_store::Reader;
use axum::{Extension, Router, extract::State, middleware::from_fn_with_state, routing::get};
use error::{RequestError, Result};
use live::LiveFeed;
use management::ManagementState;
use middleware::ResponseSettings;
use replay_renderer::RenderQueue;
use request::GrpcEndpoint;
use std::sync::Arc;
use tokio::sync::watch;

/// Settings and services for the web server, besides the database.
#[derive(Clone, Debug, Default)]
pub struct Site {
    /// gRPC server port.
    pub grpc_port: u16,
    /// Canonical address of this web server, such as `https://arena.example`; `None` for the address in a request.
    pub web_url: Option<String>,
    /// Canonical address of the gRPC server; `None` for the canonical web host with the gRPC port.
    pub grpc_url: Option<String>,
    /// Time of a static copy, milliseconds since 1970-01-01 UTC; `None` for a server.
    pub frozen_unix_ms: Option<i64>,
    /// Run logs for download; `None` disables the download.
    pub logs: Option<SignedLogs>,
    /// Renderer for replays; `None` disables pictures and sound.
    pub replay_renderer: Option<Arc<dyn ReplayRenderer>>,
    /// Live arena state; `None` limits pages to the database.
    pub live_status: Option<Arc<dyn LiveStatus>>,
    /// Management actions; `None` disables sign-in.
    pub management: Option<Arc<dyn Management>>,
    /// Documents below `/docs`.
    pub documents: Documents,
    /// Reverse proxies with a reliable `X-Forwarded-For` header.
    pub trusted_proxies: Vec<TrustedProxy>,
}

/// Returns the web application over `reader`: pages, `/api/v1`, `/healthz` (process runs) and `/readyz` (database answers).
pub fn router(reader: Reader, site: Site) -> Router {
    router_until(reader, site, false, None)
}

/// As [`router`]. `is_secure`: the servers use TLS. Event streams end when the sender of `closed` is dropped.
fn router_until(reader: Reader, site: Site, is_secure: bool, closed: Option<watch::Receiver<()>>) -> Router {
    let live_status = site.live_status;
    let web_url = site.web_url.as_deref();
    let endpoint = GrpcEndpoint::new(site.grpc_port, is_secure, site.grpc_url.as_deref(), web_url);
    let responses = ResponseSettings {
        live_status: live_status.clone(),
        frozen_unix_ms: site.frozen_unix_ms,
        requires_tls: is_secure || web_url.is_some_and(|url| url.starts_with("https://")),
        varies_by_host: !endpoint.is_canonical(),
    };
    let origin = web_url.and_then(request::origin);
    let open = Router::new()
        .route("/healthz", get(async || "alive\n"))
        .route("/readyz", get(ready))
        .merge(pages::router())
        .merge(api::router())
        .fallback(async || RequestError::NoPage)
        .layer(Extension(endpoint))
        .layer(Extension(site.logs))
        .layer(Extension(site.documents))
        .layer(Extension(Arc::new(LiveFeed::new(live_status, closed))))
        .layer(Extension(site.replay_renderer.map(|renderer| Arc::new(RenderQueue::new(renderer)))));
    let router = match site.management {
        None => open.with_state(reader),
        Some(actions) => {
            let management = Arc::new(ManagementState::new(actions, is_secure, origin));
            open.merge(pages::management_router())
                .layer(Extension(management.clone()))
                .layer(from_fn_with_state((management, reader.clone()), management::identify))
                .with_state(reader)
        }
    };
    middleware::with_middleware(router, responses)
}

async fn ready(State(reader): State<Reader>) -> Result<&'static str> {
    reader.ping().await.map_err(|_| RequestError::Busy)?;
    Ok("ready\n")
}
