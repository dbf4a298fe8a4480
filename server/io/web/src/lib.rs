//! The people's door: pages, REST API, plots.
//!
//! Start reading at [`router`]: `pages` answers people, `api` answers programs, `guard` stands around both.
//!
//! *Never*: knows what a mission hides. It sees what [`avln_store::Reader`] shows this viewer, and cannot name the truth:
//!
//! ```compile_fail,E0433
//! let truth: avln_truth::EpisodeTruth;
//! ```

mod api;
mod board;
mod door;
mod freeze;
mod guard;
mod logs;
mod notice;
mod onlooker;
mod pages;
mod plot;
mod replay;
mod trouble;
mod visit;
mod words;

pub use door::{WebError, serve, serve_router};
pub use freeze::{FreezeError, freeze};
pub use logs::SignedLogs;
pub use notice::announce;
pub use onlooker::{Blind, Glance, Looking, Onlooker, Seen};

use avln_store::Reader;
use axum::{Extension, Router, extract::State, routing::get};
use onlooker::Desk;
use std::sync::Arc;
use trouble::Trouble;
use visit::AgentsDoor;

/// What pages and API tell of the server beside its database.
#[derive(Clone, Debug, Default)]
pub struct Site {
    /// Port of the agents' door.
    pub agents_port: u16,
    /// The logs of runs; `None` gives none out.
    pub logs: Option<SignedLogs>,
    /// Who can look into scenes; `None` shows no pictures.
    pub onlooker: Option<Arc<dyn Onlooker>>,
}

/// Everything that this door answers, over what `reader` shows: pages for people, `/api/v1` for programs, `/healthz`
/// (alive) and `/readyz` (the database answers). Limits, headers and caching are part of it.
pub fn router(reader: Reader, site: Site) -> Router {
    router_beside(reader, site, false)
}

/// The same beside an agents' door that may speak TLS.
fn router_beside(reader: Reader, site: Site, is_secure: bool) -> Router {
    let agents = AgentsDoor { port: site.agents_port, is_secure };
    let open = Router::new()
        .route("/healthz", get(async || "alive\n"))
        .route("/readyz", get(ready))
        .merge(pages::router())
        .merge(api::router())
        .fallback(async || Trouble::NoPage)
        .layer(Extension(agents))
        .layer(Extension(site.logs))
        .layer(Extension(site.onlooker.map(|onlooker| Arc::new(Desk::new(onlooker)))))
        .with_state(reader);
    guard::guarded(open)
}

async fn ready(State(reader): State<Reader>) -> Result<&'static str, Trouble> {
    reader.ping().await.map_err(|_| Trouble::Busy)?;
    Ok("ready\n")
}
