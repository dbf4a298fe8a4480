//! The ladder end to end: agents play through the door, a second call goes on where the first one stopped, and the page tells
//! what was reached.

use avln_lab::suite::{self, AgentVariant, Results, SuiteOptions, SuiteSize};
use std::{fs, path::Path};

fn lines(folder: &Path) -> Vec<String> {
    let text = fs::read_to_string(folder.join("results.jsonl")).expect("results");
    text.lines().map(str::to_owned).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn agents_play_what_they_have_not_played_and_a_page_is_written() {
    let place = tempfile::tempdir().expect("a folder");
    let folder = place.path();
    assert!(suite::report(folder).is_err(), "nothing was played");
    let size = SuiteSize { houses: 1, missions: 2, practice: false };
    let agents = vec![AgentVariant::Random, AgentVariant::ShortestPath];
    let plan = |episodes| SuiteOptions { agents: agents.clone(), episodes, size, ..SuiteOptions::default() };

    assert_eq!(suite::run(folder, &plan(1)).await.expect("one mission"), 4);
    let first = lines(folder);
    assert_eq!(suite::run(folder, &plan(2)).await.expect("the other mission"), 4);
    assert_eq!(suite::run(folder, &plan(2)).await.expect("nothing"), 0);
    let all = lines(folder);
    assert!(all.len() == 8 && all[..4] == first[..], "{all:?}");

    // A line that was cut off is played again, and the same seed does the same.
    let cut = all[..7].join("\n") + "\n" + &all[7][..40];
    fs::write(folder.join("results.jsonl"), cut).expect("the file");
    assert_eq!(suite::run(folder, &plan(2)).await.expect("the last one"), 1);
    let results = Results::open(&folder.join("results.jsonl")).expect("results");
    let before: suite::ResultLine = serde_json::from_str(&all[7]).expect("a line");
    let after = results.lines().find(|line| line.key == before.key).expect("it was played");
    assert_eq!((&after.metrics, &after.wrong, after.end), (&before.metrics, &before.wrong, before.end));

    let suite::SuiteReport { page, episodes } = suite::report(folder).expect("a page");
    assert_eq!(episodes.lines().count(), 9, "{episodes}");
    let oracle = episodes.lines().find(|line| line.starts_with("shortest-path,unordered,")).expect("a row");
    assert!(oracle.contains(",1,1.0000,1.0000,") && oracle.ends_with(",stopped"), "{oracle}");
    let row = |name: &str| page.lines().find(|line| line.starts_with(name)).expect("a row").to_owned();
    assert!(row("| random |").starts_with("| random | - | 2 |"), "{page}");
    assert!(row("| shortest-path †").contains("| 100.0 [100.0, 100.0] |"), "{page}");
    assert!(page.contains("| PAG-Nav | yes | 2.3 |") && page.contains("other missions"), "{page}");
}

#[tokio::test(flavor = "multi_thread")]
async fn two_ladders_cannot_be_played_in_one_folder() {
    let place = tempfile::tempdir().expect("a folder");
    let lock = fs::File::create(place.path().join("lock")).expect("the lock");
    lock.lock().expect("it is free");
    let refused = suite::run(place.path(), &SuiteOptions::default()).await.expect_err("it is taken");
    assert!(refused.to_string().contains("another baseline suite is running"), "{refused}");
}
