//! Lost connections and restarted servers: episodes continue.

use crate::common::{
    Agent, Book, PATIENT, Plan, RUN_TOKEN, TestServer, authorised, hello, play_client, reason, soon,
};
use avln_episode::{EndReason, TimeLimits};
use avln_grpc::Limits;
use avln_proto::v1::{
    self, Reason, play_request::Frame as Up, play_response::Frame as Down, reset_response::Outcome,
};
use std::time::Duration;
use tokio::time::sleep;
use tonic::Code;

const FORWARD: i32 = 1;
const LEFT: i32 = 2;
const STOP: i32 = 5;

fn forgiving() -> TimeLimits {
    TimeLimits { disconnect_s: 60, disconnect_total_s: 60, ..PATIENT }
}

async fn server(episodes: usize) -> TestServer {
    TestServer::open(Plan::timed(episodes, forgiving())).await
}

/// Starts an episode and takes some steps.
async fn walked(server: &TestServer, steps: u32) -> (Agent, String) {
    let mut agent = Agent::enter(server, 1).await;
    let episode = agent.ready(0).await.episode;
    for step in 1..=steps {
        agent.act(0, &episode, step, FORWARD).await;
        agent.observation().await;
    }
    (agent, episode)
}

#[tokio::test]
async fn a_lost_connection_costs_nothing() {
    let server = server(2).await;
    let (agent, episode) = walked(&server, 3).await;
    drop(agent);
    let mut agent = Agent::resume(&server, 1, &[(0, &episode, 3)]).await;
    assert_eq!(agent.welcome.resumed, [v1::SlotPosition { slot: 0, episode: episode.clone(), step: 3 }]);
    assert_eq!(agent.observation().await.step, 3, "the last observation is sent again");
    agent.act(0, &episode, 4, STOP).await;
    assert!(agent.observation().await.terminated);
    assert_eq!(agent.episode_end().await.reason(), v1::EndReason::Stopped);
    agent.ready(0).await;
    assert_eq!(server.host.concluded(1).await[0].steps, 4, "no step was lost or doubled");
}

#[tokio::test]
async fn a_lost_observation_is_sent_again() {
    let server = server(1).await;
    let (mut agent, episode) = walked(&server, 1).await;
    agent.act(0, &episode, 2, LEFT).await;
    agent.observation().await;
    drop(agent);
    let mut agent = Agent::resume(&server, 1, &[(0, &episode, 1)]).await;
    assert_eq!(agent.observation().await.step, 2);
    agent.act(0, &episode, 2, LEFT).await;
    assert_eq!(agent.observation().await.step, 2, "the same step again is no other step");
    agent.act(0, &episode, 2, FORWARD).await;
    assert_eq!(agent.fault().await.reason(), Reason::StepConflict);
}

#[tokio::test]
async fn an_unknown_mission_is_sent_again() {
    let server = server(1).await;
    let (agent, episode) = walked(&server, 2).await;
    drop(agent);
    let mut agent = Agent::resume(&server, 1, &[]).await;
    let start = agent.episode_start().await;
    assert_eq!((start.episode, start.ordinal, start.observation.unwrap().step), (episode, 1, 2));
    assert_eq!(start.mission.unwrap().goals.len(), 3);
}

#[tokio::test]
async fn a_lost_end_is_sent_again() {
    let server = server(2).await;
    let (agent, episode) = walked(&server, 1).await;
    agent.act(0, &episode, 2, STOP).await;
    server.host.concluded(1).await;
    drop(agent);
    let mut agent = Agent::resume(&server, 1, &[(0, &episode, 1)]).await;
    assert_eq!(agent.welcome.resumed, []);
    assert!(agent.observation().await.terminated);
    let end = agent.episode_end().await;
    assert_eq!((end.reason(), end.step), (v1::EndReason::Stopped, 2));
    agent.ready(0).await;
}

#[tokio::test]
async fn a_long_absence_costs_the_episode() {
    let brief = TimeLimits { disconnect_s: 1, disconnect_total_s: 60, ..PATIENT };
    let server = TestServer::open(Plan::timed(2, brief)).await;
    let (agent, episode) = walked(&server, 1).await;
    drop(agent);
    assert_eq!(server.host.ends(1).await, [Some(EndReason::Disconnected)]);
    let mut agent = Agent::resume(&server, 1, &[(0, &episode, 1)]).await;
    assert_eq!(agent.episode_end().await.reason(), v1::EndReason::Disconnected);
    agent.ready(0).await;
}

