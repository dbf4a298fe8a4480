//! PAG-Nav: the reference agent.
//!
//! Start reading at [`PagNav`] and [`run`]. The agent follows section 4 of the paper, with a small network
//! (`avln-perception`) in place of large encoders:
//!
//! | paper | here |
//! |---|---|
//! | object memory O_t | `avln_kit::map::ObjectMemory`: boxes, colours, looks, and compatibility with each goal |
//! | audio memories A_int, A_bear | `avln_kit::map::IntensityMemory` and `SourceBelief`, one of each per sounding target |
//! | spatial frame, occupancy | `avln_kit::map::Occupancy`, one per storey (`Storeys`); `Elevation` detects stairs |
//! | room memory R_t, P_room, P_obj, P_ctx | `ObjectMemory::context`: rooms inferred from typical objects |
//! | s_vis | `Recognition::fit`; by default probability of the category, colour, size and shape words; for images similarity of embeddings and views |
//! | S_search, S_ground | `search.rs`, `candidate::Evidence::score` |
//! | Search, Ground, Verify | `candidate::Stage` |
//! | V, Submit gate | `candidate::VerificationDemand` and the comparison of goals in `goals::GoalPairing`; `candidate::SubmitGate` |
//!
//! Three additions to the paper:
//! - V relaxes with the search time of a source and near the end of the episode (`VerificationDemand::after`): a small network
//!   cannot confirm everything that a person could.
//! - After a long unsuccessful search on one storey the agent takes stairs (`stairs.rs`). The memory of each storey is kept.
//! - Without verdicts, an open gate waits until the target sounds again: only its silence after the Submit is evidence. The
//!   agent does not know the goal of a sound.
//!
//! Perception is the network of `avln-perception` or user-supplied ONNX models. [`Weights`] are the tunable numbers, documented
//! in `pag-nav.toml`. A [`Recorder`] writes traces. [`Ablation`] disables parts of the agent; [`PagNav::hinted`] measures the
//! value of perfect hearing, for privileged variants only.
//!
//! *Never*: links a server crate other than `avln-simd`; uses information beyond observations (except [`PagNav::hinted`]).

mod agent;
mod args;
mod candidate;
mod decide;
mod goals;
mod search;
mod stairs;
mod trace;
mod weights;

pub use agent::PagNav;
pub use args::{PagNavArgs, PagNavError, run, run_with};
pub use trace::{Recorder, TraceError};
pub use weights::{Ablation, Weights, WeightsError};
