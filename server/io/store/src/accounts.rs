use crate::{AuditNote, Store, StoreError, audit::add_notes, words::row};
use avln_challenge::{Reference, TokenScope};
use serde::Serialize;
use sqlx::{Sqlite, SqlitePool, Transaction};
use std::fmt;

/// A participant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Team {
    /// Public name.
    pub name: String,
    /// What its runs are a reference for; `None` where it competes.
    pub reference: Option<Reference>,
}

/// A secret to be stored.
#[derive(Clone, Copy, Debug)]
pub struct NewToken<'a> {
    /// The secret itself, 128 random bits or more; only its hash is kept.
    pub secret: &'a str,
    /// Which door it opens; run tokens are made by [`Store::start_run`].
    pub kind: TokenScope,
    /// What its maker calls it; may be empty.
    pub name: &'a str,
    /// Whose it is; `None` for an organiser.
    pub team: Option<&'a str>,
    /// From when it is void.
    pub expires_unix_ms: Option<i64>,
}

/// A token that is known.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Token {
    /// Which door it opens.
    pub kind: TokenScope,
    /// Whose it is; `None` for an organiser.
    pub team: Option<String>,
    /// The run it plays; `None` unless `kind` is run.
    pub run: Option<String>,
    /// What its maker calls it; may be empty.
    pub name: String,
    /// From when it is void; `None` for never.
    pub expires_unix_ms: Option<i64>,
}

row! {
    /// A token as lists show it: everything but the secret.
    #[derive(Clone, Debug, PartialEq, Eq, Serialize)]
    pub struct TokenLine {
        /// The first letters of its hash, by which it can be named.
        pub id: String,
        /// Which door it opens.
        pub kind: String,
        /// What its maker calls it; may be empty.
        pub name: String,
        /// Whose it is; `None` for an organiser.
        pub team: Option<String>,
        /// When it was issued, milliseconds since 1970-01-01 UTC.
        pub created_ms: i64,
        /// From when it is void; `None` for never.
        pub expires_ms: Option<i64>,
        /// When it was taken back; `None` while it holds.
        pub revoked_ms: Option<i64>,
    }
}

/// What a secret is worth at a given time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TokenState {
    /// It holds.
    Valid(Token),
    /// Its time is over.
    Expired,
    /// It was taken back.
    Revoked,
    /// Nobody issued it.
    Unknown,
}

row! {
    struct TokenRow {
        kind: String,
        name: String,
        team: Option<String>,
        run: Option<String>,
        expires_ms: Option<i64>,
        revoked_ms: Option<i64>,
    }
}

impl Store {
    /// Adds a team; adding it again as the same reference, or as none, changes nothing.
    ///
    /// # Errors
    /// When the name is taken by a team that stands for something else, or the database fails.
    pub async fn create_team(
        &self,
        name: &str,
        reference: Option<Reference>,
        now_unix_ms: i64,
    ) -> Result<(), StoreError> {
        let insert =
            "INSERT INTO teams (name, reference, created_ms) VALUES ($1, $2, $3) ON CONFLICT DO NOTHING";
        let word = reference.map(Reference::as_str);
        sqlx::query(insert).bind(name).bind(word).bind(now_unix_ms).execute(&self.write).await?;
        match self.team(name).await? {
            Some(team) if team.reference == reference => Ok(()),
            _ => Err(StoreError::Taken { what: "team", name: name.to_owned() }),
        }
    }

    /// The team called `name`.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn team(&self, name: &str) -> Result<Option<Team>, StoreError> {
        let select = "SELECT reference FROM teams WHERE name = $1";
        let found: Option<Option<String>> =
            sqlx::query_scalar(select).bind(name).fetch_optional(&self.read).await?;
        let team = |word: Option<String>| {
            let reference = word.as_deref().map(Reference::from_word).transpose()?;
            Ok::<_, StoreError>(Team { name: name.to_owned(), reference })
        };
        found.map(team).transpose()
    }

    /// Stores the hash of a secret; storing the same one again changes nothing.
    ///
    /// # Errors
    /// When the team is unknown or the database fails.
    pub async fn issue_token(&self, token: &NewToken<'_>, now_unix_ms: i64) -> Result<(), StoreError> {
        if let Some(team) = token.team
            && self.team(team).await?.is_none()
        {
            return Err(StoreError::unknown("team", team));
        }
        let mut tx = self.begin().await?;
        insert_token(&mut tx, token, None, now_unix_ms).await?;
        Ok(tx.commit().await?)
    }

    /// What `secret` is worth at `now_unix_ms`.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn find_token(&self, secret: &str, now_unix_ms: i64) -> Result<TokenState, StoreError> {
        find_token(&self.read, &TokenHash::of(secret), now_unix_ms).await
    }

    /// Takes back every token of `team`, its runs' included; says how many held.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn revoke_tokens(&self, team: &str, now_unix_ms: i64) -> Result<u64, StoreError> {
        let update = "UPDATE tokens SET revoked_ms = $1 WHERE team = $2 AND revoked_ms IS NULL";
        Ok(sqlx::query(update).bind(now_unix_ms).bind(team).execute(&self.write).await?.rows_affected())
    }

    /// The tokens of accounts and organisers, the newest first; those of runs come and go by themselves.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn tokens(&self) -> Result<Vec<TokenLine>, StoreError> {
        read_tokens(&self.read, None).await
    }

    /// Takes back the token of an account or an organiser that `id` names, as [`Store::tokens`] tells it.
    /// One that was taken back stays as it is.
    ///
    /// # Errors
    /// When there is no such token or the database fails.
    pub async fn revoke_token(&self, id: &str, note: AuditNote, now_unix_ms: i64) -> Result<(), StoreError> {
        self.revoke(id, None, note, now_unix_ms).await
    }

    /// The same for a token of `team` alone.
    ///
    /// # Errors
    /// When the team has no such token or the database fails.
    pub async fn revoke_own_token(
        &self,
        team: &str,
        id: &str,
        note: AuditNote,
        now_unix_ms: i64,
    ) -> Result<(), StoreError> {
        self.revoke(id, Some(team), note, now_unix_ms).await
    }

    async fn revoke(
        &self,
        id: &str,
        team: Option<&str>,
        note: AuditNote,
        now_unix_ms: i64,
    ) -> Result<(), StoreError> {
        let mut tx = self.begin().await?;
        let update = "UPDATE tokens SET revoked_ms = COALESCE(revoked_ms, $1) \
                      WHERE substr(hash, 1, $2) = $3 AND kind <> 'run' AND ($4 IS NULL OR team = $4)";
        let update = sqlx::query(update).bind(now_unix_ms).bind(TOKEN_ID_LETTERS).bind(id).bind(team);
        if update.execute(&mut *tx).await?.rows_affected() == 0 {
            return Err(StoreError::unknown("token", id));
        }
        add_notes(&mut tx, &[note], now_unix_ms).await?;
        Ok(tx.commit().await?)
    }
}