#[tokio::test]
async fn the_clock_of_a_received_observation_runs_on() {
    let hasty = TimeLimits { step_ms: 300, ..forgiving() };
    let server = TestServer::open(Plan::timed(1, hasty)).await;
    let (agent, episode) = walked(&server, 1).await;
    drop(agent);
    sleep(Duration::from_millis(400)).await;
    let mut agent = Agent::resume(&server, 1, &[(0, &episode, 1)]).await;
    loop {
        match agent.next().await.unwrap().unwrap() {
            Down::Observation(seen) => assert_eq!(seen.step, 1),
            Down::EpisodeEnd(end) => break assert_eq!(end.reason(), v1::EndReason::TimeBudget),
            other => panic!("{other:?}"),
        }
    }
}

#[tokio::test]
async fn the_clock_of_a_lost_observation_restarts() {
    let hasty = TimeLimits { step_ms: 300, ..forgiving() };
    let server = TestServer::open(Plan::timed(1, hasty)).await;
    let (agent, episode) = walked(&server, 2).await;
    drop(agent);
    sleep(Duration::from_millis(400)).await;
    let mut agent = Agent::resume(&server, 1, &[(0, &episode, 1)]).await;
    assert_eq!(agent.observation().await.step, 2);
    assert_eq!(server.host.page(&episode).restarts, 1);
    agent.act(0, &episode, 3, STOP).await;
    assert!(agent.observation().await.terminated);
}

#[tokio::test]
async fn resuming_takes_over_open_episodes() {
    let server = server(1).await;
    let (mut first, episode) = walked(&server, 2).await;
    let mut second = Agent::resume(&server, 1, &[(0, &episode, 2)]).await;
    assert_eq!(first.fault().await.reason(), Reason::Superseded);
    assert_eq!(first.next().await.unwrap_err().code(), Code::Aborted);
    assert_eq!(second.observation().await.step, 2);
    second.act(0, &episode, 3, STOP).await;
    assert!(second.observation().await.terminated);
}

#[tokio::test]
async fn unary_welcome_has_no_positions() {
    let server = server(1).await;
    let (_agent, episode) = walked(&server, 2).await;
    for step in 2..4 {
        let hello = Some(v1::Hello { resume: true, ..hello(1) });
        let request = authorised(v1::ResetRequest { hello, ready: None }, RUN_TOKEN);
        let answer = play_client(&server).await.reset(request).await.unwrap().into_inner();
        assert_eq!(answer.welcome.unwrap().resumed, [], "the position is in the answer");
        let Some(Outcome::EpisodeStart(start)) = answer.outcome else { panic!("no episode") };
        assert_eq!(start.observation.unwrap().step, step);
        let act = Some(v1::Act { episode: episode.clone(), step: step + 1, action: FORWARD, slot: 0 });
        play_client(&server).await.step(authorised(v1::StepRequest { act }, RUN_TOKEN)).await.unwrap();
    }
}

#[tokio::test]
async fn a_pause_is_no_loss() {
    let server = server(1).await;
    let (mut agent, episode) = walked(&server, 1).await;
    agent.send(Up::Goodbye(v1::Goodbye { pause: true })).await;
    assert!(agent.next().await.unwrap().is_none(), "the stream ends well");
    let mut agent = Agent::resume(&server, 1, &[(0, &episode, 1)]).await;
    assert_eq!(agent.observation().await.step, 1);
}

#[tokio::test]
async fn the_next_server_continues_open_episodes() {
    let book = Book::default();
    let plan = || Plan::timed(3, forgiving());
    let first = TestServer::with_book(plan(), Limits::default(), book.clone()).await;
    let mut agent = Agent::enter(&first, 2).await;
    let (left, right) = (agent.ready(0).await.episode, agent.ready(1).await.episode);
    agent.act(0, &left, 1, FORWARD).await;
    agent.observation().await;
    agent.act(1, &right, 1, LEFT).await;
    agent.observation().await;
    soon(first.close()).await.unwrap();
    let second = TestServer::with_book(plan(), Limits::default(), book).await;
    let mut agent = Agent::resume(&second, 2, &[(0, &left, 1), (1, &right, 0)]).await;
    assert_eq!(agent.welcome.resumed.len(), 2);
    assert_eq!(agent.welcome.progress.unwrap().in_flight, 2);
    for (slot, episode) in [(0, &left), (1, &right)] {
        let seen = agent.observation().await;
        assert_eq!((seen.slot, &seen.episode, seen.step), (slot, episode, 1));
    }
    agent.act(1, &right, 2, STOP).await;
    assert!(agent.observation().await.terminated);
    assert_eq!(second.host.concluded(1).await[0].steps, 2);
}

