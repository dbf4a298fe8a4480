//! Agents that behave: whole runs through the stream and by unary calls.

use crate::common::{
    Agent, Book, PATIENT, Plan, Quirk, RUN, RUN_TOKEN, TestServer, authorised, hello, play_client, reason,
    soon,
};
use avln_episode::{EndReason, TimeLimits};
use avln_grpc::{Host, Limits};
use avln_proto::v1::{
    self, end_request, end_response, goal::Cue, play_request::Frame as Up, reset_response::Outcome,
};
use std::{sync::mpsc, time::Duration};
use tonic::Status;

const FORWARD: i32 = 1;
const SUBMIT: i32 = 4;
const STOP: i32 = 5;

#[tokio::test]
async fn a_whole_run_from_hello_to_run_end() {
    let server = TestServer::open(Plan::plain(2)).await;
    let mut agent = Agent::enter(&server, 1).await;
    let task = agent.welcome.task.clone().unwrap();
    assert_eq!((task.rules.as_str(), task.max_steps, agent.welcome.slots), ("lh-avln-v1", 10, 1));
    assert_eq!((task.width, task.height), (64, 64));
    assert_eq!(agent.welcome.time.unwrap().step_ms, 60_000);
    assert_eq!(agent.welcome.time.unwrap().disconnect_s, 0, "a lost connection may not come back");

    let start = agent.ready(0).await;
    assert_eq!((start.ordinal, start.progress.unwrap().in_flight), (1, 1));
    let cues: Vec<_> = start.mission.unwrap().goals.into_iter().map(|goal| goal.cue.unwrap()).collect();
    assert_eq!(cues[0], Cue::Category("chair".into()));
    assert_eq!(start.observation.unwrap().step, 0);

    agent.act(0, &start.episode, 1, FORWARD).await;
    let walked = agent.observation().await;
    assert_eq!((walked.step, walked.remaining_steps, walked.terminated), (1, 9, false));
    assert_eq!(walked.pose.unwrap().z_m, -0.25);
    assert_eq!(walked.tensors.len(), agent.welcome.tensors.len());
    for (tensor, spec) in walked.tensors.iter().zip(&agent.welcome.tensors) {
        assert_eq!((tensor.id, &tensor.shape, tensor.dtype), (spec.id, &spec.shape, spec.dtype));
        let numbers: u32 = spec.shape.iter().product();
        let width = if spec.dtype() == v1::Dtype::U8 { 1 } else { 4 };
        assert_eq!(tensor.data.len() as u32, numbers * width);
    }

    agent.act(0, &start.episode, 2, STOP).await;
    let last = agent.observation().await;
    assert!(last.terminated && !last.truncated);
    assert_eq!(last.reason(), v1::EndReason::Stopped);
    let end = agent.episode_end().await;
    assert_eq!((end.step, end.reason(), end.terminated), (2, v1::EndReason::Stopped, true));
    assert_eq!(end.metrics.unwrap().metrics[0].name, "isr");
    assert_eq!(end.progress.unwrap().done, 1);

    let second = agent.ready(0).await;
    assert_eq!(second.ordinal, 2);
    for step in 1..=10 {
        agent.act(0, &second.episode, step, FORWARD).await;
        assert_eq!(agent.observation().await.truncated, step == 10);
    }
    assert_eq!(agent.episode_end().await.reason(), v1::EndReason::StepLimit);

    agent.send(Up::Ready(v1::Ready { slot: 0 })).await;
    let end = agent.run_end().await;
    assert!(end.complete && server.host.finished());
    assert_eq!(end.metrics.unwrap().metrics[0].value, 0.5);
    assert_eq!(agent.next().await.unwrap(), None, "the stream ends well");
    assert_eq!(server.host.ends(2).await, [Some(EndReason::Stopped), Some(EndReason::StepLimit)]);
}

