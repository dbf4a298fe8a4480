//! gRPC server for agents.
//!
//! Start at [`Host`], which the application implements, and [`serve`]. `PROTOCOL.md` of `avln-proto` defines the messages; this
//! crate implements the order of frames, the clocks and the limits.
//!
//! # Slots
//!
//! A session is a run in progress. Every slot is a task that owns an episode:
//!
//! ```text
//!         Ready               EpisodeStart                Act
//!  Idle ---------> starting --------------> Playing -----------> stepping
//!   ^  (host.next_episode, start)            ^  |                  |  |
//!   |                                        |  |   Observation    |  |
//!   |                                        +--|------------------+  |
//!   |   Ready                                   | Abandon, timeout,   | terminated, truncated,
//!   +------- Finished <-------------------------+ end of the session  | simulator fault or hang
//!               ^                                                     |
//!               +-----------------------------------------------------+
//!        every path into Finished: truncate if needed, host.conclude, EpisodeEnd
//! ```
//!
//! # Sessions
//!
//! The `SessionRegistry` has at most one entry per run, with the state of the attachment to a client. A stop reason has the same
//! ending (`StopReason::ending`) for streams, unary calls and detached sessions:
//!
//! | event | Admitted | Streaming | Unary | Detached | Closing(r) |
//! |---|---|---|---|---|---|
//! | stream attaches | Streaming | | | | Closing(r) |
//! | unary calls attach | Unary | | | | Closing(r) |
//! | restored after a restart | Detached | | | | Closing(r) |
//! | connection lost, Goodbye with `pause` | | Detached | | | Closing(r) |
//! | Goodbye, nothing left, agent hangs | | Closing | Closing | | Closing(r) |
//! | no unary call for too long | | | Closing | | Closing(r) |
//! | not resumed in time | | | | Closing | Closing(r) |
//! | superseded, resumed, cancelled, expired, draining, unary Goodbye | Closing | Closing | Closing | Closing | Closing(r) |
//!
//! An entry is removed when the ending is complete. A connection that supersedes or resumes the session then enters as Admitted.
//!
//! | stop reason | open episodes | run |
//! |---|---|---|
//! | superseded, unary calls idle, not resumed in time | end: disconnected | stays open |
//! | connection lost, pause | wait, if the run's time limits allow it | stays open |
//! | resumed | pass to the new connection | stays open |
//! | draining | remain in the run log for the next server | stays open |
//! | cancelled | end: abandoned | is over already |
//! | Goodbye | end: abandoned | ends: completed, or cancelled if episodes are left |
//! | nothing left | end: abandoned | is completed |
//! | expired | end: time budget | is over already |
//! | agent hangs | end: time budget | ends: completed, or cancelled if episodes are left |
//!
//! # Invariants
//!
//! This crate never has access to ground truth, never builds a message from anything but `avln-episode` types
//! and public host values, never blocks an async thread with simulation, and never lets an agent's fault
//! reach others.
//!
//! Hidden types cannot even be named here:
//!
//! ```
//! use avln_episode as visible; // types that agents may see
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

mod attachment;
mod context;
mod control;
mod host;
mod limits;
mod outbound;
mod play_stream;
mod refusal;
mod registry;
mod run_service;
mod serve;
mod session;
mod shared;
mod sim_pool;
mod spans;
mod unary;
mod watchdog;
mod wire;

pub use avln_proto::{API_MINOR, v1::Reason};
pub use control::{Control, Drain, Histogram, SessionState, SlotState, Snapshot, TimeSpent};
pub use host::{
    Acted, ClientRange, Digests, Episode, EpisodeLog, Host, HostedEpisode, Interrupted, OpenRun, Restored,
    RunRequest, RunTicket, ServerInfo, StoredEnd,
};
pub use limits::Limits;
pub use refusal::Refusal;
pub use serve::{LocalServer, ServeError, serve};
/// Attribute for implementations of [`Host`].
pub use tonic::async_trait;
pub use watchdog::{Lost, Watchdog};
