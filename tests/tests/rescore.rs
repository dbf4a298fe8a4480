//! Runs are scored again from what was recorded: by the same scorer to the same bits, by another beside the first.

use avln_arena::{
    data::DataFolder,
    rescoring::{Scorer, rescore},
};
use avln_store::Store;
use avln_tests::{PHASE, TestServer, TestSetup, http, scripted_run::play_script};
use std::{path::Path, process::Command};

/// What `avln run rescore` says, and its exit code.
fn avln_rescore(folder: &Path, arguments: &[&str]) -> (Option<i32>, String) {
    let mut avln = Command::new(env!("CARGO_BIN_EXE_avln_under_test"));
    let output = avln
        .arg("--data")
        .arg(folder)
        .args(["run", "rescore"])
        .args(arguments)
        .output()
        .expect("the program runs");
    let text =
        String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    (output.status.code(), text)
}

/// Another scorer: nothing is ever found, and a wall counts twice.
const STRICT: Scorer = Scorer {
    version: "9.0.0",
    score: |truth, record, rules| {
        let mut metrics = (Scorer::OURS.score)(truth, record, rules);
        metrics.collisions *= 2;
        metrics
    },
};

async fn store(house: &TestServer) -> Store {
    DataFolder::open(house.folder.path()).expect("the folder").store().await.expect("its database")
}

#[tokio::test(flavor = "multi_thread")]
async fn the_same_scorer_says_the_same_and_another_is_kept_beside_it() {
    let house = TestServer::open(&TestSetup::default()).await;
    let run = play_script(&house.agents_url(), &house.token, "walker").await;
    let folder = house.folder.path();
    for arguments in [&[run.as_str()][..], &["--phase", PHASE]] {
        let (code, text) = avln_rescore(folder, arguments);
        assert_eq!(code, Some(0), "{text}");
        assert!(text.contains("nothing changed") && text.contains("1 run scored by benchmark"), "{text}");
    }
    let (code, json) = avln_rescore(folder, &[&run, "--json"]);
    let told: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!((code, &told[0]["is_kept"], &told[0]["episodes"]), (Some(0), &false.into(), &2.into()));

    let page = async |path: &str| http::get(house.doors.web, path).await.body;
    let board = page(&format!("/api/v1/phases/{PHASE}/leaderboard?order=unordered")).await;
    let store = store(&house).await;
    let row = store.run(&run).await.expect("the run");
    let compared = rescore(&store, &row, &STRICT, 77).await.expect("records");
    assert!(compared.is_kept && !compared.contradicts());
    let (before, after) = (compared.before.expect("a summary"), compared.after.expect("a summary"));
    assert!(before.collisions > 0.0, "the scripted run collides");
    assert_eq!(after.collisions, 2.0 * before.collisions);
    assert_eq!(after.sr, before.sr);
    assert_eq!(
        page(&format!("/api/v1/phases/{PHASE}/leaderboard?order=unordered")).await,
        board,
        "boards show the first scores"
    );
    assert!(board.contains(&format!("\"scorer\":\"{}\"", row.scorer())), "{board}");
    let shown = page(&format!("/runs/{run}")).await;
    assert!(shown.contains("Rescoring") && shown.contains("9.0.0"), "{shown}");
    assert!(page(&format!("/leaderboard/{PHASE}?order=unordered")).await.contains("Scored by benchmark"));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_version_that_says_two_things_and_a_run_without_records_are_told() {
    let house = TestServer::open(&TestSetup::default()).await;
    let run = play_script(&house.agents_url(), &house.token, "walker").await;
    let store = store(&house).await;
    let row = store.run(&run).await.expect("the run");
    let forged = Scorer { version: Scorer::OURS.version, ..STRICT };
    let compared = rescore(&store, &row, &forged, 77).await.expect("records");
    assert!(compared.contradicts() && !compared.is_kept && !compared.changed.is_empty());

    let (code, text) = avln_rescore(house.folder.path(), &["run_of_nobody"]);
    assert!(code == Some(3) && text.contains("run_of_nobody"), "{text}");
    let (code, text) = avln_rescore(house.folder.path(), &[]);
    assert!(code == Some(2) && text.contains("--phase"), "{text}");
    let note = avln_store::AuditNote::default();
    store.prune_records(i64::MAX, note, 78).await.expect("records go");
    let (code, text) = avln_rescore(house.folder.path(), &[&run]);
    assert!(code == Some(3) && text.contains("2 episode records"), "{text}");
}