#[tokio::test]
async fn two_slots_play_at_the_same_time() {
    let server = TestServer::open(Plan::plain(2)).await;
    let mut agent = Agent::enter(&server, 2).await;
    let (left, right) = (agent.ready(0).await, agent.ready(1).await);
    assert_ne!(left.episode, right.episode);
    agent.act(0, &left.episode, 1, FORWARD).await;
    agent.act(1, &right.episode, 1, STOP).await;
    let mut seen = Vec::new();
    for _ in 0..3 {
        match agent.next().await.unwrap().unwrap() {
            v1::play_response::Frame::Observation(o) => seen.push((o.slot, o.episode, o.terminated)),
            v1::play_response::Frame::EpisodeEnd(end) => assert_eq!(end.episode, right.episode),
            other => panic!("{other:?}"),
        }
    }
    seen.sort();
    assert_eq!(seen, [(0, left.episode.clone(), false), (1, right.episode, true)]);
    agent.act(0, &left.episode, 2, STOP).await;
    assert_eq!(agent.observation().await.step, 2);
    assert_eq!(agent.episode_end().await.slot, 0);
}

#[tokio::test]
async fn a_slow_slot_does_not_hold_up_another() {
    let (word, words) = mpsc::channel();
    let server = TestServer::open(Plan::odd(vec![Quirk::Slow(words), Quirk::None])).await;
    let mut agent = Agent::enter(&server, 2).await;
    let (slow, quick) = (agent.ready(0).await, agent.ready(1).await);
    agent.act(0, &slow.episode, 1, FORWARD).await;
    for step in 1..=5 {
        agent.act(1, &quick.episode, step, FORWARD).await;
        let observation = agent.observation().await;
        assert_eq!((observation.slot, observation.step), (1, step));
    }
    word.send(()).unwrap();
    assert_eq!(agent.observation().await.slot, 0);
}

#[tokio::test]
async fn observations_are_encoded_on_simulation_threads() {
    let (sender, threads) = mpsc::channel();
    let server = TestServer::open(Plan::odd(vec![Quirk::Encoded(sender)])).await;
    let mut agent = Agent::enter(&server, 1).await;
    let start = agent.ready(0).await;
    agent.act(0, &start.episode, 1, FORWARD).await;
    agent.observation().await;
    // Elsewhere, large images of a team would delay the messages of others.
    assert_eq!(threads.try_iter().collect::<Vec<_>>(), ["avln-simulate", "avln-simulate"]);
}

#[tokio::test]
async fn ready_waits_for_open_episodes() {
    let server = TestServer::open(Plan::plain(1)).await;
    let mut agent = Agent::enter(&server, 2).await;
    let start = agent.ready(0).await;
    agent.send(Up::Ready(v1::Ready { slot: 1 })).await;
    agent.act(0, &start.episode, 1, FORWARD).await;
    assert_eq!(agent.observation().await.step, 1, "no RunEnd while a slot plays");
    agent.act(0, &start.episode, 2, STOP).await;
    agent.observation().await;
    agent.episode_end().await;
    assert!(agent.run_end().await.complete);
}

#[tokio::test]
async fn a_waiting_slot_gets_a_returned_episode() {
    let server = TestServer::open(Plan::odd(vec![Quirk::Fragile])).await;
    let mut agent = Agent::enter(&server, 2).await;
    let fragile = agent.ready(0).await;
    agent.send(Up::Ready(v1::Ready { slot: 1 })).await;
    agent.act(0, &fragile.episode, 1, FORWARD).await;
    agent.observation().await;
    server.host.refill();
    agent.act(0, &fragile.episode, 2, SUBMIT).await;
    agent.fault().await;
    assert_eq!(agent.episode_end().await.reason(), v1::EndReason::ServerFault);
    let again = agent.episode_start().await;
    assert_eq!(again.slot, 1);
    agent.act(1, &again.episode, 1, STOP).await;
    assert!(agent.observation().await.terminated);
}

