//! The database file: opening, conversions of column values, online copies and their inspection.

use crate::error::{Result, StoreError, sqlite_code};
use quick_cache::sync::Cache;
use serde::de::DeserializeOwned;
use sqlx::{
    Database, Decode, FromRow, Row, Sqlite, Type,
    error::BoxDynError,
    migrate::{MigrateError, Migrator},
    sqlite::{
        SqliteConnectOptions, SqliteJournalMode, SqlitePool, SqlitePoolOptions, SqliteRow, SqliteSynchronous,
        SqliteTypeInfo, SqliteValueRef,
    },
    types::Json,
};
use std::{
    any::{Any, TypeId},
    collections::BTreeMap,
    fmt,
    fs::OpenOptions,
    path::Path,
    str::FromStr,
    sync::Arc,
    time::Duration,
};

static MIGRATIONS: Migrator = sqlx::migrate!("../../../migrations");

/// A transaction on the database. Dropped without commit, it is rolled back.
pub(crate) type Transaction<'a> = sqlx::Transaction<'a, Sqlite>;

/// The newest schema version known to this program.
pub const SCHEMA_VERSION: i64 = 11;

/// The letters AVLN, written into the file by the first migration.
const APPLICATION_ID: i64 = 0x4156_4C4E;
const BEGIN: &str = "BEGIN IMMEDIATE";
const READERS: u32 = 4;
pub(crate) const BUSY_TIMEOUT: Duration = Duration::from_secs(5);

/// The database with write access. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Store {
    // SQLite allows one writer. One connection makes callers queue here instead of failing with SQLITE_BUSY.
    pub(crate) write: SqlitePool,
    pub(crate) read: SqlitePool,
    pub(crate) views: ViewCache,
}

impl Store {
    /// Opens the database at `path`, creates it if missing, and applies pending migrations. Fails if the file cannot be used,
    /// is no LH-AVLN Arena database, is locked by another program or has a newer schema.
    pub async fn open(path: &Path) -> Result<Self> {
        Self::open_with_timeout(path, BUSY_TIMEOUT).await
    }

    pub(crate) async fn open_with_timeout(path: &Path, busy: Duration) -> Result<Self> {
        let explained = |error| explain(path, error);
        // The migrator creates a table first, so a foreign file must be rejected before it runs.
        if path.exists() {
            reject_foreign(path, busy).await?;
        } else {
            create_private(path);
        }
        let write = connect_options(path, busy).create_if_missing(true).journal_mode(SqliteJournalMode::Wal);
        let write =
            SqlitePoolOptions::new().max_connections(1).connect_with(write).await.map_err(explained)?;
        MIGRATIONS.run(&write).await.map_err(|error| explain_migration(path, error))?;
        let read = connect_options(path, busy).read_only(true);
        let read =
            SqlitePoolOptions::new().max_connections(READERS).connect_with(read).await.map_err(explained)?;
        Ok(Self { write, read, views: ViewCache::default() })
    }

    /// Waits for running statements and closes the file.
    pub async fn close(self) {
        self.read.close().await;
        self.write.close().await;
    }

    pub(crate) async fn begin(&self) -> Result<Transaction<'static>> {
        match self.write.begin_with(BEGIN).await {
            // SQLite itself rolls a transaction back when the disk is full. sqlx then counts it as open on this connection, so
            // the connection is replaced.
            Err(sqlx::Error::InvalidSavePointStatement) => {
                self.write.acquire().await?.close().await?;
                Ok(self.write.begin_with(BEGIN).await?)
            }
            begun => Ok(begun?),
        }
    }
}

/// A bounded cache for views that never change under their key, shared by a store's readers.
// Values are type-erased: the database module must not depend on the views, which depend on it.
#[derive(Clone)]
pub(crate) struct ViewCache(Arc<Cache<(TypeId, String), Arc<dyn Any + Send + Sync>>>);

impl ViewCache {
    pub(crate) fn get<T: Any + Send + Sync>(&self, key: &str) -> Option<Arc<T>> {
        self.0.get(&(TypeId::of::<T>(), key.to_owned()))?.downcast().ok()
    }

