//! Teams, tokens, and the audit list, whose lines are only added: database triggers reject updates and deletions.

use crate::{
    database::{Store, Transaction, Word, value},
    error::{Result, StoreError},
};
use avln_challenge::{Reference, TokenScope};
use serde::Serialize;
use sqlx::{FromRow, SqlitePool};
use std::fmt;

/// A participant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Team {
    /// Public name.
    pub name: String,
    /// Reference kind; `None` for a competing team.
    pub reference: Option<Reference>,
}

/// A secret to be stored.
#[derive(Clone, Copy, Debug)]
pub struct NewToken<'a> {
    /// The secret: 128 random bits or more. Only a hash is stored.
    pub secret: &'a str,
    /// Granted rights. Run tokens are created by [`Store::start_run`].
    pub kind: TokenScope,
    /// Name given by the owner; may be empty.
    pub name: &'a str,
    /// Owning team; `None` for an organiser's token.
    pub team: Option<&'a str>,
    /// Expiry time, milliseconds since 1970-01-01 UTC; `None` if it never expires.
    pub expires_unix_ms: Option<i64>,
}

/// A valid token.
#[derive(Clone, Debug, PartialEq, Eq, FromRow)]
pub struct Token {
    /// Granted rights.
    #[sqlx(try_from = "String")]
    pub kind: TokenScope,
    /// Owning team; `None` for an organiser's token.
    pub team: Option<String>,
    /// The run played with it; `None` unless `kind` is [`TokenScope::Run`].
    pub run: Option<String>,
    /// Name given by the owner; may be empty.
    pub name: String,
    /// Expiry time, milliseconds since 1970-01-01 UTC; `None` if it never expires.
    #[sqlx(rename = "expires_ms")]
    pub expires_unix_ms: Option<i64>,
}

/// A token in a list, without the secret. Times are milliseconds since 1970-01-01 UTC.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, FromRow)]
pub struct TokenLine {
    /// First hash digits, used as a name in commands.
    pub id: String,
    /// [`TokenScope`] word.
    pub kind: String,
    /// Name given by the owner; may be empty.
    pub name: String,
    /// Owning team; `None` for an organiser's token.
    pub team: Option<String>,
    /// Issue time.
    pub created_ms: i64,
    /// Expiry time; `None` if it never expires.
    pub expires_ms: Option<i64>,
    /// Revocation time; `None` if it is not revoked.
    pub revoked_ms: Option<i64>,
}

/// A secret's state at a given time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TokenState {
    /// Valid.
    Valid(Token),
    /// Expired.
    Expired,
    /// Revoked.
    Revoked,
    /// Never issued.
    Unknown,
}

#[derive(FromRow)]
struct TokenRow {
    #[sqlx(flatten)]
    token: Token,
    revoked_ms: Option<i64>,
}

impl Store {
    /// Adds a team; a repeated call has no effect. Fails if a team with this name has another `reference`.
    pub async fn create_team(
        &self,
        name: &str,
        reference: Option<Reference>,
        now_unix_ms: i64,
    ) -> Result<()> {
        let insert =
            "INSERT INTO teams (name, reference, created_ms) VALUES ($1, $2, $3) ON CONFLICT DO NOTHING";
        let word = reference.map(Reference::as_str);
        sqlx::query(insert).bind(name).bind(word).bind(now_unix_ms).execute(&self.write).await?;
        match self.team(name).await? {
            Some(team) if team.reference == reference => Ok(()),
            _ => Err(StoreError::Taken { what: "team", name: name.to_owned() }),
        }
    }

    /// Returns the team called `name`.
    pub async fn team(&self, name: &str) -> Result<Option<Team>> {
        let select = "SELECT reference FROM teams WHERE name = $1";
        let found: Option<Option<Word<Reference>>> =
            sqlx::query_scalar(select).bind(name).fetch_optional(&self.read).await?;
        Ok(found.map(|reference| Team { name: name.to_owned(), reference: value(reference) }))
    }

    /// Returns all team names, sorted.
    pub async fn team_names(&self) -> Result<Vec<String>> {
        Ok(sqlx::query_scalar("SELECT name FROM teams ORDER BY name").fetch_all(&self.read).await?)
    }

