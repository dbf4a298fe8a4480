//! Files that cannot be opened.

use crate::fixture::{Arena, phase};
use avln_store::{SCHEMA_VERSION, Store, StoreError};
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
    store.create_team("red", true, 1).await.expect("a team");
    let second = Store::open(&path).await.expect("the same database");
    assert!(second.team("red").await.expect("an answer").expect("the team").baseline);
    assert!(matches!(second.create_team("red", false, 2).await, Err(StoreError::Taken { .. })));
    second.reader().ping().await.expect("a readable database");
}
