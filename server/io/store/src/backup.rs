//! Copies of a database, made while a server writes to it.

use crate::{
    SCHEMA_VERSION, StoreError,
    database::{BUSY_TIMEOUT, explain, options, refuse_foreign},
    words::count,
};
use sqlx::sqlite::{SqlitePool, SqlitePoolOptions};
use std::{collections::BTreeMap, path::Path};

/// What a copy of a database holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Inventory {
    /// Version of its schema.
    pub schema: i64,
    /// Teams in it.
    pub teams: u32,
    /// Episodes with a result.
    pub results: u32,
    /// Splits that its phases play.
    pub splits: Vec<String>,
    /// Its runs.
    pub runs: Vec<KeptRun>,
}

/// A run in a copy of a database.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KeptRun {
    /// Its id.
    pub id: String,
    /// Whether nothing of it can change any more.
    pub is_settled: bool,
    /// How often each of its episodes was handed out, by place; empty when it is settled.
    pub attempts: BTreeMap<u32, u32>,
}

/// Copies the database at `path` to the new file `to`, as it is at one moment. It changes nothing, and servers may go on
/// writing meanwhile.
///
/// # Errors
/// When `path` is no database of ours, or the copy cannot be written.
pub async fn copy_database(path: &Path, to: &Path) -> Result<(), StoreError> {
    refuse_foreign(path, BUSY_TIMEOUT).await?;
    let pool = read_only(path).await?;
    let copied = sqlx::query("VACUUM INTO $1").bind(to.to_string_lossy().into_owned()).execute(&pool).await;
    pool.close().await;
    copied.map(drop).map_err(|error| explain(path, error))
}

/// Reads a copy through: every page of it and every reference from one row to another. It changes nothing.
///
/// # Errors
/// When it is damaged, is no database of ours or comes from a newer program.
pub async fn inspect_database(path: &Path) -> Result<Inventory, StoreError> {
    refuse_foreign(path, BUSY_TIMEOUT).await?;
    let pool = read_only(path).await?;
    let inventory = inspect(&pool, path).await;
    pool.close().await;
    inventory
}

async fn read_only(path: &Path) -> Result<SqlitePool, StoreError> {
    let options = options(path, BUSY_TIMEOUT).read_only(true);
    let pool = SqlitePoolOptions::new().max_connections(1).connect_with(options).await;
    pool.map_err(|error| explain(path, error))
}

async fn inspect(pool: &SqlitePool, path: &Path) -> Result<Inventory, StoreError> {
    let newest = "SELECT MAX(version) FROM _sqlx_migrations WHERE success";
    let schema: i64 =
        sqlx::query_scalar(newest).fetch_one(pool).await.map_err(|error| explain(path, error))?;
    if schema > SCHEMA_VERSION {
        return Err(StoreError::Newer { path: path.to_owned(), found: schema, known: SCHEMA_VERSION });
    }
    let faults: Vec<String> = sqlx::query_scalar("PRAGMA integrity_check(3)").fetch_all(pool).await?;
    if faults != ["ok"] {
        return Err(StoreError::damaged("file", faults.join("; ")));
    }
    let dangling = sqlx::query("PRAGMA foreign_key_check").fetch_all(pool).await?.len();
    if dangling > 0 {
        return Err(StoreError::damaged("file", format!("{dangling} rows point at rows that are not there")));
    }
    let number = async |query: &'static str| sqlx::query_scalar::<_, i64>(query).fetch_one(pool).await;
    Ok(Inventory {
        schema,
        teams: count(number("SELECT COUNT(*) FROM teams").await?),
        results: count(number("SELECT COUNT(*) FROM episodes WHERE metrics IS NOT NULL").await?),
        splits: sqlx::query_scalar("SELECT DISTINCT split FROM phases ORDER BY 1").fetch_all(pool).await?,
        runs: runs(pool).await?,
    })
}

async fn runs(pool: &SqlitePool) -> Result<Vec<KeptRun>, StoreError> {
    let settled = "SELECT id, state NOT IN ('created', 'running') AND NOT EXISTS \
                   (SELECT 1 FROM episodes e WHERE e.run = r.id AND e.state = 'running') FROM runs r ORDER BY id";
    let rows: Vec<(String, bool)> = sqlx::query_as(settled).fetch_all(pool).await?;
    let mut runs = Vec::with_capacity(rows.len());
    for (id, is_settled) in rows {
        let select = "SELECT ordinal, attempts FROM episodes WHERE run = $1 AND NOT $2";
        let attempts: Vec<(i64, i64)> =
            sqlx::query_as(select).bind(&id).bind(is_settled).fetch_all(pool).await?;
        let attempts = attempts.into_iter().map(|(ordinal, times)| (count(ordinal), count(times))).collect();
        runs.push(KeptRun { id, is_settled, attempts });
    }
    Ok(runs)
}
