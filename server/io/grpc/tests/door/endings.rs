//! How sessions end when something goes wrong: on the agent's side, in the simulator, in the server.

use crate::common::{Agent, House, PATIENT, Plan, Quirk, RUN_TOKEN, reason, soon};
use avln_episode::{EndReason, TimeLimits};
use avln_grpc::Limits;
use avln_proto::v1::{self, Reason, play_request::Frame as Up, play_response::Frame as Down};
use std::time::Duration;
use tonic::Code;

const FORWARD: i32 = 1;
const SUBMIT: i32 = 4;
const STOP: i32 = 5;

#[tokio::test]
async fn an_agent_that_vanishes_keeps_what_it_did() {
    let house = House::open(Plan::plain(2)).await;
    let mut agent = Agent::enter(&house, 1).await;
    let start = agent.ready(0).await;
    agent.act(0, &start.episode, 1, FORWARD).await;
    agent.observation().await;
    drop(agent);
    let concluded = house.host.concluded(1).await;
    assert_eq!((concluded[0].end, concluded[0].steps), (Some(EndReason::Disconnected), 1));
    house.still_serves().await;
}

#[tokio::test]
async fn a_stream_that_ends_without_goodbye_was_lost() {
    let house = House::open(Plan::plain(2)).await;
    let mut agent = Agent::enter(&house, 1).await;
    agent.ready(0).await;
    agent.hang_up();
    assert_eq!(house.host.ends(1).await, [Some(EndReason::Disconnected)]);
    assert!(!house.host.finished(), "the run can be played on");
}

#[tokio::test]
async fn an_agent_that_never_says_hello_is_let_go() {
    let limits = Limits { hello: Duration::from_millis(20), ..Limits::default() };
    let house = House::with_limits(Plan::plain(1), limits).await;
    let mut agent = Agent::dial(&house, RUN_TOKEN, vec![]).await.unwrap();
    let status = agent.next().await.unwrap_err();
    assert_eq!((status.code(), reason(&status).as_str()), (Code::DeadlineExceeded, "TOO_SLOW"));
}

#[tokio::test]
async fn an_agent_that_does_not_read_is_let_go() {
    let limits = Limits { reader_stall: Duration::from_millis(50), ..Limits::default() };
    let house = House::with_limits(Plan { max_steps: 1_000_000, ..Plan::plain(1) }, limits).await;
    let mut agent = Agent::enter(&house, 1).await;
    let start = agent.ready(0).await;
    // Every repetition is answered with a whole observation, and nobody reads them.
    agent.act(0, &start.episode, 1, FORWARD).await;
    let flood = async {
        loop {
            agent.act(0, &start.episode, 1, FORWARD).await;
            tokio::task::yield_now().await;
        }
    };
    tokio::select! {
        () = flood => {}
        ends = house.host.ends(1) => assert_eq!(ends, [Some(EndReason::Disconnected)]),
    }
}

#[tokio::test]
async fn the_second_stream_of_a_run_supersedes_the_first() {
    let house = House::open(Plan::plain(3)).await;
    let mut first = Agent::enter(&house, 1).await;
    first.ready(0).await;
    let mut second = Agent::enter(&house, 1).await;
    assert_eq!(house.host.ends(1).await, [Some(EndReason::Disconnected)]);
    assert_eq!(second.welcome.progress.unwrap().done, 1, "the first one's episode is counted");
    assert_eq!(first.episode_end().await.reason(), v1::EndReason::Disconnected);
    let fault = first.fault().await;
    assert_eq!((fault.reason(), fault.recoverable, fault.slot), (Reason::Superseded, false, None));
    let status = first.next().await.unwrap_err();
    assert_eq!((status.code(), reason(&status).as_str()), (Code::Aborted, "SUPERSEDED"));
    let start = second.ready(0).await;
    second.act(0, &start.episode, 1, STOP).await;
    assert!(second.observation().await.terminated);
}

#[tokio::test]
async fn a_panic_in_the_simulator_ends_one_episode() {
    let house = House::open(Plan::odd(vec![Quirk::Fragile, Quirk::None, Quirk::None])).await;
    let mut agent = Agent::enter(&house, 2).await;
    let (fragile, sound) = (agent.ready(0).await, agent.ready(1).await);
    agent.act(0, &fragile.episode, 1, SUBMIT).await;
    let fault = agent.fault().await;
    assert_eq!((fault.reason(), fault.recoverable, fault.slot), (Reason::SimFault, false, Some(0)));
    assert!(fault.id.starts_with("inc_") && !fault.message.contains("secret"), "{fault:?}");
    let end = agent.episode_end().await;
    assert_eq!((end.slot, end.reason()), (0, v1::EndReason::ServerFault));
    assert_eq!(house.host.ends(1).await, [Some(EndReason::ServerFault)]);

    agent.act(1, &sound.episode, 1, SUBMIT).await;
    assert_eq!(agent.observation().await.slot, 1);
    assert_eq!(agent.ready(0).await.slot, 0, "the slot itself goes on");
}

