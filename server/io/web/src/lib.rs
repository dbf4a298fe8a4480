//! The people's door: pages, REST API, plots.
//!
//! Start reading at [`router`]: every page and every answer is one line of it.
//!
//! *Never*: knows what a mission hides. It sees what [`avln_store::Reader`] shows this viewer, and cannot name the truth:
//!
//! ```compile_fail,E0433
//! let truth: avln_truth::EpisodeTruth;
//! ```

mod door;

pub use door::{WebError, serve};

use avln_store::Reader;
use axum::{Router, routing::get};

/// Everything that this door answers, over what `reader` shows.
pub fn router(reader: Reader) -> Router {
    Router::new().route("/healthz", get(async || "alive\n")).with_state(reader)
}
