//! The database as a witness: rows without the store's own code, and statements that fail on request.

use sqlx::{Connection, FromRow, SqliteConnection, sqlite::SqliteConnectOptions};
use std::path::Path;

/// A connection beside those of the store.
pub(crate) struct Database(SqliteConnection);

/// A run.
#[derive(Clone, Debug, FromRow)]
pub(crate) struct RunRow {
    pub(crate) id: String,
    pub(crate) phase: String,
    pub(crate) team: String,
    pub(crate) state: String,
    pub(crate) created_ms: i64,
    pub(crate) finished_ms: Option<i64>,
    pub(crate) episodes: u32,
    pub(crate) scored: u32,
    pub(crate) given_up: u32,
    pub(crate) server_faults: u32,
}

impl RunRow {
    pub(crate) fn is_open(&self) -> bool {
        matches!(self.state.as_str(), "created" | "running")
    }
}

/// An episode of a run.
#[derive(Clone, Debug, FromRow)]
pub(crate) struct EpisodeRow {
    pub(crate) run: String,
    pub(crate) state: String,
    pub(crate) handle: Option<String>,
    pub(crate) attempts: u32,
    pub(crate) interruptions: u32,
    pub(crate) end_reason: Option<String>,
    /// Steps of the score; `None` without a score.
    pub(crate) steps: Option<u32>,
    pub(crate) has_record: bool,
}

impl EpisodeRow {
    pub(crate) fn is_scored(&self) -> bool {
        matches!(self.state.as_str(), "terminated" | "truncated")
    }
}

/// A phase's schedule, and the runs granted in it.
#[derive(Clone, Debug, FromRow)]
pub(crate) struct PhaseRow {
    pub(crate) id: String,
    pub(crate) state: String,
    pub(crate) closes_ms: Option<i64>,
    pub(crate) paused: Option<String>,
}

#[derive(Clone, Debug, FromRow)]
pub(crate) struct GrantRow {
    pub(crate) phase: String,
    pub(crate) team: String,
    pub(crate) runs: u32,
    pub(crate) granted_ms: i64,
}

/// All rows that the properties concern.
#[derive(Clone, Debug)]
pub(crate) struct Rows {
    pub(crate) phases: Vec<PhaseRow>,
    pub(crate) grants: Vec<GrantRow>,
    pub(crate) runs: Vec<RunRow>,
    pub(crate) episodes: Vec<EpisodeRow>,
}

impl Rows {
    /// Returns the episodes of a run.
    pub(crate) fn episodes_of(&self, run: &str) -> &[EpisodeRow] {
        let from = self.episodes.partition_point(|episode| episode.run.as_str() < run);
        let of_run = &self.episodes[from..];
        &of_run[..of_run.partition_point(|episode| episode.run == run)]
    }
}

/// A team and a phase; `None` for all.
pub(crate) type Selection<'a> = Option<(&'a str, &'a str)>;

/// Statements that can fail, by number from 1.
const FRAGILE: [&str; 4] = ["UPDATE ON episodes", "UPDATE ON runs", "INSERT ON records", "INSERT ON tokens"];
pub(crate) const FRAGILE_STATEMENTS: usize = FRAGILE.len();

impl Database {
    pub(crate) async fn open(path: &Path) -> Self {
        let options = SqliteConnectOptions::new().filename(path);
        Self(SqliteConnection::connect_with(&options).await.expect("the database"))
    }

    pub(crate) async fn close(self) {
        self.0.close().await.expect("the database closes");
    }

    /// Prepares the failure of statements.
    pub(crate) async fn prepare(mut self) {
        self.run("CREATE TABLE simulated_failures (statement INTEGER NOT NULL)").await;
        self.run("INSERT INTO simulated_failures VALUES (0)").await;
        for (number, statement) in (1..).zip(FRAGILE) {
            self.run(&format!(
                "CREATE TRIGGER simulated_failure_{number} BEFORE {statement} \
                 WHEN (SELECT statement FROM simulated_failures) = {number} \
                 BEGIN SELECT RAISE(ABORT, 'simulated failure'); END"
            ))
            .await;
        }
        self.close().await;
    }

    /// Lets a statement fail from now on, by its number; 0 for none.
    pub(crate) async fn fail(&mut self, statement: usize) {
        self.run(&format!("UPDATE simulated_failures SET statement = {statement}")).await;
    }

    async fn run(&mut self, statement: &str) {
        let statement = sqlx::AssertSqlSafe(statement.to_owned());
        sqlx::query(statement).execute(&mut self.0).await.expect("the database works");
    }

    async fn all<T>(&mut self, select: &'static str, of: Selection<'_>) -> Vec<T>
    where
        T: for<'r> FromRow<'r, sqlx::sqlite::SqliteRow> + Send + Unpin,
    {
        let (team, phase) = of.unzip();
        let rows = sqlx::query_as(select).bind(team).bind(phase).fetch_all(&mut self.0).await;
        rows.expect("the database works")
    }

    /// Returns the episodes of the selected runs.
    pub(crate) async fn episodes(&mut self, of: Selection<'_>) -> Vec<EpisodeRow> {
        let select = "SELECT e.run, e.state, e.handle, e.attempts, e.interruptions, e.end_reason, \
                      json_extract(e.metrics, '$.steps') AS steps, r.run IS NOT NULL AS has_record \
                      FROM runs JOIN episodes e ON e.run = runs.id \
                      LEFT JOIN records r ON r.run = e.run AND r.ordinal = e.ordinal \
                      WHERE ($1 IS NULL OR runs.team = $1) AND ($2 IS NULL OR runs.phase = $2) \
                      ORDER BY e.run, e.ordinal";
        self.all(select, of).await
    }

    /// Returns the rows of a team in a phase, or all.
    pub(crate) async fn rows(&mut self, of: Selection<'_>) -> Rows {
        let phases = "SELECT id, state, closes_ms, paused FROM phases ORDER BY id";
        let grants = "SELECT phase, team, runs, granted_ms FROM grants \
                      WHERE ($1 IS NULL OR team = $1) AND ($2 IS NULL OR phase = $2) ORDER BY id";
        let runs = "SELECT id, phase, team, state, created_ms, finished_ms, episodes, scored, given_up, server_faults \
                    FROM runs JOIN run_summaries ON run = id \
                    WHERE ($1 IS NULL OR team = $1) AND ($2 IS NULL OR phase = $2) ORDER BY id";
        Rows {
            phases: self.all(phases, None).await,
            grants: self.all(grants, of).await,
            runs: self.all(runs, of).await,
            episodes: self.episodes(of).await,
        }
    }
}