    /// Stores a secret's hash. A repeated call has no effect. Fails if the team is unknown.
    pub async fn issue_token(&self, token: &NewToken<'_>, now_unix_ms: i64) -> Result<()> {
        if let Some(team) = token.team
            && self.team(team).await?.is_none()
        {
            return Err(StoreError::unknown("team", team));
        }
        let mut tx = self.begin().await?;
        insert_token(&mut tx, token, None, now_unix_ms).await?;
        Ok(tx.commit().await?)
    }

    /// Returns a secret's state at `now_unix_ms`.
    pub async fn find_token(&self, secret: &str, now_unix_ms: i64) -> Result<TokenState> {
        find_token(&self.read, &TokenHash::of(secret), now_unix_ms).await
    }

    /// Revokes all tokens of `team`, including run tokens. Returns their count.
    pub async fn revoke_tokens(&self, team: &str, now_unix_ms: i64) -> Result<u64> {
        let update = "UPDATE tokens SET revoked_ms = $1 WHERE team = $2 AND revoked_ms IS NULL";
        Ok(sqlx::query(update).bind(now_unix_ms).bind(team).execute(&self.write).await?.rows_affected())
    }

    /// Returns all team and organiser tokens, newest first. Run tokens are not listed.
    pub async fn tokens(&self) -> Result<Vec<TokenLine>> {
        read_tokens(&self.read, None).await
    }

    /// Revokes the token with [`TokenLine::id`] `id`. A second call has no effect. Fails if there is no such token.
    pub async fn revoke_token(&self, id: &str, note: AuditNote, now_unix_ms: i64) -> Result<()> {
        self.revoke(id, None, note, now_unix_ms).await
    }

    /// Revokes a token as [`Store::revoke_token`] does, if it belongs to `team`. Fails if the team has no such token.
    pub async fn revoke_own_token(
        &self,
        team: &str,
        id: &str,
        note: AuditNote,
        now_unix_ms: i64,
    ) -> Result<()> {
        self.revoke(id, Some(team), note, now_unix_ms).await
    }

    async fn revoke(&self, id: &str, team: Option<&str>, note: AuditNote, now_unix_ms: i64) -> Result<()> {
        let mut tx = self.begin().await?;
        // The first revocation time stays: it bounds the period of use. Run tokens end with their run.
        let update = "UPDATE tokens SET revoked_ms = COALESCE(revoked_ms, $1) \
                      WHERE substr(hash, 1, $2) = $3 AND kind <> 'run' AND ($4 IS NULL OR team = $4)";
        let update = sqlx::query(update).bind(now_unix_ms).bind(TOKEN_ID_DIGITS).bind(id).bind(team);
        if update.execute(&mut *tx).await?.rows_affected() == 0 {
            return Err(StoreError::unknown("token", id));
        }
        add_notes(&mut tx, &[note], now_unix_ms).await?;
        Ok(tx.commit().await?)
    }
}

/// A secret's BLAKE3 hash. It grants no rights, so sessions can store it for later look-ups.
#[derive(Clone, PartialEq, Eq)]
pub struct TokenHash(String);

impl TokenHash {
    /// Hashes a secret.
    pub fn of(secret: &str) -> Self {
        Self(blake3::hash(secret.as_bytes()).to_hex().to_string())
    }

    /// Returns the token's id in lists.
    pub fn id(&self) -> &str {
        self.0.get(..TOKEN_ID_DIGITS as usize).unwrap_or_default()
    }
}

impl fmt::Debug for TokenHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "TokenHash({}…)", self.id())
    }
}

/// Returns a team's tokens, or all team and organiser tokens, newest first.
pub(crate) async fn read_tokens(pool: &SqlitePool, team: Option<&str>) -> Result<Vec<TokenLine>> {
    let select = "SELECT substr(hash, 1, $1) AS id, kind, name, team, created_ms, expires_ms, revoked_ms FROM tokens \
                  WHERE kind <> 'run' AND ($2 IS NULL OR team = $2) ORDER BY created_ms DESC, hash";
    Ok(sqlx::query_as(select).bind(TOKEN_ID_DIGITS).bind(team).fetch_all(pool).await?)
}

const TOKEN_ID_DIGITS: i64 = 12;

