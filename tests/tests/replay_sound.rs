//! What a visitor of a replay hears is what its agent was sent, sample by sample; where replays are hidden there is nothing.

use avln_client::{Audio, Sensors};
use avln_store::Visibility;
use avln_tests::{
    TestServer, TestSetup, http,
    scripted_run::{AUDIO_ONLY, STEPS, play_script, play_script_with},
};
use std::collections::BTreeMap;

/// Bytes of a file before its samples.
const HEAD_BYTES: usize = 68;

/// Plays a run with ears; its id, and what each episode was sent to hear.
async fn play(house: &TestServer, sensors: Sensors) -> (String, BTreeMap<u32, Vec<Audio>>) {
    let mut heard: BTreeMap<u32, Vec<Audio>> = BTreeMap::new();
    let url = house.agents_url();
    let run = play_script_with(&url, &house.token, "listener", sensors, |ordinal, observation| {
        heard.entry(ordinal).or_default().extend(observation.audio.clone());
    });
    let run = run.await;
    (run, heard)
}

/// Samples of both ears in turn, as a file has them.
fn interleaved(steps: &[Audio]) -> Vec<u8> {
    let frames = steps.iter().flat_map(|audio| audio.left.iter().zip(&audio.right));
    frames.flat_map(|(left, right)| [left.to_le_bytes(), right.to_le_bytes()].concat()).collect()
}

/// The body of an answer, byte by byte.
fn body(answer: &http::Answer) -> &[u8] {
    let head = answer.bytes.windows(4).position(|end| end == b"\r\n\r\n").expect("a head");
    &answer.bytes[head + 4..]
}

#[tokio::test(flavor = "multi_thread")]
async fn a_replay_sounds_as_its_agent_heard_it() {
    let house = TestServer::open(&TestSetup::default()).await;
    let (run, heard) = play(&house, AUDIO_ONLY).await;
    assert_eq!(heard.len(), 2);
    for (ordinal, steps) in &heard {
        let last = steps.len() - 1;
        assert!(
            last as u32 <= STEPS && steps.iter().any(|audio| audio.left.iter().any(|sample| *sample != 0.0))
        );
        let all =
            http::get(house.doors.web, &format!("/runs/{run}/episodes/{ordinal}/ears/0-{last}.wav")).await;
        assert_eq!(all.status, 200, "{}", all.body);
        assert!(body(&all)[HEAD_BYTES..] == interleaved(steps)[..], "episode {ordinal}");
        let some = http::get(house.doors.web, &format!("/runs/{run}/episodes/{ordinal}/ears/7-9.wav")).await;
        assert!(body(&some)[HEAD_BYTES..] == interleaved(&steps[7..=9])[..], "a part of episode {ordinal}");
        let levels =
            http::get(house.doors.web, &format!("/api/v1/runs/{run}/episodes/{ordinal}/levels.csv")).await;
        assert_eq!(levels.body.lines().count(), steps.len() + 1, "{}", levels.body);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn there_is_nothing_to_hear_without_ears_or_where_replays_are_hidden() {
    let house = TestServer::open(&TestSetup::default()).await;
    let deaf = play_script(&house.agents_url(), &house.token, "deaf").await;
    let hidden =
        TestServer::open(&TestSetup { visible_to: Visibility::Organiser, ..TestSetup::default() }).await;
    let (run, _) = play(&hidden, AUDIO_ONLY).await;
    for (house, run) in [(&house, &deaf), (&hidden, &run)] {
        for path in ["runs/RUN/episodes/0/ears/0-1.wav", "api/v1/runs/RUN/episodes/0/levels.csv"] {
            let answer = http::get(house.doors.web, &format!("/{}", path.replace("RUN", run))).await;
            assert_eq!(answer.status, 404, "{path}");
        }
        let page = http::get(house.doors.web, &format!("/runs/{run}/episodes/0?ears=on")).await;
        assert!(!page.body.contains("<audio"), "{}", page.body);
    }
}
