//! Database views for pages. Every view is built for a [`Viewer`] and omits all data hidden from that viewer.

use crate::{
    database::{Store, Transaction, ViewCache},
    error::Result,
    phases::Phase,
};
use avln_challenge::Visibility;
use sqlx::SqlitePool;

pub(crate) mod episode;
pub(crate) mod leaderboard;
pub(crate) mod management;
pub(crate) mod phase;
pub(crate) mod run;
pub(crate) mod runs;

/// The person or team that reads a page.
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
    pub(crate) fn may_see(&self, visibility: Visibility, team: &str) -> bool {
        match visibility {
            Visibility::Public => true,
            Visibility::Team => self.owns(team),
            Visibility::Organiser => *self == Self::Organiser,
        }
    }

    pub(crate) fn owns(&self, team: &str) -> bool {
        match self {
            Self::Anonymous => false,
            Self::Team(own) => own == team,
            Self::Organiser => true,
        }
    }

    pub(crate) fn knows(&self, phase: &Phase) -> bool {
        match self {
            Self::Anonymous => phase.admission.shows_to(None),
            Self::Team(team) => phase.admission.shows_to(Some(team)),
            Self::Organiser => true,
        }
    }

    pub(crate) fn sees_all(&self, visibility: Visibility) -> bool {
        visibility == Visibility::Public || *self == Self::Organiser
    }
}

/// Run and episode counts by state. Contains no names.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Census {
    /// Runs by state word.
    pub runs: Vec<(String, i64)>,
    /// Episodes by state word and end reason word.
    pub episodes: Vec<(String, Option<String>, i64)>,
}

/// A read-only store for the web server. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Reader {
    pub(crate) pool: SqlitePool,
    pub(crate) cache: ViewCache,
}

impl Store {
    /// Returns a read-only store for the web server.
    pub fn reader(&self) -> Reader {
        Reader { pool: self.read.clone(), cache: self.views.clone() }
    }
}

impl Reader {
    /// Fails if the database is not readable.
    pub async fn ping(&self) -> Result<()> {
        let _: i64 = sqlx::query_scalar("SELECT COUNT(*) FROM phases").fetch_one(&self.pool).await?;
        Ok(())
    }

    /// Counts runs and episodes by state.
    pub async fn census(&self) -> Result<Census> {
        let mut tx = self.snapshot().await?;
        let runs = sqlx::query_as("SELECT state, COUNT(*) FROM runs GROUP BY state ORDER BY state");
        let episodes = sqlx::query_as(
            "SELECT state, end_reason, COUNT(*) FROM episodes GROUP BY state, end_reason ORDER BY state, end_reason",
        );
        Ok(Census { runs: runs.fetch_all(&mut *tx).await?, episodes: episodes.fetch_all(&mut *tx).await? })
    }

    /// Begins a read transaction: a consistent state without later writes.
    pub(crate) async fn snapshot(&self) -> Result<Transaction<'static>> {
        // Views need several statements; without a transaction a result stored in between would give a contradictory page.
        Ok(self.pool.begin().await?)
    }
}
