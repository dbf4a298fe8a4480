//! The unary mirror: the same session, one call at a time.

use crate::common::{
    Agent, Book, House, PATIENT, Plan, Quirk, RUN_TOKEN, authorised, hello, play_client, reason, soon,
};
use avln_episode::{EndReason, TimeLimits};
use avln_grpc::Limits;
use avln_proto::v1::{self, end_request, end_response, reset_response::Outcome};
use std::time::Duration;
use tonic::Status;

const FORWARD: i32 = 1;
const SUBMIT: i32 = 4;
const STOP: i32 = 5;

async fn reset_with(house: &House, hello: v1::Hello) -> Result<v1::ResetResponse, Status> {
    let request = v1::ResetRequest { hello: Some(hello), ready: Some(v1::Ready { slot: 0 }) };
    play_client(house).await.reset(authorised(request, RUN_TOKEN)).await.map(|answer| answer.into_inner())
}

async fn reset(house: &House) -> Outcome {
    reset_with(house, hello(1)).await.unwrap().outcome.unwrap()
}

async fn start(house: &House) -> v1::EpisodeStart {
    match reset(house).await {
        Outcome::EpisodeStart(start) => start,
        Outcome::RunEnd(end) => panic!("no episode but {end:?}"),
    }
}

async fn step(house: &House, episode: &str, step: u32, action: i32) -> Result<v1::StepResponse, Status> {
    let request = v1::StepRequest { act: Some(v1::Act { slot: 0, episode: episode.into(), step, action }) };
    play_client(house).await.step(authorised(request, RUN_TOKEN)).await.map(|answer| answer.into_inner())
}

async fn end(house: &House, frame: end_request::Frame) -> Result<end_response::Frame, Status> {
    let request = authorised(v1::EndRequest { frame: Some(frame) }, RUN_TOKEN);
    play_client(house).await.end(request).await.map(|answer| answer.into_inner().frame.unwrap())
}

#[tokio::test]
async fn a_whole_run_call_by_call() {
    let house = House::open(Plan::plain(2)).await;
    let begun = reset_with(&house, hello(1)).await.unwrap();
    assert_eq!(begun.welcome.unwrap().slots, 1);
    let Some(Outcome::EpisodeStart(first)) = begun.outcome else { panic!("no episode") };
    let again = start(&house).await;
    assert_eq!(again, first, "a Reset whose answer was lost finds the same episode");

    let walked = step(&house, &first.episode, 1, FORWARD).await.unwrap();
    assert_eq!(step(&house, &first.episode, 1, FORWARD).await.unwrap(), walked, "steps are safe to repeat");
    assert_eq!(walked.observation.unwrap().step, 1);
    let last = step(&house, &first.episode, 2, STOP).await.unwrap();
    assert_eq!(last.episode_end.as_ref().unwrap().reason(), v1::EndReason::Stopped);
    assert_eq!(step(&house, &first.episode, 2, STOP).await.unwrap(), last, "the last one too");
    let late = step(&house, &first.episode, 3, FORWARD).await.unwrap_err();
    assert_eq!(reason(&late), "EPISODE_OVER");

    let second = start(&house).await;
    let abandon = v1::Abandon { slot: 0, episode: second.episode, step: 0 };
    let Ok(end_response::Frame::EpisodeEnd(end)) = end(&house, end_request::Frame::Abandon(abandon)).await
    else {
        panic!("no EpisodeEnd")
    };
    assert_eq!(end.reason(), v1::EndReason::Abandoned);
    let Outcome::RunEnd(end) = reset(&house).await else { panic!("an episode too many") };
    assert!(end.complete && house.host.finished());
    assert_eq!(house.host.ends(2).await, [Some(EndReason::Stopped), Some(EndReason::Abandoned)]);
}

#[tokio::test]
async fn refusals_are_statuses_and_harm_nothing() {
    let house = House::open(Plan::plain(1)).await;
    let early = step(&house, "ep_1", 1, FORWARD).await.unwrap_err();
    assert_eq!(reason(&early), "EPISODE_UNKNOWN");
    let episode = start(&house).await.episode;
    for (named, number, action, word) in [
        (episode.as_str(), 1, 9, "ACTION_OUT_OF_RANGE"),
        ("ep_other", 1, FORWARD, "EPISODE_UNKNOWN"),
        (&episode, 2, FORWARD, "STEP_AHEAD"),
        (&episode, 0, FORWARD, "STEP_CONFLICT"),
    ] {
        assert_eq!(reason(&step(&house, named, number, action).await.unwrap_err()), word);
    }
    let mut wider = hello(1);
    wider.sensors.as_mut().unwrap().width = 128;
    assert_eq!(reason(&reset_with(&house, wider).await.unwrap_err()), "SENSOR_NOT_ALLOWED");
    assert_eq!(step(&house, &episode, 1, FORWARD).await.unwrap().observation.unwrap().step, 1);
    assert_eq!(reason(&reset_with(&house, hello(1)).await.unwrap_err()), "SLOT_BUSY");
}

