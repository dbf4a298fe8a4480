use crate::{Reader, StoreError, error::sqlite_code};
use sqlx::{
    SqlSafeStr, Sqlite, Transaction,
    migrate::{MigrateError, Migration, MigrationType, Migrator},
    sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePool, SqlitePoolOptions, SqliteSynchronous},
};
use std::{path::Path, time::Duration};

/// The newest schema that this program knows.
pub const SCHEMA_VERSION: i64 = 8;

/// The letters AVLN, which the first migration writes into the file.
const APPLICATION_ID: i64 = 0x4156_4C4E;
const BEGIN: &str = "BEGIN IMMEDIATE";
const READERS: u32 = 4;
pub(crate) const BUSY_TIMEOUT: Duration = Duration::from_secs(5);

/// The database, with the right to write. Cheap to clone; time is always an argument.
#[derive(Clone, Debug)]
pub struct Store {
    /// One connection: SQLite has one writer, so callers queue here and not in SQLITE_BUSY.
    pub(crate) write: SqlitePool,
    pub(crate) read: SqlitePool,
    reader: Reader,
}

impl Store {
    /// Opens the database at `path`, makes it when there is none, and brings its schema up to date.
    ///
    /// # Errors
    /// When the file cannot be used, is not ours, is held by another program or comes from a newer version.
    pub async fn open(path: &Path) -> Result<Self, StoreError> {
        Self::open_waiting(path, BUSY_TIMEOUT).await
    }

    pub(crate) async fn open_waiting(path: &Path, busy: Duration) -> Result<Self, StoreError> {
        let refused = |error| explain(path, error);
        if path.exists() {
            refuse_foreign(path, busy).await?;
        }
        let write_options = options(path, busy).create_if_missing(true).journal_mode(SqliteJournalMode::Wal);
        let write =
            SqlitePoolOptions::new().max_connections(1).connect_with(write_options).await.map_err(refused)?;
        migrator().run(&write).await.map_err(|error| explain_migration(path, error))?;
        let read_options = options(path, busy).read_only(true);
        let read = SqlitePoolOptions::new()
            .max_connections(READERS)
            .connect_with(read_options)
            .await
            .map_err(refused)?;
        Ok(Self { write, reader: Reader::new(read.clone()), read })
    }

    /// The half of the store that pages are given.
    pub fn reader(&self) -> Reader {
        self.reader.clone()
    }

    /// Waits for running statements and closes the file.
    pub async fn close(self) {
        self.read.close().await;
        self.write.close().await;
    }

    /// A transaction that holds the right to write from its start. Dropped without commit, it leaves no trace.
    pub(crate) async fn begin(&self) -> Result<Transaction<'static, Sqlite>, StoreError> {
        match self.write.begin_with(BEGIN).await {
            // A transaction that the database broke off by itself, for want of disk, leaves its connection in the belief that
            // it goes on.
            Err(sqlx::Error::InvalidSavePointStatement) => {
                self.write.acquire().await?.close().await?;
                Ok(self.write.begin_with(BEGIN).await?)
            }
            begun => Ok(begun?),
        }
    }
}

pub(crate) fn options(path: &Path, busy: Duration) -> SqliteConnectOptions {
    SqliteConnectOptions::new()
        .filename(path)
        .synchronous(SqliteSynchronous::Full)
        .foreign_keys(true)
        .busy_timeout(busy)
        .pragma("temp_store", "memory")
}

fn migrator() -> Migrator {
    let first = include_str!("../../../../migrations/0001_first.sql");
    let challenge = include_str!("../../../../migrations/0002_challenge.sql");
    let sealed = include_str!("../../../../migrations/0003_sealed.sql");
    let rescores = include_str!("../../../../migrations/0004_rescores.sql");
    let deadlines = include_str!("../../../../migrations/0005_deadlines.sql");
    let senses = include_str!("../../../../migrations/0006_senses.sql");
    let references = include_str!("../../../../migrations/0007_references.sql");
    let rulings = include_str!("../../../../migrations/0008_rulings.sql");
    let steps = [
        (1, "first", first),
        (2, "challenge", challenge),
        (3, "sealed", sealed),
        (4, "rescores", rescores),
        (5, "deadlines", deadlines),
        (6, "senses", senses),
        (7, "references", references),
        (8, "rulings", rulings),
    ];
    let migration = |(version, name, sql): (i64, &'static str, &'static str)| {
        Migration::new(version, name.into(), MigrationType::Simple, sql.into_sql_str(), false)
    };
    Migrator::with_migrations(steps.into_iter().map(migration).collect())
}

/// Looks into an existing file before anything is changed in it.
pub(crate) async fn refuse_foreign(path: &Path, busy: Duration) -> Result<(), StoreError> {
    let pool = SqlitePoolOptions::new().max_connections(1).connect_with(options(path, busy)).await;
    let pool = pool.map_err(|error| explain(path, error))?;
    let looked = look(&pool).await;
    pool.close().await;
    let (application, tables) = looked.map_err(|error| explain(path, error))?;
    if application == APPLICATION_ID || (application == 0 && tables == 0) {
        Ok(())
    } else {
        Err(StoreError::NotOurs { path: path.to_owned() })
    }
}

async fn look(pool: &SqlitePool) -> Result<(i64, i64), sqlx::Error> {
    let application: i64 = sqlx::query_scalar("PRAGMA application_id").fetch_one(pool).await?;
    let tables: i64 = sqlx::query_scalar("SELECT COUNT(*) FROM sqlite_schema").fetch_one(pool).await?;
    Ok((application, tables))
}

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
    async fn a_database_without_room_can_be_written_again_when_there_is_some() {
        let folder = tempfile::tempdir().expect("a folder");
        let store = Store::open(&folder.path().join("arena.db")).await.expect("a new database");
        let pages: i64 =
            sqlx::query_scalar("PRAGMA page_count").fetch_one(&store.write).await.expect("pages");
        let mut tx = store.begin().await.expect("a transaction");
        let full = format!("PRAGMA max_page_count = {}", pages + 1);
        sqlx::query(sqlx::AssertSqlSafe(full)).execute(&mut *tx).await.expect("a limit");
        let much = "INSERT INTO truths (digest, body) VALUES ('x', zeroblob(10000000))";
        let refused = sqlx::query(much).execute(&mut *tx).await.expect_err("no room");
        assert!(refused.to_string().contains("full"), "{refused}");
        drop(tx);
        let tx = store.begin().await.expect("another transaction, although the first was broken off");
        tx.commit().await.expect("a disk");
        store.note_alive(7).await.expect("it writes again");
    }
}
