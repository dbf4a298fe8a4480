//! The oracle of the ladder knows everything, follows the shortest tour through the real protocol, and must succeed: this
//! proves that every mission can be solved and that rules, references and regions agree with each other.

use avln_arena::data::DataFolder;
use avln_lab::suite::{self, AgentVariant, ResultLine, Results, SuiteOptions, SuiteSize};
use avln_tests::{PHASE, http};

/// Plays missions of three houses with the oracle in both orders.
async fn play() -> Vec<ResultLine> {
    let folder = tempfile::tempdir().expect("a folder");
    let size = SuiteSize { houses: 3, missions: 4, practice: false };
    let plan = SuiteOptions { agents: vec![AgentVariant::ShortestPath], size, ..SuiteOptions::default() };
    suite::run(folder.path(), &plan).await.expect("a ladder");
    let results = Results::open(&folder.path().join("results.jsonl")).expect("results");
    results.lines().cloned().collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn the_oracle_completes_every_mission_in_both_orders_on_a_short_path() {
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

#[tokio::test(flavor = "multi_thread")]
async fn the_oracle_stands_on_boards_for_comparison() {
    let folder = tempfile::tempdir().expect("a folder");
    avln_tests::furnish(
        folder.path(),
        &avln_tests::TestSetup { houses: 1, missions: 2, ..Default::default() },
    )
    .await;
    let data = DataFolder::open(folder.path()).expect("the folder");
    let mut orders = Vec::new();
    suite::play_oracle(&data, PHASE, &mut |order, _| orders.push(order.as_str())).await.expect("two runs");
    assert_eq!(orders, ["ordered", "unordered"]);
    let doors = avln_tests::start_servers(folder.path()).await;
    let board =
        http::get(doors.web, &format!("/api/v1/phases/{PHASE}/leaderboard?order=unordered")).await.body;
    let board: serde_json::Value = serde_json::from_str(&board).expect("JSON");
    let row = &board["rows"][0];
    assert_eq!(
        (row["reference"].as_str(), row["summary"]["sr"]["value"].as_f64()),
        (Some("oracle"), Some(1.0))
    );
    assert!(row["rank"].is_null() && row.get("rank").is_some(), "{row}");
    doors.close().await.expect("both doors close");
}

#[tokio::test]
async fn an_oracle_without_a_phase_is_told_where_phases_are_listed() {
    let folder = tempfile::tempdir().expect("a folder");
    let data = DataFolder::open(folder.path()).expect("the folder");
    let strange = suite::play_oracle(&data, "nowhere", &mut |_, _| ()).await.expect_err("no such phase");
    assert!(strange.to_string().contains("'nowhere'"), "{strange}");
}
