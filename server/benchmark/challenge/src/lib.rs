//! Domain types for challenges: phases, runs, quotas, visibility, accounts, episode draws.
//!
//! The store, the gRPC server, the web server and the arena share these types. Enums convert to and from the words used in
//! database columns, JSON and URLs: `as_str`, `FromStr`.
//!
//! Start reading at [`Schedule`], [`RunState`] and [`Quota`].
//!
//! This crate never does I/O, reads a clock, or depends on hidden data.

pub mod calendar;
pub mod names;
mod phase;
mod quota;
mod run;
mod sampling;
mod word;

pub use phase::{
    Account, Admission, PhaseInfo, PhaseState, Reference, RunChoice, Schedule, TokenScope, Visibility,
};
pub use quota::{Quota, QuotaLimits, QuotaWindow, RunGrant, quotas};
pub use run::{
    Charge, EpisodeOutcome, EpisodeState, MethodInfo, MethodType, Ruling, RunState, RunStatus, RunUse,
    TimeAccount,
};
pub use sampling::{
    CommitmentValues, GoalText, PhaseEpisode, PhaseSecret, Sample, Sampling, draw, pool_digest,
};
pub use word::UnknownWord;
