//! What pages show. Every view is built for a [`Viewer`] and holds nothing that the phase hides from that viewer.

mod board;
mod census;
mod compare;
mod episode;
mod group;
mod kept;
mod live;
mod missions;
mod office;
mod phase;
mod run;

use board::RankedBoards;
pub use board::{Board, LeaderboardRow, LeaderboardView};
pub use census::Census;
pub use compare::{CompareView, Incomparable, PairView};
pub use episode::{EpisodeView, GoalView, MissionView, Replay, SubmitMark, TargetView};
pub use group::GroupView;
use kept::KeptRuns;
pub use live::LiveRun;
pub use missions::MissionsView;
pub use office::{GrantLine, Holder, TeamLine, TeamsView};
pub use phase::PhaseView;
pub use run::{EpisodeLine, LogAccess, ModalityView, RunLine, RunList, RunView};

use crate::{Phase, StoreError, TokenHash, Visibility};
use sqlx::{Sqlite, SqlitePool, Transaction};

/// Who looks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Viewer {
    /// Anybody.
    Anonymous,
    /// A team that showed its token.
    Team(String),
    /// The organiser.
    Organiser,
}

impl Viewer {
    /// Whether this viewer may see a thing of `team` that has this visibility.
    pub(crate) fn may_see(&self, visibility: Visibility, team: &str) -> bool {
        match visibility {
            Visibility::Public => true,
            Visibility::Team => self.owns(team),
            Visibility::Organiser => *self == Self::Organiser,
        }
    }

    /// Whether the thing of `team` is this viewer's own; everything is the organiser's.
    pub(crate) fn owns(&self, team: &str) -> bool {
        match self {
            Self::Anonymous => false,
            Self::Team(own) => own == team,
            Self::Organiser => true,
        }
    }

    /// Whether this viewer may know that the phase exists.
    pub(crate) fn knows(&self, phase: &Phase) -> bool {
        match self {
            Self::Anonymous => phase.admission.shows_to(None),
            Self::Team(team) => phase.admission.shows_to(Some(team)),
            Self::Organiser => true,
        }
    }

    /// Whether this viewer sees the things of all teams.
    pub(crate) fn sees_all(&self, visibility: Visibility) -> bool {
        visibility == Visibility::Public || *self == Self::Organiser
    }
}

/// The reading half of the store: the only half that pages are given.
#[derive(Clone, Debug)]
pub struct Reader {
    pool: SqlitePool,
    boards: RankedBoards,
    runs: KeptRuns,
}

impl Reader {
    pub(crate) fn new(pool: SqlitePool) -> Self {
        Self { pool, boards: RankedBoards::default(), runs: KeptRuns::default() }
    }

    /// Who holds the token `secret` at `now_unix_ms`; `None` when it is not a valid account's or organiser's token.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn viewer(&self, secret: &str, now_unix_ms: i64) -> Result<Option<Viewer>, StoreError> {
        let holder = self.holder(&TokenHash::of(secret), now_unix_ms).await?;
        Ok(holder.map(|holder| holder.viewer))
    }

    /// Answers when the database can be read.
    ///
    /// # Errors
    /// When it cannot.
    pub async fn ping(&self) -> Result<(), StoreError> {
        let _: i64 = sqlx::query_scalar("SELECT COUNT(*) FROM phases").fetch_one(&self.pool).await?;
        Ok(())
    }

    /// One view of the database as it is now, unmoved by writes that follow.
    async fn snapshot(&self) -> Result<Transaction<'static, Sqlite>, StoreError> {
        Ok(self.pool.begin().await?)
    }
}