/// A token by its hash, which opens nothing: enough to ask again later what the token is worth.
#[derive(Clone, PartialEq, Eq)]
pub struct TokenHash(String);

impl TokenHash {
    /// The hash of a secret.
    pub fn of(secret: &str) -> Self {
        Self(hash(secret))
    }

    /// The letters by which lists name the token.
    pub fn id(&self) -> &str {
        self.0.get(..TOKEN_ID_LETTERS as usize).unwrap_or_default()
    }
}

impl fmt::Debug for TokenHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "TokenHash({}…)", self.id())
    }
}

/// The tokens of accounts and organisers, or those of one team, the newest first.
pub(crate) async fn read_tokens(pool: &SqlitePool, team: Option<&str>) -> Result<Vec<TokenLine>, StoreError> {
    let select = "SELECT substr(hash, 1, $1) AS id, kind, name, team, created_ms, expires_ms, revoked_ms FROM tokens \
                  WHERE kind <> 'run' AND ($2 IS NULL OR team = $2) ORDER BY created_ms DESC, hash";
    Ok(sqlx::query_as(select).bind(TOKEN_ID_LETTERS).bind(team).fetch_all(pool).await?)
}

/// Letters of a token's hash that name it.
const TOKEN_ID_LETTERS: i64 = 12;

/// Letters of a secret that are kept, so that people can tell tokens apart.
const PREFIX_LETTERS: usize = 12;

fn shown_prefix(secret: &str) -> String {
    secret.chars().take(PREFIX_LETTERS).collect()
}

fn hash(secret: &str) -> String {
    blake3::hash(secret.as_bytes()).to_hex().to_string()
}

pub(crate) async fn insert_token(
    tx: &mut Transaction<'_, Sqlite>,
    token: &NewToken<'_>,
    run: Option<&str>,
    now_unix_ms: i64,
) -> Result<(), StoreError> {
    let insert = "INSERT INTO tokens (hash, prefix, kind, name, team, run, created_ms, expires_ms) \
                  VALUES ($1, $2, $3, $4, $5, $6, $7, $8) ON CONFLICT DO NOTHING";
    sqlx::query(insert)
        .bind(hash(token.secret))
        .bind(shown_prefix(token.secret))
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

pub(crate) async fn find_token(
    pool: &SqlitePool,
    token: &TokenHash,
    now_unix_ms: i64,
) -> Result<TokenState, StoreError> {
    let select = "SELECT kind, name, team, run, expires_ms, revoked_ms FROM tokens WHERE hash = $1";
    let row: Option<TokenRow> = sqlx::query_as(select).bind(&token.0).fetch_optional(pool).await?;
    Ok(match row {
        None => TokenState::Unknown,
        Some(row) if row.revoked_ms.is_some() => TokenState::Revoked,
        Some(row) if row.expires_ms.is_some_and(|expires| expires <= now_unix_ms) => TokenState::Expired,
        Some(TokenRow { kind, name, team, run, expires_ms, .. }) => TokenState::Valid(Token {
            kind: TokenScope::from_word(&kind)?,
            team,
            run,
            name,
            expires_unix_ms: expires_ms,
        }),
    })
}

/// What a team's runs are a reference for.
pub(crate) async fn read_reference(
    tx: &mut Transaction<'_, Sqlite>,
    team: &str,
) -> Result<Option<Reference>, StoreError> {
    let select = "SELECT reference FROM teams WHERE name = $1";
    let word: Option<String> = sqlx::query_scalar(select).bind(team).fetch_one(&mut **tx).await?;
    Ok(word.as_deref().map(Reference::from_word).transpose()?)
}
