//! The oracle follows the shortest tour over gRPC and must succeed. This proves that every mission can be solved and that rules,
//! references and visibility regions agree.

use avln_arena::data::DataFolder;
use avln_lab::suite::{self, AgentVariant, ResultLine, Results, SuiteOptions, SuiteSize, Track};
use avln_store::TokenLine;
use avln_tests::{PHASE, TestSetup, change_phase, http, set_up, start_servers, store};
use std::{
    fs,
    path::Path,
    process::{Command, Output},
};
use tempfile::TempDir;

const TEAM: &str = "Oracle";

/// Plays missions in three houses with the oracle in both orders.
async fn play() -> Vec<ResultLine> {
    let folder = tempfile::tempdir().expect("a folder");
    let size = SuiteSize { houses: 3, missions: 4, ..Track::Quick.size() };
    let agents = vec![AgentVariant::ShortestPath];
    let setup = SuiteOptions { track: Track::Quick, agents, size, ..SuiteOptions::default() };
    suite::run(folder.path(), &setup).await.expect("a baseline suite");
    let results = Results::open(&folder.path().join("results.jsonl")).expect("results");
    results.lines().cloned().collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn oracle_completes_every_mission_in_both_orders() {
    let lines = play().await;
    assert_eq!(lines.len(), 24);
    for order in ["ordered", "unordered"] {
        let own: Vec<_> = lines.iter().filter(|line| line.key.order == order).collect();
        let failed: Vec<_> = own.iter().filter(|line| line.metrics.sr < 1.0).collect();
        assert!(own.len() == 12 && failed.is_empty(), "{failed:?}");
        let spl = own.iter().map(|line| line.metrics.spl).sum::<f64>() / 12.0;
        assert!(spl >= 0.95, "{order}: SPL {spl}");
        assert!(own.iter().all(|line| line.wrong.is_empty()), "no Submit was wrong");
    }
}

/// A data folder with the test phase.
async fn folder() -> (TempDir, DataFolder) {
    let folder = tempfile::tempdir().expect("a folder");
    set_up(folder.path(), &TestSetup::default()).await;
    let data = DataFolder::open(folder.path()).expect("the folder");
    (folder, data)
}

/// Account tokens of the oracle's team.
async fn tokens(folder: &Path) -> Vec<TokenLine> {
    let store = store(folder).await;
    let tokens = store.tokens().await.expect("tokens");
    store.close().await;
    tokens.into_iter().filter(|token| token.team.as_deref() == Some(TEAM)).collect()
}

fn is_void(token: &TokenLine) -> bool {
    token.revoked_ms.is_some() && token.expires_ms.is_some()
}

#[tokio::test(flavor = "multi_thread")]
async fn oracle_is_on_leaderboards_for_comparison() {
    let (folder, data) = folder().await;
    let mut orders = Vec::new();
    for _ in 0..2 {
        suite::play_oracle(&data, PHASE, &mut |order, summary| {
            orders.push((order.as_str(), summary.is_some()))
        })
        .await
        .expect("two runs in all");
    }
    let expected = [("ordered", true), ("unordered", true), ("ordered", false), ("unordered", false)];
    assert_eq!(orders, expected, "the second call plays nothing");
    let store = store(folder.path()).await;
    assert_eq!(store.runs_of(TEAM).await.expect("runs").len(), 2);
    store.close().await;
    let tokens = tokens(folder.path()).await;
    assert!(tokens.len() == 1 && tokens.iter().all(is_void), "{tokens:?}");

    let servers = start_servers(folder.path()).await;
    let board =
        http::get(servers.web, &format!("/api/v1/phases/{PHASE}/leaderboard?order=unordered")).await.body;
    let board: serde_json::Value = serde_json::from_str(&board).expect("JSON");
    let row = &board["rows"][0];
    assert_eq!(
        (row["reference"].as_str(), row["summary"]["sr"]["value"].as_f64()),
        (Some("oracle"), Some(1.0))
    );
    assert!(row["rank"].is_null() && row.get("rank").is_some(), "{row}");
    servers.close().await.expect("a shutdown");
}

#[tokio::test(flavor = "multi_thread")]
async fn failed_oracle_leaves_no_valid_token() {
    let (folder, data) = folder().await;
    change_phase(folder.path(), |phase| phase.schedule.paused = Some("the roof leaks".to_owned())).await;
    let paused = suite::play_oracle(&data, PHASE, &mut |_, _| ()).await.expect_err("a paused phase");
    assert!(paused.to_string().contains("the roof leaks"), "{paused}");
    let tokens = tokens(folder.path()).await;
    assert!(tokens.len() == 1 && tokens.iter().all(is_void), "{tokens:?}");
}

#[tokio::test]
async fn oracle_without_phase_error_has_hint() {
    let folder = tempfile::tempdir().expect("a folder");
    let data = DataFolder::open(folder.path()).expect("the folder");
    let strange = suite::play_oracle(&data, "nowhere", &mut |_, _| ()).await.expect_err("no such phase");
    assert!(strange.to_string().contains("'nowhere'"), "{strange}");
}

/// Runs the program on a data folder without a passphrase.
fn avln(data: &Path, line: &str) -> Output {
    let mut program = Command::new(env!("CARGO_BIN_EXE_avln_under_test"));
    for name in ["AVLN_SEAL_KEY", "AVLN_SEAL_KEY_FILE"] {
        program.env_remove(name);
    }
    program.arg("--data").arg(data).args(line.split(' ')).output().expect("the program runs")
}

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

#[test]
fn oracle_solves_hard_and_mesh_missions() {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, rules) in [("hard", "lh-avln-hard-v1"), ("mesh", "lh-avln-mesh-v1")] {
        for line in [
            &format!("data split make {name} --houses 1 --missions 6 --seed 9 --rules {rules}"),
            &format!("challenge phase open {name} --split {name}"),
        ] {
            let output = avln(folder.path(), line);
            assert!(output.status.success(), "{line}: {}", text(&output));
        }
        let played = text(&avln(folder.path(), &format!("challenge leaderboard oracle --phase {name}")));
        assert_eq!(played.matches("SR 1.000").count(), 2, "{rules}: {played}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn oracle_plays_beside_a_sealed_split() {
    let (folder, _) = folder().await;
    change_phase(folder.path(), |phase| phase.admission.approval = true).await;
    fs::write(folder.path().join("seal.key"), "V3ry-l0ng.and/unlike+others\n").expect("a file");
    let key = folder.path().join("seal.key").display().to_string();
    for line in [
        "data split make hidden --houses 1 --missions 1 --seed 9",
        "challenge phase open finals --split hidden",
        &format!("data split seal hidden --key-file {key}"),
    ] {
        let output = avln(folder.path(), line);
        assert!(output.status.success(), "{line}: {}", text(&output));
    }
    let refused = avln(folder.path(), "serve --admin off --grpc 127.0.0.1:0 --web 127.0.0.1:0");
    assert!(text(&refused).contains("is sealed"), "a server needs all phases: {}", text(&refused));

    let oracle = format!("challenge leaderboard oracle --phase {PHASE}");
    let played = avln(folder.path(), &oracle);
    assert!(played.status.success() && text(&played).contains("SR 1.000"), "{}", text(&played));
    let again = text(&avln(folder.path(), &oracle));
    assert_eq!(again.matches("already on the leaderboard").count(), 2, "{again}");
    let audit = text(&avln(folder.path(), "challenge audit"));
    assert!(audit.contains(&format!("approved in phase {PHASE}")), "{audit}");
    let sealed = avln(folder.path(), "challenge leaderboard oracle --phase finals");
    assert!(text(&sealed).contains("is sealed"), "{}", text(&sealed));
}
