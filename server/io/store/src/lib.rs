//! SQLite rows to domain types and back; blobs; visibility applied on read.
//!
//! Start reading at [`Store`], which the server writes through, and [`Reader`], the only half that pages are given.
//!
//! *Never*: hands a hidden thing to a [`Reader`]'s caller whom the phase does not let see it; stores a secret in clear.

mod accounts;
mod admission;
mod audit;
mod backup;
mod catalogue;
mod database;
mod error;
mod facts;
mod packed;
mod phases;
mod play;
mod prune;
mod quota;
mod rescore;
mod reveal;
mod rulings;
mod runs;
mod totals;
mod uptime;
mod views;
mod words;

pub use accounts::{NewToken, Team, Token, TokenHash, TokenLine, TokenState};
pub use admission::{Member, NewGrant};
pub use audit::{AuditLine, AuditNote};
pub use avln_challenge::calendar;
pub use avln_challenge::{
    Admission, Charge, CommitmentValues, EpisodeState, GoalText, PhaseEpisode, PhaseState, Quota,
    QuotaLimits, QuotaWindow, Reference, Ruling, RunChoice, RunState, Sample, Sampling, Schedule,
    TimeAccount, TokenScope, Visibility, pool_digest,
};
pub use backup::{Inventory, KeptRun, copy_database, inspect_database};
pub use catalogue::{Scene, SceneMap, Split};
pub use database::{SCHEMA_VERSION, Store};
pub use error::StoreError;
pub use facts::Facts;
pub use phases::{Phase, Ranking};
pub use play::{Assigned, Finished, HandedOut, Recorded, Underway};
pub use prune::Pruned;
pub use rescore::{Rescore, Rescored, ScoredEpisode};
pub use reveal::Promise;
pub use runs::{NewRun, Run, StartedRun};
pub use uptime::MadeUp;
pub use views::{
    Board, Census, CompareView, EpisodeLine, EpisodeView, GoalView, GrantLine, GroupView, Holder,
    Incomparable, LeaderboardRow, LeaderboardView, LiveRun, LogAccess, MissionView, MissionsView,
    ModalityView, PairView, PhaseView, Reader, Replay, RunLine, RunList, RunView, SubmitMark, TargetView,
    TeamLine, TeamsView, Viewer,
};
