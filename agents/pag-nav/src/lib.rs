//! PAG-Nav: the reference agent, a client like everyone else.
//!
//! Start reading at [`PagNav`] and [`run`]. It follows section 4 of the paper, with a small network
//! (`avln-perception`) in the place of large encoders:
//!
//! | paper | here |
//! |---|---|
//! | object memory O_t | `avln_kit::map::Objects`: boxes, colours, looks, and compatibility with each goal |
//! | audio memories A_int, A_bear | `avln_kit::map::Intensity` and `SourceBelief`, one of each per sounding target |
//! | spatial frame, occupancy | `avln_kit::map::Occupancy`, one for each storey (`Storeys`); stairs are told by `Elevation` |
//! | room memory R_t, P_room, P_obj, P_ctx | `Objects::context`: what the things around a place are typical for |
//! | s_vis | `Recognition::fit`; by default the likelihood of the category, colour, size and shape words; for pictures likeness of embeddings and views |
//! | S_search, S_ground | `search.rs`, `planner::Evidence::score` |
//! | Search, Ground, Verify | `planner::Stage` |
//! | V, Submit gate | `planner::Demand` and the comparison of goals in `planner::Goals`; `planner::Gate` |
//!
//! Three things are its own. V asks for less the longer a source has been sought and near the end of the episode
//! (`Demand::after`), since a small network cannot confirm all that a person could. Where a source was sought on one storey for long
//! in vain, it takes stairs (`stairs.rs`); what it remembers of a storey waits there. And where the rules tell no outcome,
//! an open gate waits until the target sounds again, since only its silence then tells that it was found; nobody tells
//! which goal sounds.
//!
//! It sees by the network of `avln-perception`, or by models that people bring (`avln-onnx`). [`Weights`] are its numbers; `pag-nav.toml` has them all. A [`Recorder`] writes down what it heard, believed and did.
//! [`Ablation`] takes parts of it away; [`PagNav::hinted`] is what a host may tell it to find out what a perfect sense is
//! worth, and nobody else is told.
//!
//! *Never*: links anything of the server; learns anything but what its observations say.

mod ablation;
mod agent;
mod decide;
mod error;
mod options;
mod planner;
mod search;
mod stairs;
mod trace;

pub use ablation::Ablation;
pub use agent::PagNav;
pub use error::Error;
pub use options::{Options, run, run_with};
pub use planner::{Weights, WeightsError};
pub use trace::{Recorder, TraceError};