#[tokio::test]
async fn an_episode_that_cannot_start_is_not_the_agents_fault() {
    let house = House::open(Plan::odd(vec![Quirk::Stillborn, Quirk::None])).await;
    let mut agent = Agent::enter(&house, 1).await;
    agent.send(Up::Ready(v1::Ready { slot: 0 })).await;
    let fault = agent.fault().await;
    assert_eq!(fault.reason(), Reason::SimFault);
    assert!(!fault.message.contains("secret"), "{fault:?}");
    assert_eq!(house.host.ends(1).await, [Some(EndReason::ServerFault)]);
    assert_eq!(agent.ready(0).await.observation.unwrap().step, 0);
}

#[tokio::test]
async fn thinking_for_too_long_ends_the_episode() {
    let hasty = TimeLimits { step_ms: 30, ..PATIENT };
    let house = House::open(Plan::timed(2, hasty)).await;
    let mut agent = Agent::enter(&house, 1).await;
    assert_eq!(agent.welcome.time.unwrap().step_ms, 30);
    let start = agent.ready(0).await;
    let end = agent.episode_end().await;
    assert_eq!(
        (end.episode.clone(), end.reason(), end.terminated),
        (start.episode, v1::EndReason::TimeBudget, false)
    );
    assert_eq!(house.host.ends(1).await, [Some(EndReason::TimeBudget)]);
    agent.ready(0).await;
}

#[tokio::test]
async fn a_flood_of_refused_frames_buys_no_time() {
    let hasty = TimeLimits { step_ms: 50, ..PATIENT };
    let house = House::open(Plan::timed(1, hasty)).await;
    let mut agent = Agent::enter(&house, 1).await;
    let start = agent.ready(0).await;
    loop {
        agent.act(0, &start.episode, 1, 77).await;
        match agent.next().await.unwrap().unwrap() {
            Down::Fault(fault) => assert_eq!(fault.reason(), Reason::ActionOutOfRange),
            Down::EpisodeEnd(end) => break assert_eq!(end.reason(), v1::EndReason::TimeBudget),
            other => panic!("{other:?}"),
        }
    }
}

#[tokio::test]
async fn an_agent_that_hangs_loses_its_run_after_some_episodes() {
    let limits = Limits { timeouts_in_a_row: 3, ..Limits::default() };
    let hasty = TimeLimits { step_ms: 5, ..PATIENT };
    let house = House::with_limits(Plan::timed(9, hasty), limits).await;
    let mut agent = Agent::enter(&house, 1).await;
    for _ in 0..3 {
        agent.ready(0).await;
        assert_eq!(agent.episode_end().await.reason(), v1::EndReason::TimeBudget);
    }
    let fault = agent.fault().await;
    assert_eq!((fault.reason(), fault.recoverable), (Reason::TooSlow, false));
    assert!(!agent.run_end().await.complete);
    assert!(house.host.finished());
}

#[tokio::test]
async fn stopping_the_server_leaves_running_episodes_for_the_next() {
    let house = House::open(Plan::plain(3)).await;
    let mut agent = Agent::enter(&house, 1).await;
    let start = agent.ready(0).await;
    agent.act(0, &start.episode, 1, FORWARD).await;
    agent.observation().await;
    let host = house.host.clone();
    let closed = house.close();
    let Ok(Some(Down::Notice(notice))) = agent.next().await else { panic!("no Notice") };
    assert_eq!(notice.kind(), v1::NoticeKind::Draining);
    assert_eq!(agent.fault().await.reason(), Reason::Draining);
    let status = agent.next().await.unwrap_err();
    assert_eq!((status.code(), reason(&status).as_str()), (Code::Unavailable, "DRAINING"));
    assert!(status.metadata().contains_key(avln_proto::RETRY_AFTER_KEY));
    drop(agent);
    soon(closed).await.unwrap();
    assert_eq!(host.page(&start.episode).actions.len(), 1, "it is written down and not concluded");
    assert!(!host.finished(), "the run goes on when the server is back");
}
