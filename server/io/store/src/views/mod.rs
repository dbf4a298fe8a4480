//! Pages' view of the database. Every view is built for a [`Viewer`] and omits all data hidden from that viewer.

pub(crate) mod compare;
pub(crate) mod episode;
pub(crate) mod group;
pub(crate) mod leaderboard;
pub(crate) mod management;
pub(crate) mod phase;
pub(crate) mod run;
pub(crate) mod run_list;

use crate::{
    error::StoreError,
    phases::Phase,
    views::{leaderboard::RankingCache, run::RunCache},
};
use avln_challenge::Visibility;
use sqlx::{Sqlite, SqlitePool, Transaction};

/// The reader of a page.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Viewer {
    /// A visitor without token.
    Anonymous,
    /// A team, by name.
    Team(String),
    /// The organiser.
    Organiser,
}

impl Viewer {
    /// Returns whether the viewer sees data of `team` with this visibility.
    pub(crate) fn may_see(&self, visibility: Visibility, team: &str) -> bool {
        match visibility {
            Visibility::Public => true,
            Visibility::Team => self.owns(team),
            Visibility::Organiser => *self == Self::Organiser,
        }
    }

    /// Returns whether the viewer is `team` or the organiser.
    pub(crate) fn owns(&self, team: &str) -> bool {
        match self {
            Self::Anonymous => false,
            Self::Team(own) => own == team,
            Self::Organiser => true,
        }
    }

    /// Returns whether the phase is visible to the viewer.
    pub(crate) fn knows(&self, phase: &Phase) -> bool {
        match self {
            Self::Anonymous => phase.admission.shows_to(None),
            Self::Team(team) => phase.admission.shows_to(Some(team)),
            Self::Organiser => true,
        }
    }

    /// Returns whether the viewer sees data of all teams.
    pub(crate) fn sees_all(&self, visibility: Visibility) -> bool {
        visibility == Visibility::Public || *self == Self::Organiser
    }
}

/// Numbers of runs and episodes by state. Contains no names.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Census {
    /// Runs by the word of their state.
    pub runs: Vec<(String, i64)>,
    /// Episodes by the words of their state and end reason.
    pub episodes: Vec<(String, Option<String>, i64)>,
}

/// The read-only half of the store, for the web server. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Reader {
    pub(crate) pool: SqlitePool,
    pub(crate) rankings: RankingCache,
    pub(crate) runs: RunCache,
}

impl Reader {
    pub(crate) fn new(pool: SqlitePool) -> Self {
        Self { pool, rankings: RankingCache::default(), runs: RunCache::default() }
    }

    /// Checks that the database is readable.
    ///
    /// # Errors
    /// If it is not.
    pub async fn ping(&self) -> Result<(), StoreError> {
        let _: i64 = sqlx::query_scalar("SELECT COUNT(*) FROM phases").fetch_one(&self.pool).await?;
        Ok(())
    }

    /// Returns the numbers of runs and episodes by state.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn census(&self) -> Result<Census, StoreError> {
        let mut tx = self.snapshot().await?;
        let runs = sqlx::query_as("SELECT state, COUNT(*) FROM runs GROUP BY state ORDER BY state");
        let episodes = sqlx::query_as(
            "SELECT state, end_reason, COUNT(*) FROM episodes GROUP BY state, end_reason ORDER BY state, end_reason",
        );
        Ok(Census { runs: runs.fetch_all(&mut *tx).await?, episodes: episodes.fetch_all(&mut *tx).await? })
    }

    /// Begins a read transaction: a consistent state of the database without later writes.
    pub(crate) async fn snapshot(&self) -> Result<Transaction<'static, Sqlite>, StoreError> {
        Ok(self.pool.begin().await?)
    }
}