    pub(crate) fn insert<T: Any + Send + Sync>(&self, key: String, view: Arc<T>) {
        self.0.insert((TypeId::of::<T>(), key), view);
    }
}

impl Default for ViewCache {
    fn default() -> Self {
        // A run with 550 episodes takes about 0.3 MB, a leaderboard less.
        const VIEWS: usize = 96;
        Self(Arc::new(Cache::new(VIEWS)))
    }
}

impl fmt::Debug for ViewCache {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ViewCache({} views)", self.0.len())
    }
}

pub(crate) fn connect_options(path: &Path, busy: Duration) -> SqliteConnectOptions {
    SqliteConnectOptions::new()
        .filename(path)
        // Results must survive a power cut, so a commit waits for the disk.
        .synchronous(SqliteSynchronous::Full)
        .foreign_keys(true)
        .busy_timeout(busy)
        .pragma("temp_store", "memory")
}

/// Creates the file, accessible by its owner only: SQLite creates its other files with the same mode.
fn create_private(path: &Path) {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    // SQLite reports a path where no file can be created.
    let _ = options.open(path);
}

/// Rejects an existing foreign file, without changing it.
pub(crate) async fn reject_foreign(path: &Path, busy: Duration) -> Result<()> {
    let pool = SqlitePoolOptions::new().max_connections(1).connect_with(connect_options(path, busy)).await;
    let pool = pool.map_err(|error| explain(path, error))?;
    let identity = read_identity(&pool).await;
    pool.close().await;
    match identity.map_err(|error| explain(path, error))? {
        // An empty file becomes a new database.
        (APPLICATION_ID, _) | (0, 0) => Ok(()),
        _ => Err(StoreError::NotOurs { path: path.to_owned() }),
    }
}

/// Returns application id and table count.
async fn read_identity(pool: &SqlitePool) -> Result<(i64, i64), sqlx::Error> {
    let application: i64 = sqlx::query_scalar("PRAGMA application_id").fetch_one(pool).await?;
    let tables: i64 = sqlx::query_scalar("SELECT COUNT(*) FROM sqlite_schema").fetch_one(pool).await?;
    Ok((application, tables))
}

/// Turns an error that concerns the whole file into one that names it.
pub(crate) fn explain(path: &Path, error: sqlx::Error) -> StoreError {
    const SQLITE_CORRUPT: i64 = 11;
    const SQLITE_NOTADB: i64 = 26;
    let path = path.to_owned();
    match (sqlite_code(&error), StoreError::from(error)) {
        (Some(SQLITE_CORRUPT | SQLITE_NOTADB), _) => StoreError::NotOurs { path },
        (_, StoreError::Database(error)) => StoreError::CannotOpen { path, reason: error.to_string() },
        (_, other) => other,
    }
}

fn explain_migration(path: &Path, error: MigrateError) -> StoreError {
    match error {
        MigrateError::VersionMissing(found) => {
            StoreError::Newer { path: path.to_owned(), found, known: SCHEMA_VERSION }
        }
        MigrateError::Execute(error) | MigrateError::ExecuteMigration(error, _) => explain(path, error),
        other => StoreError::Migration { path: path.to_owned(), reason: other.to_string() },
    }
}

/// A text column with an enum's word.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Word<T>(pub(crate) T);

impl<T> Type<Sqlite> for Word<T> {
    fn type_info() -> SqliteTypeInfo {
        <str as Type<Sqlite>>::type_info()
    }

    fn compatible(column: &<Sqlite as Database>::TypeInfo) -> bool {
        <str as Type<Sqlite>>::compatible(column)
    }
}

impl<'r, T: FromStr<Err: Into<BoxDynError>>> Decode<'r, Sqlite> for Word<T> {
    fn decode(value: SqliteValueRef<'r>) -> Result<Self, BoxDynError> {
        // An unknown word comes from a newer program or a damaged file: the whole row is rejected.
        let word = <&str as Decode<Sqlite>>::decode(value)?;
        word.parse().map(Self).map_err(Into::into)
    }
}

