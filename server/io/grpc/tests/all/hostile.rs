//! Misuse and attacks: every fault has a reason, and other agents are not affected.

use crate::common::{
    ACCOUNT, Agent, Attack, Plan, RUN_TOKEN, Siege, TestServer, authorised, hello, play_client, reason, soon,
};
use avln_episode::EndReason;
use avln_grpc::Limits;
use avln_proto::v1::{self, Reason, play_request::Frame as Up};
use std::time::Duration;
use tokio::{io::AsyncReadExt, net::TcpStream, time::sleep};
use tonic::Code;

const FORWARD: i32 = 1;
const LEFT: i32 = 2;

#[tokio::test]
async fn tokens_are_checked_first() {
    let server = TestServer::open(Plan::plain(1)).await;
    let cases = [
        (tonic::Request::new(v1::ResetRequest::default()), Code::Unauthenticated, "TOKEN_MISSING"),
        (authorised(v1::ResetRequest::default(), "guess"), Code::Unauthenticated, "TOKEN_MALFORMED"),
        (authorised(v1::ResetRequest::default(), ACCOUNT), Code::PermissionDenied, "TOKEN_SCOPE"),
    ];
    for (request, code, word) in cases {
        let status = play_client(&server).await.reset(request).await.unwrap_err();
        assert_eq!((status.code(), reason(&status).as_str()), (code, word));
    }
    let status = Agent::dial(&server, "guess", vec![Up::Hello(hello(1))]).await.err().unwrap();
    assert_eq!((status.code(), reason(&status).as_str()), (Code::Unauthenticated, "TOKEN_MALFORMED"));
}

#[tokio::test]
async fn an_impossible_hello_is_refused_with_its_reason() {
    let server = TestServer::open(Plan::plain(1)).await;
    let old = v1::ClientInfo { name: "old-client".into(), version: "1.9.9".into(), api_minor: 0 };
    let mut huge = hello(1);
    huge.sensors.as_mut().unwrap().width = 5000;
    let mut wide = hello(1);
    wide.sensors.as_mut().unwrap().width = 600;
    let cases = [
        (Up::Ready(v1::Ready { slot: 0 }), "BAD_REQUEST"),
        (Up::Hello(v1::Hello { run: "run_other".into(), ..hello(1) }), "TOKEN_SCOPE"),
        (Up::Hello(v1::Hello { client: Some(old), ..hello(1) }), "CLIENT_TOO_OLD"),
        (Up::Hello(huge), "BAD_REQUEST"),
        (Up::Hello(wide), "SENSOR_NOT_ALLOWED"),
    ];
    for (first, word) in cases {
        let mut agent = Agent::dial(&server, RUN_TOKEN, vec![first]).await.unwrap();
        assert_eq!(reason(&agent.next().await.unwrap_err()), word);
    }
    server.still_serves().await;
}

#[tokio::test]
async fn slots_are_granted_up_to_the_limit() {
    let server = TestServer::open(Plan::plain(1)).await;
    assert_eq!(Agent::enter(&server, 1000).await.welcome.slots, 4);
    assert_eq!(Agent::enter(&server, 0).await.welcome.slots, 1);
}

#[tokio::test]
async fn frames_out_of_turn_are_refused() {
    let server = TestServer::open(Plan::plain(1)).await;
    let mut agent = Agent::enter(&server, 2).await;
    let episode = agent.ready(0).await.episode;
    agent.act(0, &episode, 1, FORWARD).await;
    agent.observation().await;
    agent.act(0, &episode, 2, FORWARD).await;
    agent.observation().await;

    let act =
        |slot, episode: &str, step, action| Up::Act(v1::Act { slot, episode: episode.into(), step, action });
    let cases = [
        (act(0, &episode, 3, 0), Reason::ActionOutOfRange),
        (act(0, &episode, 3, 6), Reason::ActionOutOfRange),
        (act(0, &episode, 3, -7), Reason::ActionOutOfRange),
        (act(0, "ep_other", 3, FORWARD), Reason::EpisodeUnknown),
        (act(1, &episode, 3, FORWARD), Reason::SlotUnknown),
        (act(2, &episode, 3, FORWARD), Reason::SlotUnknown),
        (act(0, &episode, 4, FORWARD), Reason::StepAhead),
        (act(0, &episode, u32::MAX, FORWARD), Reason::StepAhead),
        (act(0, &episode, 2, LEFT), Reason::StepConflict),
        (act(0, &episode, 1, FORWARD), Reason::StepConflict),
        (act(0, &episode, 0, FORWARD), Reason::StepConflict),
        (Up::Ready(v1::Ready { slot: 0 }), Reason::SlotBusy),
        (Up::Ready(v1::Ready { slot: 9 }), Reason::SlotUnknown),
        (Up::Abandon(v1::Abandon { slot: 0, episode: "ep_other".into(), step: 2 }), Reason::EpisodeUnknown),
        (Up::Abandon(v1::Abandon { slot: 0, episode: episode.clone(), step: 9 }), Reason::StepAhead),
        (Up::Hello(hello(1)), Reason::BadRequest),
    ];
    for (frame, reason) in cases {
        agent.send(frame.clone()).await;
        let fault = agent.fault().await;
        assert_eq!(fault.reason(), reason, "{frame:?} was answered {fault:?}");
        assert_eq!(fault.code, reason.code() as u32);
        assert!(fault.recoverable && !fault.message.is_empty());
        if let Up::Act(act) = frame {
            assert_eq!((fault.slot, fault.step), (Some(act.slot), act.step));
        }
    }
    agent.send_raw(v1::PlayRequest { frame: None }).await;
    let fault = agent.fault().await;
    assert_eq!(fault.reason(), Reason::Unsupported);
    assert!(fault.message.contains("this server knows minor 0: Hello, Ready"), "{}", fault.message);

    agent.act(0, &episode, 3, FORWARD).await;
    let next = agent.observation().await;
    assert_eq!((next.step, next.pose.unwrap().z_m), (3, -0.75), "three steps were taken, not one more");
}

