//! Ends of sessions by faults of the agent, the simulator and the server.

use crate::common::{
    ACCOUNT, Agent, Book, PATIENT, Plan, Quirk, RUN_TOKEN, TestServer, ToyHost, authorised, hello, reason,
    soon,
};
use avln_episode::{EndReason, TimeLimits};
use avln_grpc::{Limits, LocalServer};
use avln_proto::v1::{
    self, Reason, play_request::Frame as Up, play_response::Frame as Down,
    play_service_client::PlayServiceClient,
};
use std::{sync::Arc, time::Duration};
use tokio::{
    sync::mpsc,
    time::{Instant, sleep},
};
use tokio_stream::wrappers::ReceiverStream;
use tonic::Code;

/// Request for a run of the only phase.
fn start_request() -> v1::StartRunRequest {
    let method = v1::MethodInfo { name: "late".into(), ..v1::MethodInfo::default() };
    v1::StartRunRequest { method: Some(method), ..v1::StartRunRequest::default() }
}

const FORWARD: i32 = 1;
const SUBMIT: i32 = 4;
const STOP: i32 = 5;

#[tokio::test]
async fn a_vanished_client_keeps_its_steps() {
    let server = TestServer::open(Plan::plain(2)).await;
    let mut agent = Agent::enter(&server, 1).await;
    let start = agent.ready(0).await;
    agent.act(0, &start.episode, 1, FORWARD).await;
    agent.observation().await;
    drop(agent);
    let concluded = server.host.concluded(1).await;
    assert_eq!((concluded[0].end, concluded[0].steps), (Some(EndReason::Disconnected), 1));
    server.still_serves().await;
}

#[tokio::test]
async fn a_stream_without_goodbye_counts_as_lost() {
    let server = TestServer::open(Plan::plain(2)).await;
    let mut agent = Agent::enter(&server, 1).await;
    agent.ready(0).await;
    agent.hang_up();
    assert_eq!(server.host.ends(1).await, [Some(EndReason::Disconnected)]);
    assert!(!server.host.finished(), "the run stays open");
}

#[tokio::test]
async fn a_stream_without_hello_is_closed() {
    let limits = Limits { hello: Duration::from_millis(20), ..Limits::default() };
    let server = TestServer::with_limits(Plan::plain(1), limits).await;
    let mut agent = Agent::dial(&server, RUN_TOKEN, vec![]).await.unwrap();
    let status = agent.next().await.unwrap_err();
    assert_eq!((status.code(), reason(&status).as_str()), (Code::DeadlineExceeded, "TOO_SLOW"));
}

#[tokio::test(start_paused = true)]
async fn clients_that_do_not_read_delay_no_stop() {
    // Without a network, which would store frames that the client does not read.
    let limits = Limits { max_simulations: 0, ..Limits::default() };
    let host = Arc::new(ToyHost::new(Plan::timed(1, PATIENT), Book::default()));
    let server = LocalServer::open(host, limits).await.unwrap();
    let (up, frames) = mpsc::channel(64);
    let flood = (0..60).map(|_| Up::Ready(v1::Ready { slot: 99 }));
    for frame in std::iter::once(Up::Hello(hello(1))).chain(flood) {
        up.send(v1::PlayRequest { frame: Some(frame) }).await.unwrap();
    }
    let mut client = PlayServiceClient::new(server.routes());
    let unread = client.play(authorised(ReceiverStream::new(frames), RUN_TOKEN)).await.unwrap();
    sleep(Duration::from_secs(1)).await;
    let before = Instant::now();
    server.close().await;
    assert!(before.elapsed() < Duration::from_secs(1), "{:?}", before.elapsed());
    drop(unread);
}

#[tokio::test]
async fn a_client_that_does_not_read_is_disconnected() {
    let limits = Limits { reader_stall: Duration::from_millis(50), ..Limits::default() };
    let server = TestServer::with_limits(Plan { max_steps: 1_000_000, ..Plan::plain(1) }, limits).await;
    let mut agent = Agent::enter(&server, 1).await;
    let start = agent.ready(0).await;
    // Every repetition is answered with a whole observation, which the agent does not read.
    agent.act(0, &start.episode, 1, FORWARD).await;
    let flood = async {
        loop {
            agent.act(0, &start.episode, 1, FORWARD).await;
            tokio::task::yield_now().await;
        }
    };
    tokio::select! {
        () = flood => {}
        ends = server.host.ends(1) => assert_eq!(ends, [Some(EndReason::Disconnected)]),
    }
}

