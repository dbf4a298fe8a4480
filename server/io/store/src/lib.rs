//! The SQLite database: phases, runs, results, accounts and the audit list.
//!
//! Start reading at [`Store`], the half with write access, and [`Reader`], the read-only half for pages. `migrations/`
//! describes the tables.
//!
//! Every function fails if the database fails or contains a damaged row, and rolls its transaction back then.
//!
//! This crate never returns data to a [`Reader`]'s caller that the phase hides from this viewer or stores a
//! secret in plain text.

mod accounts;
mod admission;
mod commitment;
mod database;
mod episodes;
mod error;
mod facts;
mod phases;
mod runs;
mod scores;
mod views;

pub use accounts::{AuditLine, AuditNote, NewToken, Team, Token, TokenHash, TokenLine, TokenState};
pub use admission::{Member, NewGrant, NewRun, StartedRun};
pub use avln_challenge::{
    Admission, Charge, CommitmentValues, EpisodeState, GoalText, MethodType, PhaseEpisode, PhaseState, Quota,
    QuotaLimits, QuotaWindow, Reference, Ruling, RunChoice, RunState, Sample, Sampling, Schedule,
    TimeAccount, TokenScope, Visibility, calendar, pool_digest,
};
pub use commitment::Commitment;
pub use database::{Inventory, KeptRun, SCHEMA_VERSION, Store, copy_database, inspect_database};
pub use episodes::{AssignedEpisode, EpisodeResult, EpisodeStatus, RecordedResult, RunningEpisode};
pub use error::{Result, StoreError};
pub use facts::{Facts, Pruned, ScoredEpisode};
pub use phases::{Phase, PublishedSplits, Ranking, Scene, SceneMap, Split};
pub use runs::{DowntimeCredit, Run};
pub use scores::{Rescore, Rescored};
pub use views::{
    Census, GrantLine, Holder, Reader, TeamLine, TeamsView, Viewer,
    episode::{EpisodeView, GoalView, MissionView, Replay, SubmitMark, TargetView},
    leaderboard::{LeaderboardQuery, LeaderboardRow, LeaderboardView, RowFilter},
    phase::{MissionsView, PhaseView},
    run::{EpisodeLine, GroupView, LogAccess, ModalityView, RunLine, RunView},
    runs::{CompareView, Incomparable, LiveRun, PairView, RunList},
};