#[tokio::test]
async fn a_repeated_step_yields_the_same_observation() {
    let server = TestServer::open(Plan::plain(1)).await;
    let mut agent = Agent::enter(&server, 1).await;
    let episode = agent.ready(0).await.episode;
    agent.act(0, &episode, 1, FORWARD).await;
    let first = agent.observation().await;
    agent.act(0, &episode, 1, FORWARD).await;
    assert_eq!(agent.observation().await, first);
    agent.act(0, &episode, 2, 5).await;
    let last = agent.observation().await;
    let end = agent.episode_end().await;
    agent.act(0, &episode, 2, 5).await;
    assert_eq!((agent.observation().await, agent.episode_end().await), (last, end));
    agent.act(0, &episode, 3, FORWARD).await;
    let fault = agent.fault().await;
    assert_eq!((fault.reason(), fault.episode), (Reason::EpisodeOver, episode));
    assert_eq!(server.host.concluded(1).await[0].steps, 2, "repeating took no step");
}

#[tokio::test]
async fn an_oversized_message_ends_only_its_stream() {
    let server = TestServer::open(Plan::plain(1)).await;
    let mut agent = Agent::enter(&server, 1).await;
    agent.ready(0).await;
    agent.act(0, &"x".repeat(Limits::default().decode_bytes + 1), 1, FORWARD).await;
    let status = loop {
        match agent.next().await {
            Ok(Some(_)) => {}
            Ok(None) => panic!("the stream ended well"),
            Err(status) => break status,
        }
    };
    assert_eq!(reason(&status), "BAD_REQUEST");
    assert_eq!(server.host.ends(1).await, [Some(EndReason::Disconnected)]);
    server.still_serves().await;
}

#[tokio::test]
async fn a_flood_of_frames_is_answered() {
    let server = TestServer::open(Plan::plain(1)).await;
    let mut agent = Agent::enter(&server, 1).await;
    let episode = agent.ready(0).await.episode;
    for _ in 0..200 {
        agent.act(0, &episode, 1, FORWARD).await;
    }
    let (mut answers, mut refusals) = (0, 0);
    for _ in 0..200 {
        match agent.next().await.unwrap().unwrap() {
            v1::play_response::Frame::Observation(observation) => {
                assert_eq!(observation.step, 1);
                answers += 1;
            }
            v1::play_response::Frame::Fault(fault) => {
                assert_eq!((fault.reason(), fault.recoverable), (Reason::BadRequest, true));
                refusals += 1;
            }
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(answers + refusals, 200);
    assert!(answers >= 1);
    agent.act(0, &episode, 2, FORWARD).await;
    assert_eq!(agent.observation().await.step, 2);
}

#[tokio::test(flavor = "multi_thread")]
async fn agents_play_during_attacks() {
    for attack in Attack::ALL {
        let server = TestServer::open(Plan { max_steps: 1000, ..Plan::plain(2) }).await;
        let mut agent = Agent::enter(&server, 1).await;
        let start = agent.ready(0).await;
        let siege = Siege::lay(attack, server.address, 20);
        sleep(Duration::from_millis(200)).await;
        for step in 1..=50 {
            agent.act(0, &start.episode, step, FORWARD).await;
            assert_eq!(agent.observation().await.step, step, "{attack:?}");
        }
        let newcomer = TcpStream::connect(server.address).await;
        assert!(newcomer.is_ok(), "{attack:?}: no other client can connect");
        drop(siege);
        agent.goodbye().await;
        agent.episode_end().await;
        agent.run_end().await;
        server.still_serves().await;
    }
}

#[tokio::test]
async fn a_slow_client_loses_its_connection() {
    let limits = Limits { first_request: Duration::from_millis(300), ..Limits::default() };
    let server = TestServer::with_limits(Plan::plain(1), limits).await;
    let mut silent = TcpStream::connect(server.address).await.unwrap();
    let loris = tokio::spawn(Attack::SlowLoris.once(server.address));
    let mut rest = Vec::new();
    // The server sends its settings and then closes, with or without a reset.
    let _ = soon(silent.read_to_end(&mut rest)).await;
    assert!(soon(loris).await.unwrap().is_err(), "the server closes although bytes arrive");
}

#[tokio::test]
async fn thousands_of_idle_connections_are_bounded() {
    let limits = Limits { max_connections: 128, max_connections_per_address: 64, ..Limits::default() };
    let server = TestServer::with_limits(Plan::plain(1), limits).await;
    let mut idle = Vec::new();
    for _ in 0..64 {
        idle.push(TcpStream::connect(server.address).await.unwrap());
    }
    let mut refused = TcpStream::connect(server.address).await.unwrap();
    let mut rest = Vec::new();
    let _ = soon(refused.read_to_end(&mut rest)).await;
    assert!(rest.is_empty(), "a connection above the limit receives nothing");
    drop(idle);
    soon(async {
        while !server.answers().await {
            sleep(Duration::from_millis(20)).await;
        }
    })
    .await;
    server.still_serves().await;
}
