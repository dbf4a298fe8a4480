//! Store errors.

use avln_challenge::{Quota, QuotaWindow, calendar::rfc3339};
use std::path::PathBuf;

/// A result with [`StoreError`] by default.
pub type Result<T, E = StoreError> = std::result::Result<T, E>;

/// A store error, with a next step in the message.
#[expect(missing_docs, reason = "the messages explain the fields")]
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The file or folder cannot be used.
    #[error(
        "cannot open the database {path}: {reason}; check that its folder exists, is writable and has free space, or choose another data folder"
    )]
    CannotOpen { path: PathBuf, reason: String },
    /// The file is no LH-AVLN Arena database.
    #[error("{path} is not an LH-AVLN Arena database; move it or choose another data folder")]
    NotOurs { path: PathBuf },
    /// The file has a newer schema.
    #[error(
        "the database {path} has schema version {found}, but this program supports up to {known}; use the newer program or another data folder"
    )]
    Newer { path: PathBuf, found: i64, known: i64 },
    /// A migration failed.
    #[error("cannot migrate the database {path}: {reason}; restore a backup or choose another data folder")]
    Migration { path: PathBuf, reason: String },
    /// Another process locks the database.
    #[error("the database is locked by another program; stop that program, then try again")]
    Busy,
    /// A row with this name does not exist.
    #[error("there is no {what} '{name}'; check the name")]
    Unknown { what: &'static str, name: String },
    /// A different row has this name.
    #[error("{what} '{name}' exists already and differs; choose another name")]
    Taken { what: &'static str, name: String },
    /// The phase is closed.
    #[error("phase '{0}' is closed; choose an open phase")]
    PhaseClosed(String),
    /// The phase is not open yet.
    #[error("phase '{phase}' opens at {}; choose an open phase, or try again then", rfc3339(*opens_unix_ms))]
    PhaseNotOpen {
        phase: String,
        /// Opening time, milliseconds since 1970-01-01 UTC.
        opens_unix_ms: i64,
    },
    /// The phase accepts sealed runs only.
    #[error(
        "phase '{0}' accepts sealed runs only, which its organiser starts; send the agent to the organiser"
    )]
    PhaseSealed(String),
    /// The phase is paused.
    #[error("phase '{phase}' is paused: {reason}; started runs can continue")]
    PhasePaused { phase: String, reason: String },
    /// The phase is not closed, so the secret cannot be published.
    #[error(
        "phase '{0}' is not closed; close it with avln challenge phase close, or wait for its closing date"
    )]
    NotClosed(String),
    /// A revealed phase that would accept runs again.
    #[error("phase '{0}' is revealed, so its episodes are known; open another phase on a new split")]
    Revealed(String),
    /// A hidden phase that would accept runs on a split with a published secret.
    #[error(
        "phase '{phase}' is hidden, but the secret of split '{split}' is published with phase '{by}'; make another split: avln data split make NAME"
    )]
    SecretPublished { phase: String, split: String, by: String },
    /// Runs continue, so the secret cannot be published.
    #[error("runs of phase '{phase}' continue until {} at the latest; reveal it then", rfc3339(*until_unix_ms))]
    StillPlayed {
        phase: String,
        /// Latest deadline, milliseconds since 1970-01-01 UTC.
        until_unix_ms: i64,
    },
    /// The phase is hidden from the team.
    #[error(
        "phase '{phase}' is not visible to team '{team}'; ask the organiser, or choose a phase of ListPhases"
    )]
    PhaseNotVisible { phase: String, team: String },
    /// The team is not admitted to the phase.
    #[error("team '{team}' may not play in phase '{phase}': {why}; ask the organiser")]
    TeamNotApproved { phase: String, team: String, why: &'static str },
    /// The person is in another team in this phase.
    #[error("'{person}' is in team '{team}' of phase '{phase}'; remove the person from that team first")]
    InAnotherTeam { person: String, phase: String, team: String },
    /// The phase does not allow this mission order.
    #[error("phase '{phase}' does not allow {order} missions; choose the other order")]
    OrderNotAllowed { phase: String, order: &'static str },
    /// A team quota is used up.
    #[error("{}", quota_message(.0))]
    QuotaUsed(Box<Quota>),
    /// Two scorers with the same version disagree.
    #[error(
        "run '{run}' was rescored by benchmark {scorer} before, with a different result; the two programs differ despite the equal version"
    )]
    ScoresDiffer { run: String, scorer: String },
    /// The run is over.
    #[error("run '{run}' is {state}; start another run")]
    RunOver { run: String, state: &'static str },
    /// The run is open, so it cannot be verified.
    #[error("run '{0}' is not over; verify it after its end")]
    RunOpen(String),
    /// A stored value is invalid.
    #[error("the database contains a damaged {what}: {reason}; restore a backup")]
    Damaged { what: String, reason: String },
    /// SQLite failed.
    #[error("the database failed: {0}; check disk space and file permissions")]
    Database(#[source] sqlx::Error),
}

impl StoreError {
    pub(crate) fn unknown(what: &'static str, name: &str) -> Self {
        Self::Unknown { what, name: name.to_owned() }
    }

    pub(crate) fn damaged(what: impl Into<String>, reason: impl ToString) -> Self {
        Self::Damaged { what: what.into(), reason: reason.to_string() }
    }

    /// Returns whether the database failed, as opposed to a rejected request.
    pub fn is_fault(&self) -> bool {
        matches!(
            self,
            Self::CannotOpen { .. }
                | Self::NotOurs { .. }
                | Self::Newer { .. }
                | Self::Migration { .. }
                | Self::Busy
                | Self::Damaged { .. }
                | Self::Database(_)
        )
    }
}

fn quota_message(quota: &Quota) -> String {
    let phase = &quota.phase;
    let limit = quota.limit.unwrap_or_default();
    let used = match quota.window {
        QuotaWindow::Day => format!("all {limit} runs of this day (UTC)"),
        QuotaWindow::Month => format!("all {limit} runs of this month (UTC)"),
        QuotaWindow::Total => format!("all {limit} runs of the phase"),
        QuotaWindow::Concurrent => {
            return format!(
                "the team has {limit} open runs in phase '{phase}', the maximum; finish or cancel one"
            );
        }
        QuotaWindow::Uncharged => format!("all {limit} uncharged runs of the phase"),
    };
    let next_step = match quota.next_increase_unix_ms {
        Some(moment) => format!("the next can start at {}", rfc3339(moment)),
        None => "the organiser can grant more".to_owned(),
    };
    format!("the team has used {used} '{phase}'; {next_step}")
}

/// Returns an SQLite error's primary result code (sqlite.org/rescode.html).
pub(crate) fn sqlite_code(error: &sqlx::Error) -> Option<i64> {
    let extended: i64 = error.as_database_error()?.code()?.parse().ok()?;
    Some(extended & 0xff)
}

const SQLITE_BUSY: i64 = 5;
const SQLITE_LOCKED: i64 = 6;

impl From<sqlx::Error> for StoreError {
    fn from(error: sqlx::Error) -> Self {
        match (sqlite_code(&error), error) {
            (Some(SQLITE_BUSY | SQLITE_LOCKED), _) => Self::Busy,
            (_, sqlx::Error::ColumnDecode { index, source }) => {
                Self::damaged(format!("column {index}"), source)
            }
            (_, error) => Self::Database(error),
        }
    }
}