#[tokio::test]
async fn slots_without_memory_wait_for_ends() {
    let server = TestServer::open(Plan { most_open: 1, ..Plan::plain(3) }).await;
    let mut agent = Agent::enter(&server, 2).await;
    let mut start = agent.ready(0).await;
    agent.send(Up::Ready(v1::Ready { slot: 1 })).await;
    for slot in [1, 0] {
        agent.act(start.slot, &start.episode, 1, STOP).await;
        assert!(agent.observation().await.terminated, "no fault for the other slot");
        agent.episode_end().await;
        start = agent.episode_start().await;
        assert_eq!(start.slot, slot);
        agent.send(Up::Ready(v1::Ready { slot: 1 - slot })).await;
    }
    agent.act(start.slot, &start.episode, 1, STOP).await;
    agent.observation().await;
    agent.episode_end().await;
    assert!(agent.run_end().await.complete);
    assert_eq!(server.host.ends(3).await, [Some(EndReason::Stopped); 3]);
}

#[tokio::test]
async fn goodbye_abandons_open_episodes() {
    let server = TestServer::open(Plan::plain(3)).await;
    let mut agent = Agent::enter(&server, 1).await;
    let start = agent.ready(0).await;
    agent.goodbye().await;
    let end = agent.episode_end().await;
    assert_eq!((end.episode.clone(), end.reason()), (start.episode, v1::EndReason::Abandoned));
    assert!(!agent.run_end().await.complete);
    assert_eq!(agent.next().await.unwrap(), None);
    assert_eq!(server.host.ends(1).await, [Some(EndReason::Abandoned)]);
}

#[tokio::test]
async fn abandoning_frees_the_slot() {
    let server = TestServer::open(Plan::plain(2)).await;
    let mut agent = Agent::enter(&server, 1).await;
    let start = agent.ready(0).await;
    let abandon = v1::Abandon { slot: 0, episode: start.episode.clone(), step: 0 };
    agent.send(Up::Abandon(abandon.clone())).await;
    assert_eq!(agent.episode_end().await.reason(), v1::EndReason::Abandoned);
    agent.send(Up::Abandon(abandon)).await;
    assert_eq!(agent.episode_end().await.episode, start.episode, "saying it twice changes nothing");
    assert_ne!(agent.ready(0).await.episode, start.episode);
    assert_eq!(server.host.concluded(1).await.len(), 1);
}

#[tokio::test]
async fn a_phase_that_hides_metrics_sends_none() {
    let server = TestServer::open(Plan { shows_metrics: false, ..Plan::plain(1) }).await;
    let mut agent = Agent::enter(&server, 1).await;
    let start = agent.ready(0).await;
    agent.act(0, &start.episode, 1, STOP).await;
    agent.observation().await;
    assert_eq!(agent.episode_end().await.metrics, None);
    agent.goodbye().await;
    assert_eq!(agent.run_end().await.metrics, None);
}

/// Packed pictures decode to the raw values, and
/// does not come.
#[tokio::test]
async fn packed_values_are_exact_for_requested_sensors() {
    let server = TestServer::open(Plan::plain(1)).await;
    let wish = |kind: v1::SensorKind, encodings: &[v1::Encoding]| v1::SensorWish {
        kind: kind.into(),
        encodings: encodings.iter().map(|&encoding| encoding.into()).collect(),
    };
    let mut hello = hello(1);
    if let Some(sensors) = &mut hello.sensors {
        sensors.wishes = vec![
            wish(v1::SensorKind::Rgb, &[v1::Encoding::Packed, v1::Encoding::Raw]),
            wish(v1::SensorKind::Depth, &[v1::Encoding::DepthU16MmPacked, v1::Encoding::Packed]),
        ];
    }
    let mut agent = Agent::dial(&server, RUN_TOKEN, vec![Up::Hello(hello)]).await.unwrap();
    let welcome = agent.welcomed().await;
    let announced: Vec<_> = welcome.tensors.iter().map(|spec| (spec.kind(), spec.encoding())).collect();
    let (rgb, depth) = (v1::SensorKind::Rgb, v1::SensorKind::Depth);
    assert_eq!(announced, [(rgb, v1::Encoding::Packed), (depth, v1::Encoding::Packed)]);

    let start = agent.ready(0).await;
    agent.act(0, &start.episode, 1, FORWARD).await;
    let seen = agent.observation().await;
    let [rgb, depth] = &seen.tensors[..] else { panic!("{} tensors", seen.tensors.len()) };
    let size = avln_proto::wire::Size { width: 64, height: 64 };
    assert_eq!(
        avln_proto::wire::rgb::decode(rgb.encoding(), size, rgb.data.clone()),
        Ok(vec![1; 3 * 64 * 64])
    );
    let layout = avln_proto::wire::depth::Layout { size, unit_m: 1.0 };
    assert_eq!(
        avln_proto::wire::depth::decode(depth.encoding(), layout, &depth.data),
        Ok(vec![1.0; 64 * 64])
    );
    assert!(rgb.data.len() < 2000 && depth.data.len() < 2000, "{} {}", rgb.data.len(), depth.data.len());
}