#[tokio::test]
async fn a_second_stream_supersedes_the_first() {
    let server = TestServer::open(Plan::plain(3)).await;
    let mut first = Agent::enter(&server, 1).await;
    first.ready(0).await;
    let mut second = Agent::enter(&server, 1).await;
    assert_eq!(server.host.ends(1).await, [Some(EndReason::Disconnected)]);
    assert_eq!(second.welcome.progress.unwrap().done, 1, "the episode of the first stream counts");
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
    let server = TestServer::open(Plan::odd(vec![Quirk::Fragile, Quirk::None, Quirk::None])).await;
    let mut agent = Agent::enter(&server, 2).await;
    let (fragile, sound) = (agent.ready(0).await, agent.ready(1).await);
    agent.act(0, &fragile.episode, 1, SUBMIT).await;
    let fault = agent.fault().await;
    assert_eq!((fault.reason(), fault.recoverable, fault.slot), (Reason::SimFault, false, Some(0)));
    assert!(fault.id.starts_with("inc_") && !fault.message.contains("secret"), "{fault:?}");
    let end = agent.episode_end().await;
    assert_eq!((end.slot, end.reason()), (0, v1::EndReason::ServerFault));
    assert_eq!(server.host.ends(1).await, [Some(EndReason::ServerFault)]);

    agent.act(1, &sound.episode, 1, SUBMIT).await;
    assert_eq!(agent.observation().await.slot, 1);
    assert_eq!(agent.ready(0).await.slot, 0, "the slot continues");
}

#[tokio::test]
async fn a_failed_start_is_a_server_fault() {
    let server = TestServer::open(Plan::odd(vec![Quirk::Stillborn, Quirk::None])).await;
    let mut agent = Agent::enter(&server, 1).await;
    agent.send(Up::Ready(v1::Ready { slot: 0 })).await;
    let fault = agent.fault().await;
    assert_eq!(fault.reason(), Reason::SimFault);
    assert!(!fault.message.contains("secret"), "{fault:?}");
    assert_eq!(server.host.ends(1).await, [Some(EndReason::ServerFault)]);
    assert_eq!(agent.ready(0).await.observation.unwrap().step, 0);
}

