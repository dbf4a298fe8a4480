//! The agents' door: gRPC services that let agents play episodes, and nothing else.
//!
//! Start reading at [`Host`], which the server implements, and [`serve`]. `PROTOCOL.md` of `avln-proto` tells
//! what travels; this crate keeps the order of frames, the clocks and the limits.
//!
//! A session is one run that is being played. Each of its slots is a task of its own that owns its episode:
//!
//! ```text
//!         Ready               EpisodeStart                Act
//!  Idle ---------> starting --------------> Playing -----------> stepping
//!   ^  (host.next_episode, start)            ^  |                  |  |
//!   |                                        |  |   Observation    |  |
//!   |                                        +--|------------------+  |
//!   |   Ready                                   | Abandon, time up,   | terminated, truncated,
//!   +--------- Over <---------------------------+ leaving, run over   | simulator fault or hang
//!               ^                                                     |
//!               +-----------------------------------------------------+
//!        every way into Over: truncate where needed, host.conclude, EpisodeEnd
//! ```
//!
//! *Never*: sees hidden truth, builds a message from anything but `avln-episode` types and what its host calls
//! public, blocks an async thread with simulation, or lets one agent's fault reach another.
//!
//! What agents must not see cannot even be named here:
//!
//! ```
//! use avln_episode as shown; // what agents may know can
//! ```
//! ```compile_fail,E0432
//! use avln_truth as hidden;
//! ```
//! ```compile_fail,E0432
//! use avln_world as hidden;
//! ```
//! ```compile_fail,E0432
//! use avln_store as hidden;
//! ```

mod auth;
mod away;
mod control;
mod crew;
mod door;
mod gate;
mod host;
mod left;
mod limits;
mod meter;
mod outbound;
mod overdue;
mod places;
mod play;
mod pulse;
mod refusal;
mod seat;
mod serve;
mod service;
mod session;
mod unary;
mod watchdog;
mod wire;

pub use avln_proto::{API_MINOR, v1::Reason};
pub use control::{Control, Drain, Histogram, SessionState, SlotState, Snapshot};
pub use host::{
    Account, ClientRange, Digests, EpisodeOutcome, Host, Interrupted, OpenRun, PhaseInfo, PhaseState, Quota,
    QuotaWindow, Revealed, RunRequest, RunState, RunStatus, RunTicket, Scope, ServerInfo, StoredEnd,
    Visibility,
};
pub use limits::Limits;
pub use refusal::Refusal;
pub use seat::{Acted, EpisodeLog, EpisodeRunner, Restored, Seat, TimeSpent};
pub use serve::{ServeError, serve};
/// Goes above every implementation of [`Host`].
pub use tonic::async_trait;
pub use watchdog::{Lost, Watchdog};