async fn reset_with(server: &TestServer, hello: v1::Hello) -> Result<v1::ResetResponse, Status> {
    let request = v1::ResetRequest { hello: Some(hello), ready: Some(v1::Ready { slot: 0 }) };
    play_client(server).await.reset(authorised(request, RUN_TOKEN)).await.map(|answer| answer.into_inner())
}

async fn reset(server: &TestServer) -> Outcome {
    reset_with(server, hello(1)).await.unwrap().outcome.unwrap()
}

async fn start(server: &TestServer) -> v1::EpisodeStart {
    match reset(server).await {
        Outcome::EpisodeStart(start) => start,
        Outcome::RunEnd(end) => panic!("no episode but {end:?}"),
    }
}

async fn step(
    server: &TestServer,
    episode: &str,
    step: u32,
    action: i32,
) -> Result<v1::StepResponse, Status> {
    let request = v1::StepRequest { act: Some(v1::Act { slot: 0, episode: episode.into(), step, action }) };
    play_client(server).await.step(authorised(request, RUN_TOKEN)).await.map(|answer| answer.into_inner())
}

async fn end(server: &TestServer, frame: end_request::Frame) -> Result<end_response::Frame, Status> {
    let request = authorised(v1::EndRequest { frame: Some(frame) }, RUN_TOKEN);
    play_client(server).await.end(request).await.map(|answer| answer.into_inner().frame.unwrap())
}

async fn leave(server: &TestServer) -> v1::RunEnd {
    match end(server, end_request::Frame::Goodbye(v1::Goodbye { pause: false })).await {
        Ok(end_response::Frame::RunEnd(end)) => end,
        other => panic!("no RunEnd but {other:?}"),
    }
}

#[tokio::test]
async fn unary_calls_play_a_whole_run() {
    let server = TestServer::open(Plan::plain(2)).await;
    let begun = reset_with(&server, hello(1)).await.unwrap();
    assert_eq!(begun.welcome.unwrap().slots, 1);
    let Some(Outcome::EpisodeStart(first)) = begun.outcome else { panic!("no episode") };
    let again = start(&server).await;
    assert_eq!(again, first, "a repeated Reset returns the same episode");

    let walked = step(&server, &first.episode, 1, FORWARD).await.unwrap();
    assert_eq!(step(&server, &first.episode, 1, FORWARD).await.unwrap(), walked, "steps can be repeated");
    assert_eq!(walked.observation.unwrap().step, 1);
    let last = step(&server, &first.episode, 2, STOP).await.unwrap();
    assert_eq!(last.episode_end.as_ref().unwrap().reason(), v1::EndReason::Stopped);
    assert_eq!(step(&server, &first.episode, 2, STOP).await.unwrap(), last, "and the last one");
    let late = step(&server, &first.episode, 3, FORWARD).await.unwrap_err();
    assert_eq!(reason(&late), "EPISODE_OVER");

    let second = start(&server).await;
    let abandon = v1::Abandon { slot: 0, episode: second.episode, step: 0 };
    let Ok(end_response::Frame::EpisodeEnd(end)) = end(&server, end_request::Frame::Abandon(abandon)).await
    else {
        panic!("no EpisodeEnd")
    };
    assert_eq!(end.reason(), v1::EndReason::Abandoned);
    let Outcome::RunEnd(end) = reset(&server).await else { panic!("an episode too many") };
    assert!(end.complete && server.host.finished());
    assert_eq!(reset(&server).await, Outcome::RunEnd(end.clone()), "a lost answer can be repeated");
    assert_eq!(leave(&server).await, end);
    assert_eq!(server.host.ends(2).await, [Some(EndReason::Stopped), Some(EndReason::Abandoned)]);
}