#[tokio::test]
async fn a_hanging_step_costs_only_its_episode() {
    let (go_on, wait) = std::sync::mpsc::channel();
    let limits = Limits { step: Duration::from_millis(100), max_simulations: 1, ..Limits::default() };
    let limits = Limits { max_hanging: 1, ..limits };
    let server = TestServer::with_limits(Plan::odd(vec![Quirk::Slow(wait), Quirk::None]), limits).await;
    let mut agent = Agent::enter(&server, 2).await;
    let (hangs, sound) = (agent.ready(0).await, agent.ready(1).await);
    agent.act(0, &hangs.episode, 1, FORWARD).await;
    let fault = agent.fault().await;
    assert_eq!((fault.reason(), fault.recoverable, fault.slot), (Reason::SimFault, false, Some(0)));
    assert_eq!(fault.episode, hangs.episode);
    let end = agent.episode_end().await;
    assert_eq!((end.slot, end.step, end.reason()), (0, 0, v1::EndReason::ServerFault));
    assert_eq!(server.host.lost(), std::slice::from_ref(&hangs.episode), "the host plays it again");

    agent.act(1, &sound.episode, 1, FORWARD).await;
    assert_eq!(agent.observation().await.slot, 1, "another thread replaced the hanging one");
    let mut team = server.runs().await;
    let start = || authorised(v1::StartRunRequest { phase: "practice".into(), ..start_request() }, ACCOUNT);
    let refused = team.start_run(start()).await.unwrap_err();
    assert_eq!((refused.code(), reason(&refused).as_str()), (Code::ResourceExhausted, "NO_CAPACITY"));
    assert!(refused.message().contains("1 simulations of the server hang"), "{refused}");
    assert_eq!(agent.ready(0).await.slot, 0, "running runs continue");

    go_on.send(()).unwrap();
    soon(async {
        while team.start_run(start()).await.is_err() {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    })
    .await;
    assert_eq!(server.host.concluded(0).await.len(), 0, "a late result does not count");
}

#[tokio::test]
async fn a_hanging_start_is_abandoned() {
    let (_never, wait) = std::sync::mpsc::channel();
    let limits = Limits { preparation: Duration::from_millis(100), ..Limits::default() };
    let server = TestServer::with_limits(Plan::odd(vec![Quirk::SlowStart(wait), Quirk::None]), limits).await;
    let mut agent = Agent::enter(&server, 1).await;
    agent.send(Up::Ready(v1::Ready { slot: 0 })).await;
    assert_eq!(agent.fault().await.reason(), Reason::SimFault);
    assert_eq!(server.host.lost().len(), 1);
    assert_eq!(agent.ready(0).await.observation.unwrap().step, 0);
}

#[tokio::test]
async fn an_expired_run_ends_with_its_episodes() {
    let limits = Limits { overdue_interval: Duration::from_millis(50), ..Limits::default() };
    let server = TestServer::with_limits(Plan::plain(3), limits).await;
    let mut agent = Agent::enter(&server, 1).await;
    assert_eq!(agent.welcome.run_deadline_unix_ms, 0, "no deadline");
    let start = agent.ready(0).await;
    agent.act(0, &start.episode, 1, FORWARD).await;
    agent.observation().await;
    server.host.time_is_over();
    let Ok(Some(Down::Notice(notice))) = agent.next().await else { panic!("no Notice") };
    assert_eq!(notice.kind(), v1::NoticeKind::BudgetLow);
    let end = agent.episode_end().await;
    assert_eq!((end.step, end.reason(), end.terminated), (1, v1::EndReason::TimeBudget, false));
    assert!(!agent.run_end().await.complete);
    assert!(agent.next().await.unwrap().is_none(), "the stream ends well");
    assert!(server.host.expired());
    assert_eq!(server.host.ends(1).await, [Some(EndReason::TimeBudget)]);
    let mut late = Agent::dial(&server, RUN_TOKEN, vec![Up::Hello(hello(1))]).await.unwrap();
    assert_eq!(reason(&late.next().await.unwrap_err()), "RUN_OVER");
}

#[tokio::test]
async fn a_run_expires_while_its_client_is_disconnected() {
    let away = TimeLimits { disconnect_s: 600, disconnect_total_s: 600, ..PATIENT };
    let limits = Limits { overdue_interval: Duration::from_millis(50), ..Limits::default() };
    let server = TestServer::with_limits(Plan::timed(2, away), limits).await;
    let mut agent = Agent::enter(&server, 1).await;
    agent.ready(0).await;
    drop(agent);
    server.host.time_is_over();
    assert_eq!(server.host.ends(1).await, [Some(EndReason::TimeBudget)]);
    assert!(server.host.expired());
}

#[tokio::test]
async fn clients_are_warned_before_the_deadline() {
    let server = TestServer::open(Plan::plain(1)).await;
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap();
    let deadline = i64::try_from(now.as_millis()).unwrap() + 100_000;
    server.host.ends_at(deadline);
    let mut agent = Agent::enter(&server, 1).await;
    assert_eq!(agent.welcome.run_deadline_unix_ms, deadline);
    let ping = agent.ping().await;
    assert!((90..=100).contains(&ping.run_remaining_s()), "{ping:?}");
    let Ok(Some(Down::Notice(notice))) = agent.next().await else { panic!("no Notice") };
    assert_eq!((notice.kind(), notice.effective_unix_ms), (v1::NoticeKind::BudgetLow, deadline));
}

#[tokio::test]
async fn thinking_for_too_long_ends_the_episode() {
    let hasty = TimeLimits { step_ms: 30, ..PATIENT };
    let server = TestServer::open(Plan::timed(2, hasty)).await;
    let mut agent = Agent::enter(&server, 1).await;
    assert_eq!(agent.welcome.time.unwrap().step_ms, 30);
    let start = agent.ready(0).await;
    let end = agent.episode_end().await;
    assert_eq!(
        (end.episode.clone(), end.reason(), end.terminated),
        (start.episode, v1::EndReason::TimeBudget, false)
    );
    assert_eq!(server.host.ends(1).await, [Some(EndReason::TimeBudget)]);
    agent.ready(0).await;
}

#[tokio::test]
async fn refused_frames_buy_no_time() {
    let hasty = TimeLimits { step_ms: 50, ..PATIENT };
    let server = TestServer::open(Plan::timed(1, hasty)).await;
    let mut agent = Agent::enter(&server, 1).await;
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
async fn a_hanging_agent_loses_its_run() {
    let limits = Limits { timeouts_in_a_row: 3, ..Limits::default() };
    let hasty = TimeLimits { step_ms: 5, ..PATIENT };
    let server = TestServer::with_limits(Plan::timed(9, hasty), limits).await;
    let mut agent = Agent::enter(&server, 1).await;
    for _ in 0..3 {
        agent.ready(0).await;
        assert_eq!(agent.episode_end().await.reason(), v1::EndReason::TimeBudget);
    }
    let fault = agent.fault().await;
    assert_eq!((fault.reason(), fault.recoverable), (Reason::TooSlow, false));
    assert!(!agent.run_end().await.complete);
    assert!(server.host.cancelled() && !server.host.finished());
    let mut again = Agent::dial(&server, RUN_TOKEN, vec![Up::Hello(hello(1))]).await.unwrap();
    assert_eq!(reason(&again.next().await.unwrap_err()), "RUN_OVER");
}

#[tokio::test]
async fn open_episodes_survive_a_stop_of_the_server() {
    let server = TestServer::open(Plan::plain(3)).await;
    let mut agent = Agent::enter(&server, 1).await;
    let start = agent.ready(0).await;
    agent.act(0, &start.episode, 1, FORWARD).await;
    agent.observation().await;
    let host = server.host.clone();
    let closed = server.close();
    let Ok(Some(Down::Notice(notice))) = agent.next().await else { panic!("no Notice") };
    assert_eq!(notice.kind(), v1::NoticeKind::Unspecified, "open episodes cannot finish");
    assert_eq!(agent.fault().await.reason(), Reason::Draining);
    let status = agent.next().await.unwrap_err();
    assert_eq!((status.code(), reason(&status).as_str()), (Code::Unavailable, "DRAINING"));
    assert!(status.metadata().contains_key(avln_proto::RETRY_AFTER_KEY));
    drop(agent);
    soon(closed).await.unwrap();
    assert_eq!(host.page(&start.episode).actions.len(), 1, "it is logged and not concluded");
    assert!(!host.finished(), "the run stays open for the next server");
}
