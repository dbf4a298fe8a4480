use std::path::PathBuf;

/// What went wrong in the store, and what to do about it.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The file or its folder cannot be used.
    #[error(
        "cannot open the database {path}: {reason}; check that its folder exists, is writable and has space, or choose another"
    )]
    CannotOpen {
        /// The file.
        path: PathBuf,
        /// What the system says.
        reason: String,
    },
    /// The file is something else.
    #[error("{path} is not an LH-AVLN Arena database; move it away or choose another data folder")]
    NotOurs {
        /// The file.
        path: PathBuf,
    },
    /// A newer program wrote the file.
    #[error(
        "the database {path} has schema version {found}, this program knows up to {known}; use the newer program or another data folder"
    )]
    Newer {
        /// The file.
        path: PathBuf,
        /// Version of the file.
        found: i64,
        /// Newest version known.
        known: i64,
    },
    /// Migrations failed for another reason.
    #[error(
        "cannot bring the database {path} up to date: {reason}; restore a backup or choose another data folder"
    )]
    Migration {
        /// The file.
        path: PathBuf,
        /// What failed.
        reason: String,
    },
    /// Another process holds the database for too long.
    #[error("the database is held by another program; stop that program, then try again")]
    Busy,
    /// A name that is not there.
    #[error("there is no {what} '{name}'; check the name")]
    Unknown {
        /// Kind of thing.
        what: &'static str,
        /// Its name.
        name: String,
    },
    /// A name that is taken by something different.
    #[error("{what} '{name}' exists already and differs; choose another name")]
    Taken {
        /// Kind of thing.
        what: &'static str,
        /// Its name.
        name: String,
    },
    /// The phase takes no new runs.
    #[error("phase '{0}' is closed; choose an open phase")]
    PhaseClosed(String),
    /// The phase is not played in this order.
    #[error("phase '{phase}' is not played {order}; choose the other order")]
    OrderNotAllowed {
        /// The phase.
        phase: String,
        /// The order asked for.
        order: &'static str,
    },
    /// The team has no run left.
    #[error(
        "the team has used all of its {limit} runs in phase '{phase}'; cancelled runs without a result do not count"
    )]
    QuotaUsed {
        /// The phase.
        phase: String,
        /// Runs allowed.
        limit: u32,
    },
    /// The run is over.
    #[error("run '{run}' is {state}; start another run")]
    RunOver {
        /// The run.
        run: String,
        /// Its state.
        state: &'static str,
    },
    /// A row does not hold what its column promises.
    #[error("the database holds a damaged {what}: {reason}; restore a backup")]
    Damaged {
        /// What could not be read.
        what: &'static str,
        /// Why not.
        reason: String,
    },
    /// SQLite failed.
    #[error("the database failed: {0}; check disk space and file permissions")]
    Database(#[source] sqlx::Error),
}

impl StoreError {
    pub(crate) fn unknown(what: &'static str, name: &str) -> Self {
        Self::Unknown { what, name: name.to_owned() }
    }

    pub(crate) fn damaged(what: &'static str, reason: impl ToString) -> Self {
        Self::Damaged { what, reason: reason.to_string() }
    }
}

/// Primary result code of SQLite (sqlite.org/rescode.html), when it was SQLite that failed.
pub(crate) fn sqlite_code(error: &sqlx::Error) -> Option<i64> {
    let extended: i64 = error.as_database_error()?.code()?.parse().ok()?;
    Some(extended & 0xff)
}

const SQLITE_BUSY: i64 = 5;
const SQLITE_LOCKED: i64 = 6;

impl From<sqlx::Error> for StoreError {
    fn from(error: sqlx::Error) -> Self {
        match sqlite_code(&error) {
            Some(SQLITE_BUSY | SQLITE_LOCKED) => Self::Busy,
            _ => Self::Database(error),
        }
    }
}
