//! Database views for pages. Every view is built for a [`Viewer`] and omits all data hidden from that viewer.
//!
//! This file has the views of account pages: a team sees own data, the organiser all teams and the audit list.

use crate::{
    accounts::{AuditLine, TokenHash, TokenLine, TokenState, find_token, read_tokens},
    database::{Store, Transaction, ViewCache},
    error::Result,
    phases::{Phase, read_heads},
};
use avln_challenge::{TokenScope, Visibility};
use sqlx::{FromRow, SqlitePool};

pub(crate) mod episode;
pub(crate) mod leaderboard;
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

/// A valid token's owner.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Holder {
    /// The viewer.
    pub viewer: Viewer,
    /// True if the token is read-only.
    pub read_only: bool,
    /// Token id in lists.
    pub token: String,
    /// Expiry time, milliseconds since 1970-01-01 UTC; `None` if it never expires.
    pub expires_unix_ms: Option<i64>,
}

/// A team in the organiser's list.
#[derive(Clone, Debug, PartialEq, Eq, FromRow)]
pub struct TeamLine {
    /// Public name.
    pub name: String,
    /// Reference kind; `None` for a competing team.
    pub reference: Option<String>,
    /// Admission time, milliseconds since 1970-01-01 UTC.
    pub created_ms: i64,
    /// Run count.
    pub runs: i64,
    /// Valid tokens.
    pub tokens: i64,
    /// Phases that approved the team, separated by commas; `None` for no phase.
    pub approved: Option<String>,
}

/// Runs granted to a team beyond the quota.
#[derive(Clone, Debug, PartialEq, Eq, FromRow)]
pub struct GrantLine {
    /// Phase id.
    pub phase: String,
    /// Team name.
    pub team: String,
    /// Run count.
    pub runs: i64,
    /// Reason.
    pub reason: String,
    /// Grant time, milliseconds since 1970-01-01 UTC.
    pub granted_ms: i64,
}

/// All teams and their grants.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TeamsView {
    /// Teams by name.
    pub teams: Vec<TeamLine>,
    /// The newest grants, newest first.
    pub grants: Vec<GrantLine>,
    /// Phases that require an approval.
    pub phases_by_approval: Vec<String>,
}

const MAX_GRANTS: u32 = 50;

impl Reader {
    /// Returns the viewer with the token `secret` at `now_unix_ms`; `None` without a valid team or organiser token.
    pub async fn viewer(&self, secret: &str, now_unix_ms: i64) -> Result<Option<Viewer>> {
        let holder = self.holder(&TokenHash::of(secret), now_unix_ms).await?;
        Ok(holder.map(|holder| holder.viewer))
    }

    /// Returns a token's owner at `now_unix_ms`; `None` without a valid team or organiser token.
    pub async fn holder(&self, token: &TokenHash, now_unix_ms: i64) -> Result<Option<Holder>> {
        let TokenState::Valid(found) = find_token(&self.pool, token, now_unix_ms).await? else {
            return Ok(None);
        };
        let viewer = match (found.kind, found.team) {
            (TokenScope::Organiser, _) => Viewer::Organiser,
            (TokenScope::Participant | TokenScope::ReadOnly, Some(team)) => Viewer::Team(team),
            _ => return Ok(None),
        };
        Ok(Some(Holder {
            viewer,
            read_only: found.kind == TokenScope::ReadOnly,
            token: token.id().to_owned(),
            expires_unix_ms: found.expires_unix_ms,
        }))
    }

    /// Returns the tokens of the viewer's team, newest first; empty for other viewers.
    pub async fn own_tokens(&self, viewer: &Viewer) -> Result<Vec<TokenLine>> {
        match viewer {
            Viewer::Team(team) => read_tokens(&self.pool, Some(team)).await,
            _ => Ok(vec![]),
        }
    }

    /// Returns all teams at `now_unix_ms`; empty for viewers other than the organiser.
    pub async fn teams(&self, viewer: &Viewer, now_unix_ms: i64) -> Result<TeamsView> {
        if *viewer != Viewer::Organiser {
            return Ok(TeamsView::default());
        }
        let mut tx = self.snapshot().await?;
        let phases = read_heads(&mut tx, None).await?.into_iter().map(|head| head.phase);
        let by_approval = phases.filter(|phase| phase.admission.approval).map(|phase| phase.id);
        let select = "SELECT phase, team, runs, reason, granted_ms FROM grants ORDER BY id DESC LIMIT $1";
        Ok(TeamsView {
            phases_by_approval: by_approval.collect(),
            teams: read_teams(&mut tx, now_unix_ms).await?,
            grants: sqlx::query_as(select).bind(MAX_GRANTS).fetch_all(&mut *tx).await?,
        })
    }

    /// Returns the newest `limit` audit lines before the line `before`; empty for viewers other than the organiser.
    pub async fn audit(&self, viewer: &Viewer, before: Option<i64>, limit: u32) -> Result<Vec<AuditLine>> {
        if *viewer != Viewer::Organiser {
            return Ok(vec![]);
        }
        let select = "SELECT id, at_ms, actor, subject, what, before, after, reason FROM audit \
                      WHERE $1 IS NULL OR id < $1 ORDER BY id DESC LIMIT $2";
        Ok(sqlx::query_as(select).bind(before).bind(limit).fetch_all(&self.pool).await?)
    }
}

async fn read_teams(tx: &mut Transaction<'_>, now_unix_ms: i64) -> Result<Vec<TeamLine>> {
    let select = "SELECT t.name, t.reference, t.created_ms, \
                  (SELECT COUNT(*) FROM runs r WHERE r.team = t.name) AS runs, \
                  (SELECT COUNT(*) FROM tokens k WHERE k.team = t.name AND k.kind <> 'run' AND k.revoked_ms IS NULL \
                  AND (k.expires_ms IS NULL OR k.expires_ms > $1)) AS tokens, \
                  (SELECT group_concat(a.phase, ', ') FROM approvals a WHERE a.team = t.name) AS approved \
                  FROM teams t ORDER BY t.name";
    Ok(sqlx::query_as(select).bind(now_unix_ms).fetch_all(&mut **tx).await?)
}
