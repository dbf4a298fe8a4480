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
mod door;
mod guard;
mod map;
mod notice;
mod pages;
mod trouble;
mod visit;
mod words;

pub use door::{WebError, serve, serve_router};
pub use notice::announce;

use avln_store::Reader;
use axum::{Extension, Router, extract::State, routing::get};
use trouble::Trouble;
use visit::AgentsDoor;

/// Everything that this door answers, over what `reader` shows: pages for people, `/api/v1` for programs, `/healthz`
/// (alive) and `/readyz` (the database answers). Limits, headers and caching are part of it.
pub fn router(reader: Reader, agents_port: u16) -> Router {
    router_beside(reader, AgentsDoor { port: agents_port, is_secure: false })
}

fn router_beside(reader: Reader, agents: AgentsDoor) -> Router {
    let open = Router::new()
        .route("/healthz", get(async || "alive\n"))
        .route("/readyz", get(ready))
        .merge(pages::router())
        .merge(api::router())
        .fallback(async || Trouble::NoPage)
        .layer(Extension(agents))
        .with_state(reader);
    guard::guarded(open)
}

async fn ready(State(reader): State<Reader>) -> Result<&'static str, Trouble> {
    reader.ping().await.map_err(|_| Trouble::Busy)?;
    Ok("ready\n")
}
