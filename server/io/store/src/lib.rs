//! SQLite rows to domain types and back; blobs; visibility applied on read.
//!
//! Start reading at [`Store`], which the server writes through, and [`Reader`], the only half that pages are given.
//!
//! *Never*: hands a hidden thing to a [`Reader`]'s caller whom the phase does not let see it; stores a secret in clear.

mod accounts;
mod admission;
mod audit;
mod backup;
pub mod calendar;
mod catalogue;
mod database;
mod draw;
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

pub use accounts::{NewToken, Reference, Team, Token, TokenHash, TokenKind, TokenLine, TokenState};
pub use admission::{Member, NewGrant};
pub use audit::{AuditLine, AuditNote};
pub use backup::{Inventory, KeptRun, copy_database, inspect_database};
pub use catalogue::{Scene, SceneMap, Split};
pub use database::{SCHEMA_VERSION, Store};
pub use error::StoreError;
pub use facts::Facts;
pub use phases::{
    Admission, GoalText, Phase, PhaseEpisode, PhaseState, QuotaLimits, Ranking, Sample, Sampling, Schedule,
    Visibility,
};
pub use play::{Assigned, EpisodeState, Finished, HandedOut, Recorded, TimeAccount, Underway};
pub use prune::Pruned;
pub use quota::{Charge, Quota, QuotaWindow};
pub use rescore::{Rescore, Rescored, ScoredEpisode};
pub use reveal::{Promise, Revealed, pool_digest};
pub use rulings::Ruling;
pub use runs::{NewRun, Run, RunState, StartedRun};
pub use uptime::MadeUp;
pub use views::{
    Board, Census, CompareView, EpisodeLine, EpisodeView, GoalView, GrantLine, GroupView, Holder,
    Incomparable, LeaderboardRow, LeaderboardView, LiveRun, LogAccess, MissionView, MissionsView,
    ModalityView, PairView, PhaseView, Pick, Reader, Replay, RunLine, RunList, RunView, SubmitMark,
    TargetView, TeamLine, TeamsView, Viewer,
};
