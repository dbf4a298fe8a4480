//! Database files: opening, migrations and statements; rescoring, pruning, copies and their inspection.

use crate::{Arena, new_run, phase};
use avln_challenge::{MethodInfo, Reference, RunChoice, Schedule, Visibility};
use avln_episode::Order;
use avln_scoring::{Key, Metrics};
use avln_store::{
    AuditNote, LeaderboardQuery, NewRun, Phase, Pruned, RowFilter, SCHEMA_VERSION, Store, StoreError, Viewer,
    copy_database, inspect_database,
};
use sqlx::{AssertSqlSafe, ConnectOptions, Connection, Executor, SqlSafeStr, sqlite::SqliteConnectOptions};
use std::{
    collections::BTreeMap,
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
    assert_eq!((run.team.as_str(), run.episodes, run.method.method_type), ("red", 1, None));
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
async fn version_0_1_database_renders_identical_pages() {
    let arena = Arena::new(&phase("practice", 3)).await;
    arena.play("run_1", "walker", Order::Unordered, 1).await;
    arena.play("run_2", "walker", Order::Unordered, 0).await;
    arena.play_as("blue", "run_3", "runner", Order::Unordered, 2).await;
    arena.store.verify_run("run_3", true, crate::note("verified"), 40).await.expect("a run");
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

/// Returns the metrics of another scorer, with halved ISR.
async fn halved(arena: &Arena, run: &str) -> BTreeMap<u32, Metrics> {
    let episodes = arena.store.scored_episodes(run).await.unwrap();
    assert!(episodes.iter().all(|episode| episode.facts.is_some()));
    let halve = |metrics: Metrics| Metrics { isr: metrics.isr / 2.0, ..metrics };
    episodes.into_iter().map(|episode| (episode.ordinal, halve(episode.metrics))).collect()
}

#[tokio::test]
async fn rescoring_keeps_first_scores() {
    let arena = Arena::new(&phase("practice", 4)).await;
    arena.play("run_1", "walker", Order::Unordered, 2).await;
    let reader = arena.store.reader();
    let before = reader.run(&Viewer::Anonymous, "run_1").await.unwrap().unwrap();
    let again = halved(&arena, "run_1").await;
    let compared = arena.store.rescore("run_1", "9.0.0", &again, false, 50).await.unwrap();
    assert!(!compared.is_new);
    assert_eq!(reader.run(&Viewer::Anonymous, "run_1").await.unwrap().unwrap(), before, "not stored");

    let kept = arena.store.rescore("run_1", "9.0.0", &again, true, 50).await.unwrap();
    let isr = |summary: &Option<avln_scoring::Summary>| summary.as_ref().unwrap().isr.value;
    assert_eq!((isr(&kept.before), isr(&kept.after), kept.is_new), (1.0, 0.5, true));
    let after = reader.run(&Viewer::Anonymous, "run_1").await.unwrap().unwrap();
    assert_eq!((&after.summary, &after.episodes), (&before.summary, &before.episodes));
    let listed: Vec<_> =
        after.rescores.iter().map(|rescore| (rescore.scorer.as_str(), isr(&rescore.summary))).collect();
    assert_eq!(listed, [("9.0.0", 0.5)]);

    assert!(!arena.store.rescore("run_1", "9.0.0", &again, true, 60).await.unwrap().is_new);
    let first: BTreeMap<_, _> = arena
        .store
        .scored_episodes("run_1")
        .await
        .unwrap()
        .into_iter()
        .map(|e| (e.ordinal, e.metrics))
        .collect();
    let refused = arena.store.rescore("run_1", "9.0.0", &first, true, 70).await.unwrap_err();
    assert!(matches!(refused, StoreError::ScoresDiffer { .. }), "{refused}");
    let refused = arena.store.rescore("run_1", "9.0.1", &BTreeMap::new(), true, 70).await.unwrap_err();
    assert!(refused.to_string().contains("4 episodes are scored, 0"), "{refused}");
}

#[tokio::test]
async fn rescores_are_as_visible_as_scores() {
    let mut hidden = phase("practice", 2);
    hidden.scores = Visibility::Organiser;
    let arena = Arena::new(&hidden).await;
    arena.play("run_1", "walker", Order::Unordered, 2).await;
    let again = halved(&arena, "run_1").await;
    arena.store.rescore("run_1", "9.0.0", &again, true, 50).await.unwrap();
    for (viewer, count) in [(Viewer::Team("red".to_owned()), 0), (Viewer::Organiser, 1)] {
        let view = arena.store.reader().run(&viewer, "run_1").await.unwrap().unwrap();
        assert_eq!(view.rescores.len(), count, "{viewer:?}");
    }
}

#[tokio::test]
async fn pruning_deletes_records_and_keeps_results() {
    let arena = Arena::new(&phase("practice", 4)).await;
    arena.play("run_1", "walker", Order::Unordered, 2).await;
    let reader = arena.store.reader();
    let view = async || reader.run(&Viewer::Anonymous, "run_1").await.unwrap().unwrap();
    let replay = async || reader.episode(&Viewer::Anonymous, "run_1", 0).await.unwrap().unwrap().replay;
    let before = view().await;
    assert!(replay().await.is_some());
    // Results of the fixture are stored at 30.
    assert_eq!(arena.store.runs_ended_before(30).await.unwrap(), Vec::<String>::new());
    assert_eq!(arena.store.prune_records(30, AuditNote::default(), 50).await.unwrap(), Pruned::default());
    assert_eq!(arena.store.newest_audit_id().await.unwrap(), 0, "no deletion, no audit line");

    assert_eq!(arena.store.runs_ended_before(31).await.unwrap(), ["run_1"]);
    assert_eq!(arena.store.old_records(31).await.unwrap(), 4);
    let note = AuditNote { what: "pruned".to_owned(), ..AuditNote::default() };
    let pruned = arena.store.prune_records(31, note, 50).await.unwrap();
    assert_eq!(pruned, Pruned { records: 4, truths: 4 });
    assert_eq!(view().await, before);
    assert_eq!(replay().await, None);
    assert_eq!(arena.store.audit().await.unwrap().len(), 1);
    let left = arena.store.scored_episodes("run_1").await.unwrap();
    assert!(left.len() == 4 && left.iter().all(|episode| episode.facts.is_none()));
}

#[tokio::test]
async fn open_runs_are_never_pruned() {
    let arena = Arena::new(&phase("practice", 2)).await;
    let digests = Default::default();
    arena.store.start_run(&new_run(&digests), 1).await.unwrap();
    assert_eq!(arena.store.runs_ended_before(i64::MAX).await.unwrap(), Vec::<String>::new());
}

#[tokio::test]
async fn copy_during_writes_is_consistent() {
    let arena = Arena::new(&phase("practice", 3)).await;
    arena.play("run_1", "walker", Order::Unordered, 2).await;
    arena.assign("run_1", "unused").await.ok_or(()).unwrap_err();
    let digests = Default::default();
    let method = MethodInfo::new("slow", "1");
    let new = NewRun { id: "run_2", token: "t", method: &method, ..new_run(&digests) };
    arena.store.start_run(&new, 40).await.unwrap();
    arena.assign("run_2", "ep_first").await.expect("an episode");
    let to = arena.folder.path().join("copy.db");
    copy_database(&arena.path(), &to).await.unwrap();
    arena.assign("run_2", "ep_later").await.expect("an episode");

    let inventory = inspect_database(&to).await.unwrap();
    assert_eq!((inventory.schema, inventory.teams, inventory.results), (SCHEMA_VERSION, 2, 3));
    assert_eq!(inventory.splits, ["val"]);
    let settled: Vec<_> = inventory.runs.iter().map(|run| (run.id.as_str(), run.is_settled)).collect();
    assert_eq!(settled, [("run_1", true), ("run_2", false)]);
    assert_eq!(inventory.runs[1].attempts, [(0, 1), (1, 0), (2, 0)].into());
    let copy = Store::open(&to).await.unwrap();
    let run = async |store: &Store| store.reader().run(&Viewer::Organiser, "run_1").await.unwrap();
    assert_eq!(run(&copy).await, run(&arena.store).await);
    let refused = copy_database(&arena.path(), &to).await.unwrap_err();
    assert!(matches!(refused, StoreError::CannotOpen { .. } | StoreError::Database(_)), "{refused}");
}

#[tokio::test]
async fn inspection_finds_damage_and_foreign_files() {
    let arena = Arena::new(&phase("practice", 40)).await;
    arena.play("run_1", "walker", Order::Unordered, 2).await;
    let to = arena.folder.path().join("copy.db");
    copy_database(&arena.path(), &to).await.unwrap();
    let mut bytes = fs::read(&to).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle..middle + 4096].fill(0xA5);
    fs::write(&to, bytes).unwrap();
    inspect_database(&to).await.expect_err("pages are damaged");
    fs::write(&to, "plain text instead of a database").unwrap();
    let refused = inspect_database(&to).await.unwrap_err();
    assert!(matches!(refused, StoreError::NotOurs { .. }), "{refused}");
}
