//! The people's door: pages, REST API, plots.
//!
//! Start reading at [`router`]: `pages` answers people, `api` answers programs, `guard` stands around both, and [`Office`] is what
//! visitors who sign in may have done.
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
mod live;
mod logs;
mod notice;
mod office;
mod onlooker;
mod pages;
mod plot;
mod press;
mod replay;
mod trouble;
mod visit;
mod words;

pub use door::{WebError, serve, serve_router};
pub use freeze::{FreezeError, freeze};
pub use live::{Lookout, SessionNow, SlotNow};
pub use logs::SignedLogs;
pub use notice::announce;
pub use office::{Because, Deed, Doing, Done, Health, Member, Office, TeamDeed, Undone};
pub use onlooker::{Blind, Glance, Heard, Hearing, Listening, Looking, Onlooker, Seen};

use avln_store::Reader;
use axum::{Extension, Router, extract::State, middleware::from_fn_with_state, routing::get};
use live::Hub;
use onlooker::Desk;
use std::sync::Arc;
use tokio::sync::watch;
use trouble::Trouble;
use visit::AgentsDoor;

/// What pages and API tell of the server beside its database.
#[derive(Clone, Debug, Default)]
pub struct Site {
    /// Port of the agents' door.
    pub agents_port: u16,
    /// The logs of runs; `None` gives none out.
    pub logs: Option<SignedLogs>,
    /// Who can look and listen in scenes; `None` shows no pictures and gives no sound.
    pub onlooker: Option<Arc<dyn Onlooker>>,
    /// Who knows what is played at this moment; `None` tells what is stored alone.
    pub lookout: Option<Arc<dyn Lookout>>,
    /// Who does what visitors may ask for; `None` lets nobody sign in.
    pub office: Option<Arc<dyn Office>>,
}

/// Everything that this door answers, over what `reader` shows: pages for people, `/api/v1` for programs, `/healthz`
/// (alive) and `/readyz` (the database answers). Limits, headers and caching are part of it.
pub fn router(reader: Reader, site: Site) -> Router {
    router_beside(reader, site, false, None)
}

/// The same beside an agents' door that may speak TLS, until `closed` ends.
fn router_beside(reader: Reader, site: Site, is_secure: bool, closed: Option<watch::Receiver<()>>) -> Router {
    let agents = AgentsDoor { port: site.agents_port, is_secure };
    let open = Router::new()
        .route("/healthz", get(async || "alive\n"))
        .route("/readyz", get(ready))
        .merge(pages::router())
        .merge(api::router())
        .fallback(async || Trouble::NoPage)
        .layer(Extension(agents))
        .layer(Extension(site.logs))
        .layer(Extension(Arc::new(Hub::new(site.lookout, closed))))
        .layer(Extension(site.onlooker.map(|onlooker| Arc::new(Desk::new(onlooker)))));
    guard::guarded(match site.office {
        None => open.with_state(reader),
        Some(office) => staffed(open, Arc::new(office::Desk::new(office, is_secure)), reader),
    })
}

/// The same with pages for those who sign in.
fn staffed(open: Router<Reader>, desk: Arc<office::Desk>, reader: Reader) -> Router {
    open.merge(pages::office_router())
        .layer(Extension(desk.clone()))
        .layer(from_fn_with_state((desk, reader.clone()), office::recognised))
        .with_state(reader)
}

async fn ready(State(reader): State<Reader>) -> Result<&'static str, Trouble> {
    reader.ping().await.map_err(|_| Trouble::Busy)?;
    Ok("ready\n")
}
