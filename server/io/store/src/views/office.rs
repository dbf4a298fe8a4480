//! What visitors who showed a token see of accounts: a team its own, the organiser all teams and the audit list.

use super::{
    Reader, RunLine, Viewer,
    run::{Sight, line},
};
use crate::{
    AuditLine, StoreError, TokenHash, TokenLine, TokenScope, TokenState,
    accounts::{find_token, read_tokens},
    phases::read_heads,
    runs::{RunFilter, read_runs},
    words::row,
};
use sqlx::{Sqlite, Transaction};

/// Who showed a token.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Holder {
    /// Whose eyes these are.
    pub viewer: Viewer,
    /// Whether the token is for looking alone.
    pub looks_only: bool,
    /// The letters by which lists name the token.
    pub token: String,
    /// From when the token is void; `None` for never.
    pub expires_unix_ms: Option<i64>,
}

row! {
    /// A team as the organiser sees it.
    #[derive(Clone, Debug, PartialEq, Eq)]
    pub struct TeamLine {
        /// Public name.
        pub name: String,
        /// The word for what its runs are a reference for; `None` where it competes.
        pub reference: Option<String>,
        /// When it was admitted, milliseconds since 1970-01-01 UTC.
        pub created_ms: i64,
        /// Its runs.
        pub runs: i64,
        /// Its tokens that hold.
        pub tokens: i64,
        /// Phases that ask for approval and gave it; `None` for none.
        pub approved: Option<String>,
    }
}

row! {
    /// Runs that the organiser gave to a team beyond its quota.
    #[derive(Clone, Debug, PartialEq, Eq)]
    pub struct GrantLine {
        /// Where they can be used.
        pub phase: String,
        /// Whose they are.
        pub team: String,
        /// How many.
        pub runs: i64,
        /// Why.
        pub reason: String,
        /// When, milliseconds since 1970-01-01 UTC.
        pub granted_ms: i64,
    }
}

/// All teams, and what the organiser gave them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TeamsView {
    /// The teams by name.
    pub teams: Vec<TeamLine>,
    /// The newest grants, the newest first.
    pub grants: Vec<GrantLine>,
    /// Phases that ask for approval.
    pub phases_by_approval: Vec<String>,
}

/// Grants in the list.
const GRANTS_TOLD: u32 = 50;

impl Reader {
    /// Who holds a token at `now_unix_ms`; `None` when it is not a valid account's or organiser's token.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn holder(&self, token: &TokenHash, now_unix_ms: i64) -> Result<Option<Holder>, StoreError> {
        let TokenState::Valid(known) = find_token(&self.pool, token, now_unix_ms).await? else {
            return Ok(None);
        };
        let viewer = match (known.kind, known.team) {
            (TokenScope::Organiser, _) => Viewer::Organiser,
            (TokenScope::Participant | TokenScope::ReadOnly, Some(team)) => Viewer::Team(team),
            _ => return Ok(None),
        };
        Ok(Some(Holder {
            viewer,
            looks_only: known.kind == TokenScope::ReadOnly,
            token: token.id().to_owned(),
            expires_unix_ms: known.expires_unix_ms,
        }))
    }

    /// The tokens of the viewer's team, the newest first; none for other viewers.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn own_tokens(&self, viewer: &Viewer) -> Result<Vec<TokenLine>, StoreError> {
        match viewer {
            Viewer::Team(team) => read_tokens(&self.pool, Some(team)).await,
            _ => Ok(vec![]),
        }
    }

    /// The runs of the viewer's team, the newest first, `limit` at most; none for other viewers.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn own_runs(&self, viewer: &Viewer, limit: u32) -> Result<Vec<RunLine>, StoreError> {
        let Viewer::Team(team) = viewer else { return Ok(vec![]) };
        let mut tx = self.snapshot().await?;
        let phases = read_heads(&mut tx, None).await?;
        let runs = read_runs(&mut tx, &RunFilter { team: Some(team), ..RunFilter::default() }).await?;
        let mut lines = Vec::new();
        for run in runs.into_iter().take(limit as usize) {
            let head = phases.iter().find(|head| head.phase.id == run.phase);
            if let Some(sight) = head.and_then(|head| Sight::of(viewer, &run.team, &head.phase)) {
                lines.push(line(&mut tx, run, sight).await?);
            }
        }
        Ok(lines)
    }

    /// All teams as they are at `now_unix_ms`; nothing for anybody but the organiser.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn teams(&self, viewer: &Viewer, now_unix_ms: i64) -> Result<TeamsView, StoreError> {
        if *viewer != Viewer::Organiser {
            return Ok(TeamsView::default());
        }
        let mut tx = self.snapshot().await?;
        let heads = read_heads(&mut tx, None).await?;
        let asks = heads.into_iter().map(|head| head.phase).filter(|phase| phase.admission.approval);
        let select = "SELECT phase, team, runs, reason, granted_ms FROM grants ORDER BY id DESC LIMIT $1";
        Ok(TeamsView {
            phases_by_approval: asks.map(|phase| phase.id).collect(),
            teams: read_teams(&mut tx, now_unix_ms).await?,
            grants: sqlx::query_as(select).bind(GRANTS_TOLD).fetch_all(&mut *tx).await?,
        })
    }

    /// Lines of the audit list before the line `before`, or the newest, the newest first and `limit` at most; none for anybody
    /// but the organiser.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn audit(
        &self,
        viewer: &Viewer,
        before: Option<i64>,
        limit: u32,
    ) -> Result<Vec<AuditLine>, StoreError> {
        if *viewer != Viewer::Organiser {
            return Ok(vec![]);
        }
        let select = "SELECT id, at_ms, actor, subject, what, before, after, reason FROM audit \
                      WHERE $1 IS NULL OR id < $1 ORDER BY id DESC LIMIT $2";
        Ok(sqlx::query_as(select).bind(before).bind(limit).fetch_all(&self.pool).await?)
    }
}

async fn read_teams(tx: &mut Transaction<'_, Sqlite>, now_unix_ms: i64) -> Result<Vec<TeamLine>, StoreError> {
    let select = "SELECT t.name, t.reference, t.created_ms, \
                  (SELECT COUNT(*) FROM runs r WHERE r.team = t.name) AS runs, \
                  (SELECT COUNT(*) FROM tokens k WHERE k.team = t.name AND k.kind <> 'run' AND k.revoked_ms IS NULL \
                  AND (k.expires_ms IS NULL OR k.expires_ms > $1)) AS tokens, \
                  (SELECT group_concat(a.phase, ', ') FROM approvals a WHERE a.team = t.name) AS approved \
                  FROM teams t ORDER BY t.name";
    Ok(sqlx::query_as(select).bind(now_unix_ms).fetch_all(&mut **tx).await?)
}
