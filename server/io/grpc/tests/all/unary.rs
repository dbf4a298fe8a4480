//! Unary calls.

use crate::common::{
    Agent, Book, PATIENT, Plan, Quirk, RUN_TOKEN, TestServer, authorised, hello, play_client, reason, soon,
};
use avln_episode::{EndReason, TimeLimits};
use avln_grpc::Limits;
use avln_proto::v1::{self, end_request, end_response, reset_response::Outcome};
use std::time::Duration;
use tonic::Status;

const FORWARD: i32 = 1;
const SUBMIT: i32 = 4;
const STOP: i32 = 5;

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

#[tokio::test]
async fn a_whole_run_call_by_call() {
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
    let goodbye = end_request::Frame::Goodbye(v1::Goodbye { pause: false });
    let Ok(end_response::Frame::RunEnd(end)) = end(&server, goodbye).await else { panic!("no RunEnd") };
    assert_eq!((end.complete, end.progress.unwrap().done), (false, 1));
    assert_eq!(server.host.ends(1).await, [Some(EndReason::Abandoned)]);
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
