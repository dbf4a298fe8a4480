//! Online copies of a database, and their inspection.

use crate::{
    database::{BUSY_TIMEOUT, SCHEMA_VERSION, connect_options, explain, reject_foreign},
    error::StoreError,
};
use sqlx::{
    FromRow,
    sqlite::{SqlitePool, SqlitePoolOptions},
};
use std::{collections::BTreeMap, path::Path};

/// A copy's contents.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Inventory {
    /// Schema version.
    pub schema: i64,
    /// Team count.
    pub teams: u32,
    /// Episode count with a result.
    pub results: u32,
    /// Splits in use.
    pub splits: Vec<String>,
    /// Runs.
    pub runs: Vec<KeptRun>,
}

/// A run in a copy.
#[derive(Clone, Debug, PartialEq, Eq, FromRow)]
pub struct KeptRun {
    /// Run id.
    pub id: String,
    /// True if the run cannot change any more.
    pub is_settled: bool,
    /// Attempts by episode ordinal; empty if the run is settled.
    #[sqlx(json)]
    pub attempts: BTreeMap<u32, u32>,
}

/// Copies the database at `path` to the new file `to` in one consistent state. Servers can write meanwhile.
///
/// # Errors
/// If `path` is no LH-AVLN Arena database, or the copy cannot be written.
pub async fn copy_database(path: &Path, to: &Path) -> Result<(), StoreError> {
    reject_foreign(path, BUSY_TIMEOUT).await?;
    let pool = read_only(path).await?;
    // VACUUM INTO reads in one transaction: the copy is consistent while others write. Copying the files would miss the WAL.
    let copied = sqlx::query("VACUUM INTO $1").bind(to.to_string_lossy().into_owned()).execute(&pool).await;
    pool.close().await;
    copied.map(drop).map_err(|error| explain(path, error))
}

/// Checks all pages and references in a copy and returns the contents. The copy is not changed.
///
/// # Errors
/// If the copy is damaged, no LH-AVLN Arena database or has a newer schema.
pub async fn inspect_database(path: &Path) -> Result<Inventory, StoreError> {
    reject_foreign(path, BUSY_TIMEOUT).await?;
    let pool = read_only(path).await?;
    let inventory = inspect(&pool, path).await;
    pool.close().await;
    inventory
}

async fn read_only(path: &Path) -> Result<SqlitePool, StoreError> {
    let options = connect_options(path, BUSY_TIMEOUT).read_only(true);
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
    // Three faults are enough for a message.
    let faults: Vec<String> = sqlx::query_scalar("PRAGMA integrity_check(3)").fetch_all(pool).await?;
    if faults != ["ok"] {
        return Err(StoreError::damaged("file", faults.join("; ")));
    }
    let dangling = sqlx::query("PRAGMA foreign_key_check").fetch_all(pool).await?.len();
    if dangling > 0 {
        return Err(StoreError::damaged("file", format!("{dangling} rows refer to missing rows")));
    }
    let results = "SELECT COUNT(*) FROM episodes WHERE metrics IS NOT NULL";
    Ok(Inventory {
        schema,
        teams: sqlx::query_scalar("SELECT COUNT(*) FROM teams").fetch_one(pool).await?,
        results: sqlx::query_scalar(results).fetch_one(pool).await?,
        splits: sqlx::query_scalar("SELECT DISTINCT split FROM phases ORDER BY 1").fetch_all(pool).await?,
        runs: read_kept_runs(pool).await?,
    })
}

async fn read_kept_runs(pool: &SqlitePool) -> Result<Vec<KeptRun>, StoreError> {
    let select = "SELECT id, settled AS is_settled, (SELECT json_group_object(ordinal, attempts) FROM episodes e \
                  WHERE e.run = id AND NOT settled) AS attempts \
                  FROM (SELECT id, state NOT IN ('created', 'running') AND NOT EXISTS \
                  (SELECT 1 FROM episodes e WHERE e.run = r.id AND e.state = 'running') AS settled FROM runs r) \
                  ORDER BY id";
    Ok(sqlx::query_as(select).fetch_all(pool).await?)
}