pub(crate) fn word<T: FromStr<Err: Into<BoxDynError>>>(
    row: &SqliteRow,
    column: &str,
) -> Result<T, sqlx::Error> {
    row.try_get::<Word<T>, _>(column).map(|Word(value)| value)
}

pub(crate) fn json<T: DeserializeOwned + 'static>(row: &SqliteRow, column: &str) -> Result<T, sqlx::Error> {
    row.try_get::<Json<T>, _>(column).map(|Json(value)| value)
}

pub(crate) fn optional_json<T: DeserializeOwned + 'static>(
    row: &SqliteRow,
    column: &str,
) -> Result<Option<T>, sqlx::Error> {
    Ok(row.try_get::<Option<Json<T>>, _>(column)?.map(|Json(value)| value))
}

pub(crate) fn value<T>(word: Option<Word<T>>) -> Option<T> {
    word.map(|word| word.0)
}

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

/// Copies the database at `path` to the new file `to` in one consistent state. Servers can write meanwhile. Fails if `path`
/// is no LH-AVLN Arena database, or the copy cannot be written.
pub async fn copy_database(path: &Path, to: &Path) -> Result<()> {
    reject_foreign(path, BUSY_TIMEOUT).await?;
    let pool = read_only(path).await?;
    // VACUUM INTO reads in one transaction: the copy is consistent while others write. Copying the files would miss the WAL.
    let copied = sqlx::query("VACUUM INTO $1").bind(to.to_string_lossy().into_owned()).execute(&pool).await;
    pool.close().await;
    copied.map(drop).map_err(|error| explain(path, error))
}

/// Checks all pages and references in a copy and returns the contents. Fails if it is damaged, foreign or has a newer schema.
pub async fn inspect_database(path: &Path) -> Result<Inventory> {
    reject_foreign(path, BUSY_TIMEOUT).await?;
    let pool = read_only(path).await?;
    let inventory = inspect(&pool, path).await;
    pool.close().await;
    inventory
}

async fn read_only(path: &Path) -> Result<SqlitePool> {
    let options = connect_options(path, BUSY_TIMEOUT).read_only(true);
    let pool = SqlitePoolOptions::new().max_connections(1).connect_with(options).await;
    pool.map_err(|error| explain(path, error))
}

async fn inspect(pool: &SqlitePool, path: &Path) -> Result<Inventory> {
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

async fn read_kept_runs(pool: &SqlitePool) -> Result<Vec<KeptRun>> {
    let select = "SELECT id, settled AS is_settled, (SELECT json_group_object(ordinal, attempts) FROM episodes e \
                  WHERE e.run = id AND NOT settled) AS attempts \
                  FROM (SELECT id, state NOT IN ('created', 'running') AND NOT EXISTS \
                  (SELECT 1 FROM episodes e WHERE e.run = r.id AND e.state = 'running') AS settled FROM runs r) \
                  ORDER BY id";
    Ok(sqlx::query_as(select).fetch_all(pool).await?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn full_database_is_writable_after_space_returns() {
        let folder = tempfile::tempdir().expect("a folder");
        let store = Store::open(&folder.path().join("arena.db")).await.expect("a new database");
        let pages: i64 =
            sqlx::query_scalar("PRAGMA page_count").fetch_one(&store.write).await.expect("pages");
        let mut tx = store.begin().await.expect("a transaction");
        let full = format!("PRAGMA max_page_count = {}", pages + 1);
        sqlx::query(sqlx::AssertSqlSafe(full)).execute(&mut *tx).await.expect("a limit");
        let large = "INSERT INTO truths (digest, body) VALUES ('x', zeroblob(10000000))";
        let refused = sqlx::query(large).execute(&mut *tx).await.expect_err("no space");
        assert!(refused.to_string().contains("full"), "{refused}");
        drop(tx);
        let tx = store.begin().await.expect("a transaction after the rollback");
        tx.commit().await.expect("a disk");
        store.record_heartbeat(7).await.expect("a write");
    }
}
