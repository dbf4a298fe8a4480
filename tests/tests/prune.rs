//! Logs and records of old runs can go; what the runs were worth stays.

use avln_arena::{
    backup::{self, PruneOptions, Pruned},
    now_unix_ms,
};
use avln_tests::{PHASE, TestServer, TestSetup, http, scripted_run::play_script};
use std::process::Command;

#[tokio::test(flavor = "multi_thread")]
async fn old_logs_and_records_go_and_scores_stay() {
    let house = TestServer::open(&TestSetup::default()).await;
    let run = play_script(&house.agents_url(), &house.token, "walker").await;
    let log = house.folder.path().join("runs").join(format!("{run}.log"));
    let page = async |path: &str| http::get(house.doors.web, path).await;
    let board = page(&format!("/api/v1/phases/{PHASE}/leaderboard?order=unordered")).await.body;
    let prune = |more: &[&str]| {
        let mut avln = Command::new(env!("CARGO_BIN_EXE_avln_under_test"));
        let output =
            avln.arg("--data").arg(house.folder.path()).args(["data", "db", "prune"]).args(more).output();
        let output = output.expect("the program runs");
        let text =
            String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
        (output.status.code(), text)
    };
    let (code, text) = prune(&["--older-than", "1d", "--records"]);
    assert!(code == Some(0) && text.contains("0 runs ended before"), "{text}");
    assert!(log.exists(), "it is not a day old");
    assert_eq!(prune(&["--older-than", "yesterday"]).0, Some(2));

    // As it is in two days.
    let later = now_unix_ms() + 2 * 86_400_000;
    let prune = async |records, dry_run| {
        let options = PruneOptions { older_than_days: 1, records, dry_run };
        backup::prune(house.folder.path(), &options, later).await.expect("it can go")
    };
    let trial = prune(true, true).await;
    assert_eq!((trial.runs, trial.logs, trial.records), (1, 1, 2));
    assert!(log.exists() && trial.bytes == log.metadata().expect("a log").len(), "nothing went");
    assert_eq!(prune(false, false).await, Pruned { records: 0, ..trial });
    assert!(!log.exists());
    assert_eq!(page(&format!("/api/v1/runs/{run}/log")).await.status, 404);
    assert_eq!(prune(true, false).await, Pruned { logs: 0, bytes: 0, ..trial });
    let after = page(&format!("/api/v1/phases/{PHASE}/leaderboard?order=unordered")).await.body;
    assert_eq!(after, board);
    assert_eq!(page(&format!("/runs/{run}/episodes/0")).await.status, 200, "without a replay");
}
