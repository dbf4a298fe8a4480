//! Files that cannot be opened.

use crate::fixture::{Arena, phase};
use avln_store::{Phase, Reference, SCHEMA_VERSION, Schedule, Store, StoreError};
use sqlx::{ConnectOptions, Connection, sqlite::SqliteConnectOptions};
use std::path::Path;

async fn execute(path: &Path, sql: &'static str) {
    let options = SqliteConnectOptions::new().filename(path).create_if_missing(true);
    let mut connection = options.connect().await.expect("a connection");
    sqlx::raw_sql(sql).execute(&mut connection).await.expect("the statement");
    connection.close().await.expect("a clean end");
}

#[tokio::test]
async fn a_database_from_a_newer_version_is_refused_untouched() {
    let arena = Arena::new(&phase("practice", 1)).await;
    let path = arena.path();
    arena.store.close().await;
    let insert = "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time) \
                  VALUES (99, 'later', 1, x'00', 0)";
    execute(&path, insert).await;
    let error = Store::open(&path).await.expect_err("version 99 is not known");
    assert!(matches!(error, StoreError::Newer { found: 99, known: SCHEMA_VERSION, .. }), "{error}");
    assert!(error.to_string().contains("newer program"), "{error}");
}

#[tokio::test]
async fn files_of_others_are_refused_untouched() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = folder.path().join("letter.db");
    std::fs::write(&text, "Dear reader, this is not a database at all. ".repeat(100)).expect("a file");
    let foreign = folder.path().join("foreign.db");
    execute(&foreign, "CREATE TABLE recipes (name TEXT)").await;
    for path in [&text, &foreign] {
        let before = std::fs::read(path).expect("the file");
        let error = Store::open(path).await.expect_err("not ours");
        assert!(matches!(error, StoreError::NotOurs { .. }), "{error}");
        assert_eq!(std::fs::read(path).expect("the file"), before);
    }
}

#[tokio::test]
async fn a_place_where_no_file_can_be_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    for path in [folder.path().join("missing/arena.db"), folder.path().to_owned()] {
        let error = Store::open(&path).await.expect_err("no file can be made there");
        assert!(matches!(error, StoreError::CannotOpen { .. }), "{error}");
        assert!(error.to_string().contains(&path.display().to_string()), "{error}");
    }
}

#[tokio::test]
async fn an_empty_file_becomes_a_database_and_a_second_opening_finds_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("arena.db");
    std::fs::write(&path, "").expect("a file");
    let store = Store::open(&path).await.expect("a database");
    store.create_team("red", Some(Reference::Baseline), 1).await.expect("a team");
    let second = Store::open(&path).await.expect("the same database");
    assert!(second.team("red").await.expect("an answer").expect("the team").reference.is_some());
    assert!(matches!(second.create_team("red", None, 2).await, Err(StoreError::Taken { .. })));
    second.reader().ping().await.expect("a readable database");
}

#[tokio::test]
async fn a_database_of_the_first_schema_keeps_its_runs_tokens_and_quotas() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("arena.db");
    execute(&path, include_str!("../../../../../migrations/0001_first.sql")).await;
    let rules = serde_json::to_string(&avln_episode::Rules::paper()).expect("JSON");
    let sensors = serde_json::to_string(&avln_episode::Sensors::all(64, 64)).expect("JSON");
    let rows = format!(
        "INSERT INTO teams VALUES ('red', 0, 1); INSERT INTO splits VALUES ('val', 'd', 1, 1);
         INSERT INTO scenes VALUES ('hall', 'd', '{{\"min\":[0,0,0],\"max\":[0,0,0],\"polygons\":[]}}');
         INSERT INTO phases VALUES ('p', 'P', 'val', 'lh-avln-v1', '{rules}', '[\"ordered\"]', '{sensors}', 'team', 'team', 1, 7, 'closed', 1);
         INSERT INTO runs (id, phase, team, method, version, mission_order, state, episodes, digests, created_ms)
           VALUES ('run_1', 'p', 'red', 'm', '1', 'ordered', 'created', 1, '{{}}', 1);
         INSERT INTO run_summaries (run) VALUES ('run_1');
         INSERT INTO episodes (run, ordinal, episode, scene, state) VALUES ('run_1', 0, 'e', 'hall', 'pending');
         INSERT INTO tokens VALUES ('hash', 'prefix', 'run', 'red', 'run_1', 1, NULL, NULL);
         CREATE TABLE _sqlx_migrations (version BIGINT PRIMARY KEY, description TEXT NOT NULL, installed_on TIMESTAMP NOT NULL
           DEFAULT CURRENT_TIMESTAMP, success BOOLEAN NOT NULL, checksum BLOB NOT NULL, execution_time BIGINT NOT NULL);"
    );
    execute_text(&path, rows).await;
    mark_first(&path).await;
    let store = Store::open(&path).await.expect("an older database");
    let phase = store.phase("p").await.expect("the phase");
    assert_eq!((phase.quotas.total, phase.schedule.closed, phase.quotas.day), (Some(7), true, None));
    let run = store.run("run_1").await.expect("the run");
    assert_eq!((run.team.as_str(), run.episodes), ("red", 1));
    assert!(run.is_overdue(2), "it has no wall time, and its phase is closed");
    store.upsert_phase(&Phase { schedule: Schedule::default(), ..phase }, 2).await.expect("open again");
    assert!(store.assign_next_episode("run_1", "h", 2).await.expect("an open run").is_some());
    assert_eq!(store.revoke_tokens("red", 3).await.expect("tokens"), 1);
}

async fn execute_text(path: &Path, sql: String) {
    let mut connection = SqliteConnectOptions::new().filename(path).connect().await.expect("a connection");
    sqlx::raw_sql(sqlx::AssertSqlSafe(sql)).execute(&mut connection).await.expect("the statement");
    connection.close().await.expect("a clean end");
}

/// Notes the first migration as done, as the program of then did.
async fn mark_first(path: &Path) {
    let fresh = tempfile::tempdir().expect("a folder");
    let other = fresh.path().join("fresh.db");
    Store::open(&other).await.expect("a database").close().await;
    let attach = format!(
        "ATTACH '{}' AS fresh; INSERT INTO _sqlx_migrations SELECT * FROM fresh._sqlx_migrations WHERE version = 1",
        other.display()
    );
    execute_text(path, attach).await;
}
