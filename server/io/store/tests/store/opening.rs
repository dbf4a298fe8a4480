//! Opening of files: new, foreign, newer and older ones; migrations and statements.

use crate::fixture::{Arena, phase};
use avln_challenge::{Reference, RunChoice, Schedule};
use avln_episode::Order;
use avln_scoring::Key;
use avln_store::{LeaderboardQuery, Phase, RowFilter, SCHEMA_VERSION, Store, StoreError, Viewer};
use sqlx::{AssertSqlSafe, ConnectOptions, Connection, Executor, SqlSafeStr, sqlite::SqliteConnectOptions};
use std::{
    fs,
    path::{Path, PathBuf},
};

async fn execute(path: &Path, sql: impl Into<String>) {
    let options = SqliteConnectOptions::new().filename(path).create_if_missing(true);
    let mut connection = options.connect().await.expect("a connection");
    sqlx::raw_sql(AssertSqlSafe(sql.into())).execute(&mut connection).await.expect("the statement");
    connection.close().await.expect("a clean end");
}

/// Returns name and text of each migration, in order.
fn migrations() -> Vec<(String, String)> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../migrations");
    let entries = fs::read_dir(folder).expect("the migrations folder");
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.expect("an entry").path()).collect();
    paths.sort();
    let read = |path: &PathBuf| {
        let name = path.file_name().expect("a name").to_string_lossy().into_owned();
        (name, fs::read_to_string(path).expect("a migration"))
    };
    paths.iter().map(read).collect()
}

/// Creates a database with the first `count` migrations.
async fn create_old(path: &Path, count: usize) {
    execute(
        path,
        "CREATE TABLE _sqlx_migrations (version BIGINT PRIMARY KEY, description TEXT NOT NULL, installed_on TIMESTAMP NOT NULL
         DEFAULT CURRENT_TIMESTAMP, success BOOLEAN NOT NULL, checksum BLOB NOT NULL, execution_time BIGINT NOT NULL);",
    )
    .await;
    for (_, sql) in migrations().into_iter().take(count) {
        execute(path, sql).await;
    }
    let fresh = tempfile::tempdir().expect("a folder");
    let other = fresh.path().join("fresh.db");
    Store::open(&other).await.expect("a database").close().await;
    let attach = format!(
        "ATTACH '{}' AS fresh; INSERT INTO _sqlx_migrations SELECT * FROM fresh._sqlx_migrations WHERE version <= {count}",
        other.display()
    );
    execute(path, attach).await;
}

#[tokio::test]
async fn newer_database_is_rejected() {
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
async fn foreign_files_are_rejected_unchanged() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = folder.path().join("text.db");
    std::fs::write(&text, "This text file is not a database. ".repeat(100)).expect("a file");
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
async fn unusable_paths_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    for path in [folder.path().join("missing/arena.db"), folder.path().to_owned()] {
        let error = Store::open(&path).await.expect_err("no file can be made there");
        assert!(matches!(error, StoreError::CannotOpen { .. }), "{error}");
        assert!(error.to_string().contains(&path.display().to_string()), "{error}");
    }
}

#[tokio::test]
async fn empty_file_becomes_database() {
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
async fn first_schema_keeps_runs_tokens_and_quotas() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("arena.db");
    create_old(&path, 1).await;
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
         INSERT INTO tokens VALUES ('hash', 'prefix', 'run', 'red', 'run_1', 1, NULL, NULL);"
    );
    execute(&path, rows).await;
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

/// Rows of version 0.1, copied from a database of today; its columns without a reader are filled from the JSON.
const FILL_VERSION_0_1: &str = "
    INSERT INTO teams (name, created_ms, reference) SELECT name, created_ms, reference FROM new.teams;
    INSERT INTO splits SELECT * FROM new.splits;
    INSERT INTO scenes SELECT * FROM new.scenes;
    INSERT INTO phases (id, title, split, rules_name, rules, orders, sensors, scores, replays, max_slots, state, created_ms)
      SELECT id, title, split, rules ->> '$.name', rules, orders, sensors, scores, replays, max_slots, state, created_ms FROM new.phases;
    INSERT INTO phase_episodes SELECT * FROM new.phase_episodes;
    INSERT INTO runs (id, phase, team, method, version, mission_order, state, episodes, sensors, senses, digests, created_ms, finished_ms)
      SELECT id, phase, team, method, version, mission_order, state, episodes, sensors, senses, digests, created_ms, finished_ms FROM new.runs;
    INSERT INTO tokens (hash, prefix, kind, name, team, run, created_ms) SELECT hash, 'run_1', kind, name, team, run, created_ms FROM new.tokens;
    INSERT INTO episodes (run, ordinal, episode, scene, state, attempts, interruptions, handle, end_reason, metrics, time_account,
      started_ms, finished_ms, goals, found, sr, isr, osr, osr_all, spl, soft_spl, sna, steps, path_m, reference_m, collisions, wrong_submits)
      SELECT run, ordinal, episode, scene, state, attempts, interruptions, handle, end_reason, metrics, time_account, started_ms,
      finished_ms, metrics ->> '$.goals', metrics ->> '$.found', metrics ->> '$.sr', metrics ->> '$.isr', metrics ->> '$.osr',
      metrics ->> '$.osr_all', metrics ->> '$.spl', metrics ->> '$.soft_spl', metrics ->> '$.sna', metrics ->> '$.steps',
      metrics ->> '$.path_m', metrics ->> '$.reference_m', metrics ->> '$.collisions', metrics ->> '$.wrong_submits' FROM new.episodes;
    INSERT INTO truths SELECT * FROM new.truths;
    INSERT INTO records SELECT * FROM new.records;
    INSERT INTO run_summaries (run, scored, given_up, isr, category_goals, category_found, description_goals, description_found,
      image_goals, image_found, server_faults, summary, goals, found, sr, osr, spl, soft_spl, steps)
      SELECT run, scored, given_up, isr, category_goals, category_found, description_goals, description_found, image_goals,
      image_found, server_faults, summary, 2 * scored, scored, 0, 0.5, 0.25, 0.25, 6 * scored FROM new.run_summaries;
    INSERT INTO rulings SELECT * FROM new.rulings;";

