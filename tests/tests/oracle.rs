//! The oracle of the ladder knows everything, follows the shortest tour through the real protocol, and must succeed: this
//! proves that every mission can be solved and that rules, references and regions agree with each other.

use avln_server::ladder::{self, Line, Plan, Results, Rung, Size};

/// Plays missions of three houses with the oracle in both orders.
async fn play() -> Vec<Line> {
    let folder = tempfile::tempdir().expect("a folder");
    let size = Size { houses: 3, missions: 4, practice: false };
    let plan = Plan { agents: vec![Rung::ShortestPath], size, ..Plan::default() };
    ladder::run(folder.path(), &plan).await.expect("a ladder");
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
