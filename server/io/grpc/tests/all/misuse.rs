//! Agents that misbehave: each gets its reason, and no episode is harmed.

use crate::common::{ACCOUNT, Agent, House, Plan, RUN_TOKEN, authorised, hello, play_client, reason};
use avln_episode::EndReason;
use avln_grpc::Limits;
use avln_proto::v1::{self, Reason, play_request::Frame as Up};
use tonic::Code;

const FORWARD: i32 = 1;
const LEFT: i32 = 2;

#[tokio::test]
async fn tokens_are_checked_before_anything_else() {
    let house = House::open(Plan::plain(1)).await;
    let cases = [
        (tonic::Request::new(v1::ResetRequest::default()), Code::Unauthenticated, "TOKEN_MISSING"),
        (authorised(v1::ResetRequest::default(), "guess"), Code::Unauthenticated, "TOKEN_MALFORMED"),
        (authorised(v1::ResetRequest::default(), ACCOUNT), Code::PermissionDenied, "TOKEN_SCOPE"),
    ];
    for (request, code, word) in cases {
        let status = play_client(&house).await.reset(request).await.unwrap_err();
        assert_eq!((status.code(), reason(&status).as_str()), (code, word));
    }
    let status = Agent::dial(&house, "guess", vec![Up::Hello(hello(1))]).await.err().unwrap();
    assert_eq!((status.code(), reason(&status).as_str()), (Code::Unauthenticated, "TOKEN_MALFORMED"));
}

#[tokio::test]
async fn a_hello_that_cannot_be_met_is_answered_with_its_reason() {
    let house = House::open(Plan::plain(1)).await;
    let old = v1::ClientInfo { name: "old-client".into(), version: "1.9.9".into(), api_minor: 0 };
    let mut huge = hello(1);
    huge.sensors.as_mut().unwrap().width = 5000;
    let cases = [
        (Up::Ready(v1::Ready { slot: 0 }), "BAD_REQUEST"),
        (Up::Hello(v1::Hello { run: "run_other".into(), ..hello(1) }), "TOKEN_SCOPE"),
        (Up::Hello(v1::Hello { client: Some(old), ..hello(1) }), "CLIENT_TOO_OLD"),
        (Up::Hello(huge), "BAD_REQUEST"),
    ];
    for (first, word) in cases {
        let mut agent = Agent::dial(&house, RUN_TOKEN, vec![first]).await.unwrap();
        assert_eq!(reason(&agent.next().await.unwrap_err()), word);
    }
    house.still_serves().await;
}

#[tokio::test]
async fn more_slots_than_allowed_are_not_granted() {
    let house = House::open(Plan::plain(1)).await;
    assert_eq!(Agent::enter(&house, 1000).await.welcome.slots, 4);
    assert_eq!(Agent::enter(&house, 0).await.welcome.slots, 1);
}

#[tokio::test]
async fn frames_out_of_turn_are_refused_and_the_episode_goes_on() {
    let house = House::open(Plan::plain(1)).await;
    let mut agent = Agent::enter(&house, 2).await;
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
    assert_eq!(agent.fault().await.reason(), Reason::Unsupported);

    agent.act(0, &episode, 3, FORWARD).await;
    let next = agent.observation().await;
    assert_eq!((next.step, next.pose.unwrap().z_m), (3, -0.75), "three steps were taken, not one more");
}

#[tokio::test]
async fn a_repeated_step_yields_the_same_observation() {
    let house = House::open(Plan::plain(1)).await;
    let mut agent = Agent::enter(&house, 1).await;
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
    assert_eq!(house.host.concluded(1).await[0].steps, 2, "repeating took no step");
}

#[tokio::test]
async fn a_message_that_is_too_large_ends_its_own_stream_only() {
    let house = House::open(Plan::plain(1)).await;
    let mut agent = Agent::enter(&house, 1).await;
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
    assert_eq!(house.host.ends(1).await, [Some(EndReason::Disconnected)]);
    house.still_serves().await;
}

#[tokio::test]
async fn a_flood_of_frames_is_answered_and_harms_nobody() {
    let house = House::open(Plan::plain(1)).await;
    let mut agent = Agent::enter(&house, 1).await;
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