#[tokio::test]
async fn lowered_limit_keeps_slots_of_open_episodes() {
    let book = Book::default();
    let plan = |max_slots| Plan { max_slots, ..Plan::timed(3, forgiving()) };
    let first = TestServer::with_book(plan(2), Limits::default(), book.clone()).await;
    let mut agent = Agent::enter(&first, 2).await;
    let (left, right) = (agent.ready(0).await.episode, agent.ready(1).await.episode);
    soon(first.close()).await.unwrap();
    let second = TestServer::with_book(plan(1), Limits::default(), book).await;
    let mut agent = Agent::resume(&second, 2, &[(0, &left, 0), (1, &right, 0)]).await;
    assert_eq!((agent.welcome.slots, agent.welcome.resumed.len()), (2, 2));
    let slots = [agent.observation().await.slot, agent.observation().await.slot];
    assert_eq!(slots, [0, 1]);
    agent.act(1, &right, 1, STOP).await;
    assert!(agent.observation().await.terminated);
}

#[tokio::test]
async fn an_unknown_episode_cannot_be_resumed() {
    let server = server(1).await;
    let mut agent = Agent::resume(&server, 1, &[(0, "ep_of_another_run", 7)]).await;
    let fault = agent.fault().await;
    assert_eq!((fault.reason(), fault.recoverable), (Reason::EpisodeUnknown, true));
    agent.ready(0).await;
}

#[tokio::test]
async fn other_sensors_are_refused_on_resume() {
    let server = server(1).await;
    let (agent, episode) = walked(&server, 1).await;
    drop(agent);
    let mut blind = v1::Hello { resume: true, ..hello(1) };
    blind.sensors.as_mut().unwrap().wishes.clear();
    let mut refused = Agent::dial(&server, RUN_TOKEN, vec![Up::Hello(blind)]).await.unwrap();
    let status = refused.next().await.unwrap_err();
    assert_eq!(reason(&status), "SENSOR_NOT_ALLOWED");
    let both = "to 64 x 64, hfov 1.5 rad, RGB + DEPTH + AUDIO; request the same ones instead of 64 x 64";
    assert!(status.message().contains(both), "{status}");
    let mut agent = Agent::resume(&server, 1, &[(0, &episode, 1)]).await;
    assert_eq!(agent.observation().await.step, 1);
}

#[tokio::test]
async fn lowered_sensor_limits_spare_open_episodes() {
    let server = server(1).await;
    let (mut agent, episode) = walked(&server, 1).await;
    server.host.narrow(32);
    agent.send(Up::Goodbye(v1::Goodbye { pause: true })).await;
    assert!(agent.next().await.unwrap().is_none());
    let mut agent = Agent::resume(&server, 1, &[(0, &episode, 1)]).await;
    assert_eq!(agent.observation().await.step, 1);
    agent.goodbye().await;
    agent.episode_end().await;
    agent.run_end().await;
    assert!(agent.next().await.unwrap().is_none());
    server.host.refill();
    let fresh = v1::Hello { resume: true, ..hello(1) };
    let mut refused = Agent::dial(&server, RUN_TOKEN, vec![Up::Hello(fresh)]).await.unwrap();
    assert_eq!(reason(&refused.next().await.unwrap_err()), "SENSOR_NOT_ALLOWED", "no session is left");
}

#[tokio::test]
async fn a_finished_run_is_reported_on_resume() {
    let server = server(1).await;
    let (mut agent, episode) = walked(&server, 1).await;
    agent.goodbye().await;
    agent.episode_end().await;
    agent.run_end().await;
    let known = vec![v1::SlotPosition { slot: 0, episode: episode.clone(), step: 1 }];
    let hello = v1::Hello { resume: true, known, ..hello(1) };
    let mut agent = Agent::dial(&server, RUN_TOKEN, vec![Up::Hello(hello)]).await.unwrap();
    let end = agent.episode_end().await;
    assert_eq!((end.episode, end.step, end.progress.unwrap().done), (episode, 1, 1));
    assert_eq!(agent.run_end().await.progress.unwrap().done, 1);
    assert!(agent.next().await.unwrap().is_none());
}

#[tokio::test]
async fn slow_steps_are_charged_to_the_bank() {
    let chess = TimeLimits { step_ms: 50, bank_ms: 10_000, ..PATIENT };
    let server = TestServer::open(Plan::timed(1, chess)).await;
    let mut agent = Agent::enter(&server, 1).await;
    let start = agent.ready(0).await;
    assert_eq!(start.observation.unwrap().time.unwrap().bank_ms, 10_000);
    sleep(Duration::from_millis(350)).await;
    agent.act(0, &start.episode, 1, FORWARD).await;
    let left = agent.observation().await.time.unwrap().bank_ms;
    assert!((5_000..=9_750).contains(&left), "{left} ms are left of 10 s after 0.3 s beyond the step");
}