/// Returns all pages with scores, as JSON.
async fn pages(store: &Store) -> String {
    let reader = store.reader();
    let query = LeaderboardQuery {
        phase: "practice",
        order: Order::Unordered,
        key: Key::SoftSpl,
        pick: RunChoice::Best,
        as_of_unix_ms: None,
        now_unix_ms: 100,
        filter: RowFilter::default(),
    };
    let viewer = Viewer::Anonymous;
    let leaderboard = reader.leaderboard(&viewer, &query).await.expect("an answer").expect("the phase");
    assert_eq!(leaderboard.rows.len(), 2);
    let pages = [
        serde_json::to_string(&leaderboard),
        serde_json::to_string(&reader.runs(&viewer, None, 9).await.expect("runs")),
        serde_json::to_string(&reader.run(&viewer, "run_1").await.expect("a run")),
        serde_json::to_string(&reader.episode(&viewer, "run_1", 1).await.expect("an episode")),
        serde_json::to_string(&reader.missions(&viewer, "practice").await.expect("missions")),
    ];
    pages.into_iter().map(|page| page.expect("JSON")).collect()
}

#[tokio::test]
async fn version_0_1_database_gives_same_pages() {
    let arena = Arena::new(&phase("practice", 3)).await;
    arena.play("run_1", "walker", Order::Unordered, 1).await;
    arena.play("run_2", "walker", Order::Unordered, 0).await;
    arena.play_as("blue", "run_3", "runner", Order::Unordered, 2).await;
    arena.store.verify_run("run_3", true, crate::fixture::note("verified"), 40).await.expect("a run");
    let path = arena.folder.path().join("old.db");
    create_old(&path, 8).await;
    execute(&path, format!("ATTACH '{}' AS new; {FILL_VERSION_0_1}", arena.path().display())).await;
    let upgraded = Store::open(&path).await.expect("a database of version 0.1");
    assert_eq!(pages(&upgraded).await, pages(&arena.store).await);
    let (old, new) = (upgraded.scored_episodes("run_1").await, arena.store.scored_episodes("run_1").await);
    assert_eq!(old.expect("facts"), new.expect("facts"));
    assert!(upgraded.charge("run_1").await.expect("a charge").charged);
}

#[test]
fn schema_version_is_number_of_migrations() {
    assert_eq!(migrations().len() as i64, SCHEMA_VERSION);
}

#[test]
fn every_table_and_column_has_a_comment() {
    for (name, sql) in migrations() {
        let mut above = "";
        for line in sql.lines() {
            if line.starts_with("CREATE TABLE") && !line.contains("_kept") {
                assert!(above.starts_with("-- "), "{name}: '{line}' has no comment above");
            }
            let word = line.strip_prefix("  ").and_then(|rest| rest.split_whitespace().next()).unwrap_or("");
            if word.starts_with(|first: char| first.is_ascii_lowercase()) {
                assert!(line.contains(" -- "), "{name}: column {word} has no comment");
            }
            above = line;
        }
    }
}

/// Returns the string literals of Rust source text, unescaped. Comments and raw strings are not special: the crate's contain no
/// SQL.
fn literals(source: &str) -> Vec<String> {
    let mut literals = Vec::new();
    let mut rest = source;
    while let Some(start) = rest.find('"') {
        let mut text = String::new();
        let mut chars = rest[start + 1..].char_indices();
        let mut end = rest.len();
        while let Some((at, char)) = chars.next() {
            match char {
                '"' => {
                    end = start + 1 + at + 1;
                    break;
                }
                // A backslash at the end of a line continues the literal after the indentation.
                '\\' if chars.as_str().starts_with('\n') => {
                    let indentation = chars.as_str().len() - chars.as_str().trim_start().len();
                    for _ in 0..indentation {
                        chars.next();
                    }
                }
                '\\' => text.extend(chars.next().map(|(_, escaped)| escaped)),
                char => text.push(char),
            }
        }
        literals.push(text);
        rest = &rest[end..];
    }
    literals
}

fn sources(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path());
    entries.flat_map(|path| if path.is_dir() { sources(&path) } else { vec![path] }).collect()
}

#[tokio::test]
async fn statements_fit_the_schema() {
    let arena = Arena::new(&phase("practice", 1)).await;
    let mut connection =
        SqliteConnectOptions::new().filename(arena.path()).connect().await.expect("a connection");
    let mut count = 0;
    for path in sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src")) {
        let source = fs::read_to_string(&path).expect("a source file");
        for literal in literals(&source) {
            let is_statement = ["SELECT ", "INSERT ", "UPDATE ", "DELETE ", "VACUUM "]
                .iter()
                .any(|verb| literal.starts_with(verb));
            if is_statement {
                let prepared = connection.prepare(AssertSqlSafe(literal.clone()).into_sql_str()).await;
                prepared.unwrap_or_else(|error| panic!("{}: {literal}: {error}", path.display()));
                count += 1;
            }
        }
    }
    assert!(count > 80, "only {count} statements were found");
    connection
        .prepare(AssertSqlSafe("SELECT wrong FROM runs").into_sql_str())
        .await
        .expect_err("no such column");
}
