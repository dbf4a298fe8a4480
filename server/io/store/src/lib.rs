//! SQLite rows to domain types and back; blobs; visibility applied on read.
//!
//! Start reading at [`Store`], which the server writes through, and [`Reader`], the only half that pages are given.
//!
//! *Never*: hands a hidden thing to a [`Reader`]'s caller whom the phase does not let see it; stores a secret in clear.

mod accounts;
mod catalogue;
mod database;
mod error;
mod facts;
mod packed;
mod play;
mod runs;
mod totals;
mod views;
mod words;

pub use accounts::{NewToken, Team, Token, TokenKind, TokenState};
pub use catalogue::{GoalText, Phase, PhaseEpisode, PhaseState, Scene, SceneMap, Split, Visibility};
pub use database::{SCHEMA_VERSION, Store};
pub use error::StoreError;
pub use facts::Facts;
pub use play::{Assigned, EpisodeState, Finished, Recorded, TimeAccount};
pub use runs::{NewRun, Run, RunState, StartedRun};
pub use views::{
    Board, EpisodeLine, EpisodeView, GoalView, LeaderboardRow, LeaderboardView, MissionView, ModalityView,
    PhaseView, Pick, Reader, Replay, RunLine, RunView, SubmitMark, TargetView, Viewer,
};