pub(crate) async fn insert_token(
    tx: &mut Transaction<'_>,
    token: &NewToken<'_>,
    run: Option<&str>,
    now_unix_ms: i64,
) -> Result<()> {
    // A repeated start request may bring the same secret.
    let insert = "INSERT INTO tokens (hash, kind, name, team, run, created_ms, expires_ms) \
                  VALUES ($1, $2, $3, $4, $5, $6, $7) ON CONFLICT DO NOTHING";
    sqlx::query(insert)
        .bind(TokenHash::of(token.secret).0)
        .bind(token.kind.as_str())
        .bind(token.name)
        .bind(token.team)
        .bind(run)
        .bind(now_unix_ms)
        .bind(token.expires_unix_ms)
        .execute(&mut **tx)
        .await?;
    Ok(())
}

pub(crate) async fn find_token(pool: &SqlitePool, token: &TokenHash, now_unix_ms: i64) -> Result<TokenState> {
    let select = "SELECT kind, name, team, run, expires_ms, revoked_ms FROM tokens WHERE hash = $1";
    let row: Option<TokenRow> = sqlx::query_as(select).bind(&token.0).fetch_optional(pool).await?;
    let Some(row) = row else { return Ok(TokenState::Unknown) };
    if row.revoked_ms.is_some() {
        return Ok(TokenState::Revoked);
    }
    let is_expired = row.token.expires_unix_ms.is_some_and(|expires| expires <= now_unix_ms);
    Ok(if is_expired { TokenState::Expired } else { TokenState::Valid(row.token) })
}

/// A change to be recorded in the audit list.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AuditNote {
    /// Author.
    pub actor: String,
    /// Changed object: `phase practice`, `team red`.
    pub subject: String,
    /// Setting or action: `quota.day`, `paused`, `granted`.
    pub what: String,
    /// Value before the change; `None` for no value.
    pub before: Option<String>,
    /// Value after the change; `None` for no value.
    pub after: Option<String>,
    /// Reason; may be empty.
    pub reason: String,
}

/// An audit line.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, FromRow)]
pub struct AuditLine {
    /// Ascending number.
    pub id: i64,
    /// Time, milliseconds since 1970-01-01 UTC.
    pub at_ms: i64,
    /// Author.
    pub actor: String,
    /// Changed object.
    pub subject: String,
    /// Setting or action.
    pub what: String,
    /// Value before the change; `None` for no value.
    pub before: Option<String>,
    /// Value after the change; `None` for no value.
    pub after: Option<String>,
    /// Reason; may be empty.
    pub reason: String,
}

impl Store {
    /// Returns the audit list, oldest line first.
    pub async fn audit(&self) -> Result<Vec<AuditLine>> {
        let select = "SELECT id, at_ms, actor, subject, what, before, after, reason FROM audit ORDER BY id";
        Ok(sqlx::query_as(select).fetch_all(&self.read).await?)
    }

    /// Adds a line to the audit list.
    pub async fn add_audit_note(&self, note: AuditNote, now_unix_ms: i64) -> Result<()> {
        let mut tx = self.begin().await?;
        add_notes(&mut tx, &[note], now_unix_ms).await?;
        Ok(tx.commit().await?)
    }

    /// Returns the newest audit line's id, 0 for an empty list. It grows with every change by an organiser.
    pub async fn newest_audit_id(&self) -> Result<i64> {
        Ok(sqlx::query_scalar("SELECT COALESCE(MAX(id), 0) FROM audit").fetch_one(&self.read).await?)
    }
}

pub(crate) async fn add_notes(tx: &mut Transaction<'_>, notes: &[AuditNote], now_unix_ms: i64) -> Result<()> {
    let insert = "INSERT INTO audit (at_ms, actor, subject, what, before, after, reason) \
                  VALUES ($1, $2, $3, $4, $5, $6, $7)";
    for note in notes {
        sqlx::query(insert)
            .bind(now_unix_ms)
            .bind(&note.actor)
            .bind(&note.subject)
            .bind(&note.what)
            .bind(&note.before)
            .bind(&note.after)
            .bind(&note.reason)
            .execute(&mut **tx)
            .await?;
    }
    Ok(())
}
