//! Checks of the server's log, the database and the run logs.

use crate::tally::Tally;
use sqlx::{Connection, SqliteConnection, sqlite::SqliteConnectOptions};
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::Command,
    time::Instant,
};

/// Most run logs to verify, because each is played again.
const MAX_VERIFIED: usize = 100;

/// The server's log, as far as it has been read.
#[derive(Debug)]
pub(crate) struct ServerLog {
    path: PathBuf,
    lines: usize,
}

impl ServerLog {
    pub(crate) fn new(folder: &Path) -> Self {
        Self { path: folder.join("server.log"), lines: 0 }
    }

    /// Records every new line: by default the log contains only warnings and errors.
    pub(crate) fn read(&mut self, tally: &Tally) {
        let text = fs::read_to_string(&self.path).unwrap_or_default();
        for line in text.lines().skip(self.lines) {
            tally.finding(&format!("server log: {line}"));
        }
        self.lines = text.lines().count();
    }
}

/// Rows with a run or an episode that is lost or counted twice.
const CONTRADICTIONS: &[(&str, &str)] = &[
    (
        "completed run with missing episodes",
        "SELECT id FROM runs WHERE state = 'completed' AND episodes != (SELECT COUNT(*) FROM episodes e \
         WHERE e.run = runs.id AND e.metrics IS NOT NULL)",
    ),
    (
        "run with a wrong number of scored episodes",
        "SELECT run FROM run_summaries s WHERE scored != (SELECT COUNT(*) FROM episodes e \
         WHERE e.run = s.run AND e.metrics IS NOT NULL)",
    ),
    (
        "scored episode without a record",
        "SELECT handle FROM episodes e WHERE metrics IS NOT NULL AND NOT EXISTS \
         (SELECT 1 FROM records r WHERE r.run = e.run AND r.ordinal = e.ordinal)",
    ),
];

/// Compares the database with the episodes that the agents saw end.
pub(crate) async fn check_database(folder: &Path, tally: &Tally) {
    let options = SqliteConnectOptions::new().filename(folder.join("avln.db"));
    let mut database = SqliteConnection::connect_with(&options).await.expect("the database");
    for (what, query) in CONTRADICTIONS.iter().copied() {
        let rows: Vec<String> = sqlx::query_scalar(query).fetch_all(&mut database).await.expect("rows");
        rows.iter().for_each(|row| tally.finding(&format!("{what}: {row}")));
    }
    let query = "SELECT handle, json_extract(metrics, '$.steps') FROM episodes WHERE metrics IS NOT NULL";
    let rows: Vec<(String, i64)> = sqlx::query_as(query).fetch_all(&mut database).await.expect("rows");
    let stored: BTreeMap<_, _> = rows.into_iter().collect();
    let ended = tally.ended();
    for (handle, steps) in &ended {
        match stored.get(handle) {
            Some(scored) if *scored == i64::from(*steps) => {}
            other => tally.finding(&format!("episode {handle} ended after {steps} steps; stored: {other:?}")),
        }
    }
    let unseen = stored.keys().filter(|handle| !ended.contains_key(*handle)).count();
    println!("{} episodes stored, {} of them seen by agents to the end", stored.len(), stored.len() - unseen);
}

/// Verifies run logs with the program, evenly chosen if there are many.
pub(crate) fn verify_logs(program: &str, folder: &Path, tally: &Tally) {
    let completed = tally.completed();
    let chosen: Vec<_> = completed.iter().step_by(completed.len().div_ceil(MAX_VERIFIED).max(1)).collect();
    let begun = Instant::now();
    for run in &chosen {
        let log = folder.join("runs").join(format!("{run}.log"));
        let mut verify = Command::new(program);
        verify.arg("--data").arg(folder).args(["run", "verify"]).arg(log);
        let output = verify.output().expect("the program runs");
        if !output.status.success() {
            tally.finding(&format!("log of {run}: {}", String::from_utf8_lossy(&output.stderr)));
        }
    }
    println!("{} of {} logs verified in {:.0?}", chosen.len(), completed.len(), begun.elapsed());
}