#[tokio::test]
async fn refusals_are_statuses_and_harm_nothing() {
    let server = TestServer::open(Plan::plain(1)).await;
    let early = step(&server, "ep_1", 1, FORWARD).await.unwrap_err();
    assert_eq!(reason(&early), "EPISODE_UNKNOWN");
    let episode = start(&server).await.episode;
    for (named, number, action, word) in [
        (episode.as_str(), 1, 9, "ACTION_OUT_OF_RANGE"),
        ("ep_other", 1, FORWARD, "EPISODE_UNKNOWN"),
        (&episode, 2, FORWARD, "STEP_AHEAD"),
        (&episode, 0, FORWARD, "STEP_CONFLICT"),
    ] {
        assert_eq!(reason(&step(&server, named, number, action).await.unwrap_err()), word);
    }
    let mut wider = hello(1);
    wider.sensors.as_mut().unwrap().width = 128;
    assert_eq!(reason(&reset_with(&server, wider).await.unwrap_err()), "SENSOR_NOT_ALLOWED");
    assert_eq!(step(&server, &episode, 1, FORWARD).await.unwrap().observation.unwrap().step, 1);
    assert_eq!(reason(&reset_with(&server, hello(1)).await.unwrap_err()), "SLOT_BUSY");
}

#[tokio::test]
async fn goodbye_closes_the_run() {
    let server = TestServer::open(Plan::plain(2)).await;
    start(&server).await;
    let end = leave(&server).await;
    assert_eq!((end.complete, end.progress.unwrap().done), (false, 1));
    assert_eq!(server.host.ends(1).await, [Some(EndReason::Abandoned)]);
    assert!(server.host.cancelled());
    assert_eq!(leave(&server).await, end, "a lost answer can be repeated");
    let over = reset_with(&server, hello(1)).await.unwrap();
    assert_eq!((over.welcome, over.outcome), (None, Some(Outcome::RunEnd(end))));
}

#[tokio::test]
async fn an_expired_run_ends_unary_play() {
    let server = TestServer::open(Plan::plain(2)).await;
    start(&server).await;
    server.host.expire_run(RUN).await.unwrap();
    let Outcome::RunEnd(end) = reset(&server).await else { panic!("an episode too many") };
    assert_eq!((end.complete, end.progress.unwrap().done), (false, 1));
    assert_eq!(server.host.ends(1).await, [Some(EndReason::TimeBudget)]);
    assert!(!server.host.cancelled());
}

#[tokio::test]
async fn reset_without_episodes_keeps_the_run_open() {
    let book = Book::default();
    let server = TestServer::with_book(Plan::plain(1), Limits::default(), book.clone()).await;
    let episode = start(&server).await.episode;
    // An episode that the server has lost and will return.
    book.lock().unwrap().insert("ep_lost".into(), Default::default());
    step(&server, &episode, 1, STOP).await.unwrap();
    let Outcome::RunEnd(end) = reset(&server).await else { panic!("an episode too many") };
    assert!(!server.host.cancelled() && !server.host.finished(), "{end:?}");
    server.host.refill();
    assert_ne!(start(&server).await.episode, episode, "it returned");
}

#[tokio::test]
async fn a_silent_caller_counts_as_disconnected() {
    let limits = Limits { unary_idle: Duration::from_millis(50), ..Limits::default() };
    let server = TestServer::with_limits(Plan::plain(2), limits).await;
    start(&server).await;
    assert_eq!(server.host.ends(1).await, [Some(EndReason::Disconnected)]);
    server.still_serves().await;
}

