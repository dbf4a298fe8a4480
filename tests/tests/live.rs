//! Who follows a run over the people's door sees it advance, and why it does not.

use avln_client::{Action, Client, RunOptions};
use avln_tests::{PHASE, TestServer, TestSetup, http, scripted_run::NO_SENSORS};
use serde_json::Value;
use std::time::Duration;
use tokio::time::sleep;

/// What the events of an answer tell, one after the other.
fn events(answer: &http::Answer) -> Vec<Value> {
    let data = answer.body.lines().filter_map(|line| line.strip_prefix("data: "));
    data.map(|data| serde_json::from_str(data).expect("JSON")).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_run_is_seen_to_advance_and_to_wait() {
    let house = TestServer::open(&TestSetup::default()).await;
    let arena = Client::connect(house.agents_url(), &house.token).await.expect("the door is open");
    let run = arena.start_run(RunOptions::new(PHASE, "walker")).await.expect("a run");
    let (web, path) = (house.doors.web, format!("/api/v1/runs/{}/events", run.id));
    let before = events(&http::get_events(web, &path, Duration::from_millis(500)).await);
    assert_eq!((before.len(), &before[0]["state"]), (1, &"created".into()));
    assert_eq!(before[0]["words"]["waits"], "the run waits for its agent to connect");

    let mut play = arena.play(&run, NO_SENSORS).await.expect("a stream");
    let mut episode = play.next_episode().await.expect("a stream").expect("an episode");
    let walk = async {
        for _ in 0..20 {
            episode.step(Action::TurnLeft).await.expect("a legal step");
            sleep(Duration::from_millis(150)).await;
        }
    };
    let (heard, ()) = tokio::join!(http::get_events(web, &path, Duration::from_millis(3500)), walk);
    let told = events(&heard);
    assert!(
        heard.body.contains("retry: 2000") && (3..=5).contains(&told.len()),
        "once a second: {}",
        heard.body
    );
    let steps: Vec<u64> = told.iter().filter_map(|event| event["slots"][0]["step"].as_u64()).collect();
    assert!(steps.len() >= 3 && steps.is_sorted_by(|a, b| a < b), "{steps:?}");
    let last = &told[told.len() - 1];
    assert_eq!(
        (&last["connected"], &last["playing"], &last["state"]),
        (&true.into(), &1.into(), &"running".into())
    );
    let rate = last["steps_per_s"].as_f64().expect("it is told");
    assert!((2.0..8.0).contains(&rate), "{rate} steps a second");
    let list = events(&http::get_events(web, "/api/v1/runs/events", Duration::from_millis(500)).await);
    assert_eq!(list[0]["runs"][0]["run"], run.id.as_str());
    let page = http::get(web, "/runs").await.body;
    assert!(page.contains("1 open run.") && page.contains("steps per second"), "{page}");

    drop(episode);
    drop(play);
    drop(arena);
    let lost = http::get_events(web, &path, Duration::from_millis(2500)).await;
    assert!(lost.body.contains("waits for its agent to reconnect"), "{}", lost.body);
}
