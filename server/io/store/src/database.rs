use crate::error::{StoreError, sqlite_code};
use quick_cache::sync::Cache;
use sqlx::{
    Sqlite, Transaction,
    migrate::{MigrateError, Migrator},
    sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePool, SqlitePoolOptions, SqliteSynchronous},
};
use std::{
    any::{Any, TypeId},
    fmt,
    path::Path,
    sync::Arc,
    time::Duration,
};

static MIGRATIONS: Migrator = sqlx::migrate!("../../../migrations");

/// The newest schema version known to this program.
pub const SCHEMA_VERSION: i64 = 9;

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
    /// Opens the database at `path`, creates it if missing, and applies pending migrations.
    ///
    /// # Errors
    /// If the file cannot be used, is no LH-AVLN Arena database, is locked by another program or has a newer schema.
    pub async fn open(path: &Path) -> Result<Self, StoreError> {
        Self::open_with_timeout(path, BUSY_TIMEOUT).await
    }

    pub(crate) async fn open_with_timeout(path: &Path, busy: Duration) -> Result<Self, StoreError> {
        let explained = |error| explain(path, error);
        // The migrator creates a table first, so a foreign file must be rejected before it runs.
        if path.exists() {
            reject_foreign(path, busy).await?;
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

    /// Begins a transaction with write access. A transaction dropped without commit is rolled back.
    pub(crate) async fn begin(&self) -> Result<Transaction<'static, Sqlite>, StoreError> {
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

/// Rejects an existing foreign file, without changing it.
pub(crate) async fn reject_foreign(path: &Path, busy: Duration) -> Result<(), StoreError> {
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