#[tokio::test]
async fn a_call_in_progress_is_no_silence() {
    let (release, wait) = mpsc::channel();
    let limits = Limits { unary_idle: Duration::from_millis(500), ..Limits::default() };
    let server = TestServer::with_limits(Plan::odd(vec![Quirk::SlowStart(wait)]), limits).await;
    let later = async {
        tokio::time::sleep(Duration::from_millis(1200)).await;
        release.send(()).unwrap();
    };
    let (begun, ()) = tokio::join!(start(&server), later);
    step(&server, &begun.episode, 1, STOP).await.unwrap();
    assert_eq!(server.host.ends(1).await, [Some(EndReason::Stopped)]);
}

#[tokio::test]
async fn a_timeout_is_reported_at_the_next_step() {
    let hasty = TimeLimits { step_ms: 30, ..PATIENT };
    let server = TestServer::open(Plan::timed(1, hasty)).await;
    let slow = start(&server).await.episode;
    assert_eq!(server.host.ends(1).await, [Some(EndReason::TimeBudget)]);
    let told = step(&server, &slow, 1, FORWARD).await.unwrap();
    assert_eq!(told.observation, None);
    assert_eq!(told.episode_end.unwrap().reason(), v1::EndReason::TimeBudget);
}

#[tokio::test]
async fn a_simulator_panic_ends_only_the_episode() {
    let server = TestServer::open(Plan::odd(vec![Quirk::Stillborn, Quirk::Fragile, Quirk::None])).await;
    assert_eq!(reason(&reset_with(&server, hello(1)).await.unwrap_err()), "SIM_FAULT");
    let fragile = start(&server).await.episode;
    let told = step(&server, &fragile, 1, SUBMIT).await.unwrap();
    assert_eq!(told.episode_end.unwrap().reason(), v1::EndReason::ServerFault);
    assert_eq!(server.host.ends(2).await, [Some(EndReason::ServerFault); 2]);
    start(&server).await;
}

#[tokio::test]
async fn unary_episodes_survive_a_stop_of_the_server() {
    let server = TestServer::open(Plan::plain(1)).await;
    let begun = start(&server).await.episode;
    let host = server.host.clone();
    soon(server.close()).await.unwrap();
    assert!(host.page(&begun).actions.is_empty(), "it is still open");
}

#[tokio::test]
async fn a_stream_supersedes_unary_play() {
    let server = TestServer::open(Plan::plain(2)).await;
    let episode = start(&server).await.episode;
    let mut agent = Agent::enter(&server, 1).await;
    assert_eq!(server.host.ends(1).await, [Some(EndReason::Disconnected)]);
    assert_eq!(reason(&step(&server, &episode, 1, FORWARD).await.unwrap_err()), "EPISODE_UNKNOWN");
    agent.ready(0).await;
}

#[tokio::test]
async fn unary_calls_continue_after_a_restart() {
    let (book, plan) = (Book::default(), || {
        Plan::timed(2, TimeLimits { disconnect_s: 60, disconnect_total_s: 60, ..PATIENT })
    });
    let server = TestServer::with_book(plan(), Limits::default(), book.clone()).await;
    let begun = start(&server).await.episode;
    step(&server, &begun, 1, FORWARD).await.unwrap();
    soon(server.close()).await.unwrap();
    let server = TestServer::with_book(plan(), Limits::default(), book).await;
    assert_eq!(reason(&step(&server, &begun, 2, FORWARD).await.unwrap_err()), "EPISODE_UNKNOWN");
    let resumed = reset_with(&server, v1::Hello { resume: true, ..hello(1) }).await.unwrap();
    let Some(Outcome::EpisodeStart(again)) = resumed.outcome else { panic!("no episode") };
    assert_eq!((again.episode.as_str(), again.observation.unwrap().step), (begun.as_str(), 1));
    let told = step(&server, &begun, 2, STOP).await.unwrap();
    assert_eq!(told.episode_end.unwrap().reason(), v1::EndReason::Stopped);
}