#[tokio::test]
async fn goodbye_closes_the_run() {
    let house = House::open(Plan::plain(2)).await;
    start(&house).await;
    let goodbye = end_request::Frame::Goodbye(v1::Goodbye { pause: false });
    let Ok(end_response::Frame::RunEnd(end)) = end(&house, goodbye).await else { panic!("no RunEnd") };
    assert_eq!((end.complete, end.progress.unwrap().done), (false, 1));
    assert_eq!(house.host.ends(1).await, [Some(EndReason::Abandoned)]);
}

#[tokio::test]
async fn a_caller_that_falls_silent_is_put_away() {
    let limits = Limits { unary_idle: Duration::from_millis(50), ..Limits::default() };
    let house = House::with_limits(Plan::plain(2), limits).await;
    start(&house).await;
    assert_eq!(house.host.ends(1).await, [Some(EndReason::Disconnected)]);
    house.still_serves().await;
}

#[tokio::test]
async fn time_that_ran_out_between_calls_is_told_at_the_next_step() {
    let hasty = TimeLimits { step_ms: 30, ..PATIENT };
    let house = House::open(Plan::timed(1, hasty)).await;
    let slow = start(&house).await.episode;
    assert_eq!(house.host.ends(1).await, [Some(EndReason::TimeBudget)]);
    let told = step(&house, &slow, 1, FORWARD).await.unwrap();
    assert_eq!(told.observation, None);
    assert_eq!(told.episode_end.unwrap().reason(), v1::EndReason::TimeBudget);
}

#[tokio::test]
async fn a_panic_in_the_simulator_ends_the_episode_and_not_the_run() {
    let house = House::open(Plan::odd(vec![Quirk::Stillborn, Quirk::Fragile, Quirk::None])).await;
    assert_eq!(reason(&reset_with(&house, hello(1)).await.unwrap_err()), "SIM_FAULT");
    let fragile = start(&house).await.episode;
    let told = step(&house, &fragile, 1, SUBMIT).await.unwrap();
    assert_eq!(told.episode_end.unwrap().reason(), v1::EndReason::ServerFault);
    assert_eq!(house.host.ends(2).await, [Some(EndReason::ServerFault); 2]);
    start(&house).await;
}

#[tokio::test]
async fn stopping_the_server_leaves_unary_episodes_for_the_next() {
    let house = House::open(Plan::plain(1)).await;
    let begun = start(&house).await.episode;
    let host = house.host.clone();
    soon(house.close()).await.unwrap();
    assert!(host.page(&begun).actions.is_empty(), "it is open still");
}

#[tokio::test]
async fn a_stream_supersedes_unary_play() {
    let house = House::open(Plan::plain(2)).await;
    let episode = start(&house).await.episode;
    let mut agent = Agent::enter(&house, 1).await;
    assert_eq!(house.host.ends(1).await, [Some(EndReason::Disconnected)]);
    assert_eq!(reason(&step(&house, &episode, 1, FORWARD).await.unwrap_err()), "EPISODE_UNKNOWN");
    agent.ready(0).await;
}

#[tokio::test]
async fn a_caller_goes_on_where_the_server_was_stopped() {
    let (book, plan) = (Book::default(), || {
        Plan::timed(2, TimeLimits { disconnect_s: 60, disconnect_total_s: 60, ..PATIENT })
    });
    let house = House::with_book(plan(), Limits::default(), book.clone()).await;
    let begun = start(&house).await.episode;
    step(&house, &begun, 1, FORWARD).await.unwrap();
    soon(house.close()).await.unwrap();
    let house = House::with_book(plan(), Limits::default(), book).await;
    assert_eq!(reason(&step(&house, &begun, 2, FORWARD).await.unwrap_err()), "EPISODE_UNKNOWN");
    let resumed = reset_with(&house, v1::Hello { resume: true, ..hello(1) }).await.unwrap();
    let Some(Outcome::EpisodeStart(again)) = resumed.outcome else { panic!("no episode") };
    assert_eq!((again.episode.as_str(), again.observation.unwrap().step), (begun.as_str(), 1));
    let told = step(&house, &begun, 2, STOP).await.unwrap();
    assert_eq!(told.episode_end.unwrap().reason(), v1::EndReason::Stopped);
}
