use avln_challenge::calendar::rfc3339;
use avln_challenge::{Quota, QuotaWindow, UnknownWord};
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
    /// The phase takes no runs yet.
    #[error("phase '{phase}' opens at {}; choose an open phase, or come back then", rfc3339(*opens_unix_ms))]
    PhaseNotOpen {
        /// The phase.
        phase: String,
        /// When it opens, milliseconds since 1970-01-01 UTC.
        opens_unix_ms: i64,
    },
    /// The phase takes runs from the organiser alone.
    #[error(
        "phase '{0}' is played in sealed runs only, which its organiser starts: send the agent to the organiser"
    )]
    PhaseSealed(String),
    /// The phase takes no runs for now.
    #[error("phase '{phase}' is paused: {reason}; runs that were started may go on")]
    PhasePaused {
        /// The phase.
        phase: String,
        /// Why.
        reason: String,
    },
    /// The phase is not over, so that its secret stays one.
    #[error(
        "phase '{0}' is not closed; close it with avln challenge phase close, or wait for its closing date"
    )]
    NotClosed(String),
    /// Runs of the phase go on, so that its secret stays one.
    #[error("phase '{phase}' is still played by runs that began in time, until {} at the latest; reveal it then", rfc3339(*until_unix_ms))]
    StillPlayed {
        /// The phase.
        phase: String,
        /// When the last of them ends at the latest, milliseconds since 1970-01-01 UTC.
        until_unix_ms: i64,
    },
    /// The phase is for other teams' eyes.
    #[error(
        "phase '{phase}' is not for team '{team}'; ask the organiser, or choose a phase that ListPhases tells"
    )]
    PhaseNotVisible {
        /// The phase.
        phase: String,
        /// The team.
        team: String,
    },
    /// The team may not play in the phase.
    #[error("team '{team}' may not play in phase '{phase}': {why}; ask the organiser")]
    TeamNotApproved {
        /// The phase.
        phase: String,
        /// The team.
        team: String,
        /// Why not.
        why: &'static str,
    },
    /// A person can be in one team of a phase.
    #[error("'{person}' is in team '{team}' of phase '{phase}'; take the person out there first")]
    InAnotherTeam {
        /// The person.
        person: String,
        /// The phase.
        phase: String,
        /// The other team.
        team: String,
    },
    /// The phase is not played in this order.
    #[error("phase '{phase}' is not played {order}; choose the other order")]
    OrderNotAllowed {
        /// The phase.
        phase: String,
        /// The order asked for.
        order: &'static str,
    },
    /// The team has no run left.
    #[error("{}", used_up(.0))]
    QuotaUsed(Box<Quota>),
    /// One version of the benchmark said two things.
    #[error(
        "run '{run}' was scored again by benchmark {scorer} before, and otherwise than now; that program was not this one"
    )]
    ScoresDiffer {
        /// The run.
        run: String,
        /// Version of the benchmark.
        scorer: String,
    },
    /// The run is over.
    #[error("run '{run}' is {state}; start another run")]
    RunOver {
        /// The run.
        run: String,
        /// Its state.
        state: &'static str,
    },
    /// Only a run that is over can be verified.
    #[error("run '{0}' is not over; verify it when it is")]
    RunOpen(String),
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

    /// Whether the database failed, rather than refused what somebody asked for.
    pub fn is_fault(&self) -> bool {
        let files = matches!(
            self,
            Self::CannotOpen { .. } | Self::NotOurs { .. } | Self::Newer { .. } | Self::Migration { .. }
        );
        files || matches!(self, Self::Busy | Self::Damaged { .. } | Self::Database(_))
    }

    pub(crate) fn damaged(what: &'static str, reason: impl ToString) -> Self {
        Self::Damaged { what, reason: reason.to_string() }
    }
}

/// Which quota is used up, and what helps.
fn used_up(quota: &Quota) -> String {
    let (limit, phase) = (quota.limit.unwrap_or_default(), &quota.phase);
    let what = match quota.window {
        QuotaWindow::Day => format!("all {limit} runs of this day (UTC)"),
        QuotaWindow::Month => format!("all {limit} runs of this month (UTC)"),
        QuotaWindow::Total => format!("all {limit} runs of the phase"),
        QuotaWindow::Concurrent => {
            return format!(
                "the team has {limit} runs open in phase '{phase}', the most at a time; finish or cancel one"
            );
        }
        QuotaWindow::Uncharged => format!("all {limit} runs of the phase that may end without being charged"),
    };
    let helps = match quota.next_increase_unix_ms {
        Some(moment) => format!("the next can start at {}", rfc3339(moment)),
        None => "the organiser can grant more".to_owned(),
    };
    format!("the team has used {what} '{phase}'; {helps}")
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

impl From<UnknownWord> for StoreError {
    fn from(error: UnknownWord) -> Self {
        Self::damaged(error.kind, format!("unknown word '{}'", error.word))
    }
}
