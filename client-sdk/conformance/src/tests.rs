//! Clients with and without errors, checked by the test server.

use crate::host::Host;
use crate::scenario::{InjectedFault as F, Scenario, Trial};
use crate::talk::{Connection, Site, Stream, bearer, hello, reason};
use crate::{Check, Outcome};
use avln_proto::v1::{
    self, info_service_client::InfoServiceClient, play_request::Frame as Up, play_response::Frame as Down,
    reset_response,
};
use std::ops::RangeInclusive;
use tokio::task::JoinHandle;
use tonic::{Code, Status};

const FORWARD: i32 = v1::Action::MoveForward as i32;

type Checking = JoinHandle<Vec<Check>>;

async fn serve(host: Host) -> (Connection, Checking) {
    let url = format!("http://{}", host.address);
    let checking = tokio::spawn(host.check());
    let server = Connection::open(&Site { server: &url, ca: None }, "any", "any").await.unwrap();
    (server, checking)
}

async fn hosted(trials: &'static [Trial]) -> (Connection, Checking) {
    serve(Host::with_trials("127.0.0.1:0".parse().unwrap(), trials).await.unwrap()).await
}

fn broken(check: &Check) -> &str {
    let Outcome::Broken(why) = &check.outcome else { panic!("{check:?}") };
    why
}

fn outcomes(checks: &[Check]) -> Vec<&Outcome> {
    checks.iter().map(|check| &check.outcome).collect()
}

async fn take_steps(stream: &mut Stream, slot: u32, episode: &str, steps: RangeInclusive<u32>) {
    for step in steps {
        stream.act_in(slot, episode, step, FORWARD).await;
        let seen = stream.observation().await.unwrap();
        assert_eq!((seen.slot, seen.step), (slot, step));
    }
}

async fn expect_run_end(stream: &mut Stream, complete: bool) {
    let Down::RunEnd(end) = stream.next().await.unwrap() else { panic!("expected RunEnd") };
    assert_eq!(end.complete, complete, "{end:?}");
    assert!(matches!(stream.next_or_end().await, Ok(Ok(None))));
}

async fn expect_status(stream: &mut Stream) -> Status {
    match stream.next_or_end().await.unwrap() {
        Err(status) => status,
        Ok(frame) => panic!("expected a status, got {frame:?}"),
    }
}

async fn expect_fault(stream: &mut Stream) -> v1::Fault {
    let Down::Fault(fault) = stream.next().await.unwrap() else { panic!("expected Fault") };
    fault
}

fn at(slot: u32, episode: &str, step: u32) -> v1::SlotPosition {
    v1::SlotPosition { slot, episode: episode.to_owned(), step }
}

fn resume(known: &[v1::SlotPosition]) -> v1::Hello {
    v1::Hello { resume: true, known: known.to_vec(), ..hello() }
}

fn two_slots() -> v1::Hello {
    v1::Hello { slots: 2, ..hello() }
}

#[tokio::test]
async fn a_client_that_breaks_rules_is_found_out() {
    let host = Host::bind("127.0.0.1:0".parse().unwrap(), Scenario::Faults).await.unwrap();
    let (server, checking) = serve(host).await;
    let (mut stream, _) = server.enter(hello()).await.unwrap();
    let episode = stream.start().await.unwrap().episode;
    stream.act(&episode, 5, 1).await;
    stream.refusal(v1::Reason::StepAhead).await.unwrap();
    stream.act(&episode, 1, 1).await;
    stream.observation().await.unwrap();
    stream.act(&episode, 1, 2).await;
    stream.refusal(v1::Reason::StepConflict).await.unwrap();
    drop(stream);
    let (stream, _) = server.enter(hello()).await.unwrap();
    stream.send(Up::Goodbye(v1::Goodbye { pause: false })).await;
    let checks = checking.await.unwrap();
    let first = broken(&checks[0]);
    for what in
        ["step: expected 1, got 5", "resent action of step 1: expected 1, got 2", "left an intact stream"]
    {
        assert!(first.contains(what), "{first}");
    }
    let (slots, episodes) = checks.split_last().unwrap();
    assert!(
        episodes[1..].iter().all(|check| broken(check) == "the client did not reach this episode"),
        "{checks:?}"
    );
    assert_eq!(slots.outcome, Outcome::NotOffered);
}

#[tokio::test]
async fn server_and_phase_are_described() {
    let (server, _) = hosted(&[(F::None, "plays")]).await;
    let mut client = InfoServiceClient::new(server.channel.clone());
    let info = client.get_server_info(v1::GetServerInfoRequest {}).await.unwrap().into_inner();
    assert_eq!(info.state(), v1::ServerState::Up);
    assert_eq!((info.benchmark.as_str(), info.max_request_bytes), ("0.0.0", 65_536));
    assert_eq!(info.encodings, [v1::Encoding::Raw as i32]);
    let phases = client.list_phases(v1::ListPhasesRequest {}).await.unwrap().into_inner().phases;
    let [phase] = phases.as_slice() else { panic!("{phases:?}") };
    assert_eq!((phase.id.as_str(), phase.state()), ("conformance", v1::PhaseState::Open));
    assert_eq!((phase.episodes, phase.max_slots, phase.max_side), (1, 2, 512));
    let method = server.run.method.clone().unwrap_or_default();
    assert_eq!((server.run.phase.as_str(), method.name.as_str()), ("any", "conformance"));
    assert_eq!(method.method_type(), v1::MethodType::TrainingFree);
    assert_eq!(server.run.order(), v1::Order::Unordered);
    let (_, welcome) = server.enter(hello()).await.unwrap();
    let names: Vec<_> = welcome.tensors.iter().map(|spec| (spec.name.as_str(), spec.maximum)).collect();
    assert_eq!(names, [("rgb", 255.0), ("depth", 10.0), ("audio", 1.0)]);
}

async fn status(server: &Connection) -> v1::Run {
    let request = v1::GetRunRequest { run: server.run.id.clone() };
    server.runs().get_run(bearer(request, "any")).await.unwrap().into_inner().run.unwrap()
}

#[tokio::test]
async fn run_status_follows_the_episodes() {
    let (server, checking) = hosted(&[(F::None, "plays")]).await;
    assert_eq!(status(&server).await.state(), v1::RunState::Created);
    let (mut stream, _) = server.enter(hello()).await.unwrap();
    let episode = stream.start().await.unwrap().episode;
    let running = status(&server).await;
    assert_eq!((running.state(), running.ended_unix_ms), (v1::RunState::Running, 0));
    take_steps(&mut stream, 0, &episode, 1..=6).await;
    let progress = stream.end().await.unwrap().progress.unwrap();
    assert_eq!((progress.total, progress.done, progress.in_flight), (1, 1, 0));
    stream.send(Up::Ready(v1::Ready { slot: 0 })).await;
    expect_run_end(&mut stream, true).await;
    let over = status(&server).await;
    assert_eq!(over.state(), v1::RunState::Completed);
    assert!(over.ended_unix_ms > 0);
    assert_eq!(outcomes(&checking.await.unwrap()), [&Outcome::Kept]);
}

const BROKEN_WITH_TWO: &[Trial] = &[(F::None, "plays"), (F::BrokenStream, "resumes")];

#[tokio::test]
async fn two_slots_resume_together() {
    let (server, checking) = hosted(BROKEN_WITH_TWO).await;
    let (mut stream, welcome) = server.enter(two_slots()).await.unwrap();
    assert_eq!(welcome.slots, 2);
    let first = stream.start_in(0).await.unwrap().episode;
    let second = stream.start_in(1).await.unwrap();
    assert_eq!(second.slot, 1);
    take_steps(&mut stream, 0, &first, 1..=1).await;
    take_steps(&mut stream, 1, &second.episode, 1..=2).await;
    assert_eq!(expect_status(&mut stream).await.code(), Code::Unavailable);
    let known = [at(0, &first, 1), at(1, &second.episode, 2)];
    let (mut stream, welcome) = server.enter(v1::Hello { slots: 2, ..resume(&known) }).await.unwrap();
    assert_eq!(welcome.resumed, known);
    for (slot, step) in [(0, 1), (1, 2)] {
        let seen = stream.observation().await.unwrap();
        assert_eq!((seen.slot, seen.step), (slot, step));
    }
    take_steps(&mut stream, 0, &first, 2..=6).await;
    assert_eq!(stream.end().await.unwrap().slot, 0);
    // Answered by RunEnd, after the other slot has finished.
    stream.send(Up::Ready(v1::Ready { slot: 0 })).await;
    take_steps(&mut stream, 1, &second.episode, 3..=6).await;
    assert_eq!(stream.end().await.unwrap().slot, 1);
    expect_run_end(&mut stream, true).await;
    assert_eq!(outcomes(&checking.await.unwrap()), [&Outcome::Kept; 3]);
}

#[tokio::test]
async fn forgotten_second_slot_is_reported() {
    let (server, checking) = hosted(BROKEN_WITH_TWO).await;
    let (mut stream, _) = server.enter(two_slots()).await.unwrap();
    let first = stream.start_in(0).await.unwrap().episode;
    let second = stream.start_in(1).await.unwrap().episode;
    take_steps(&mut stream, 1, &second, 1..=2).await;
    expect_status(&mut stream).await;
    let (stream, _) = server.enter(resume(&[at(0, &first, 0)])).await.unwrap();
    stream.send(Up::Goodbye(v1::Goodbye { pause: false })).await;
    let checks = checking.await.unwrap();
    assert!(broken(&checks[1]).contains("Hello.known of slot 1"), "{checks:?}");
    assert!(broken(&checks[2]).contains("Hello.known of slot 1"), "{checks:?}");
}

#[tokio::test]
async fn unknown_and_busy_slots_are_distinguished() {
    let (server, checking) = hosted(&[(F::None, "plays")]).await;
    let (mut stream, _) = server.enter(hello()).await.unwrap();
    stream.start().await.unwrap();
    for (slot, why) in [(0, v1::Reason::SlotBusy), (1, v1::Reason::SlotUnknown)] {
        stream.send(Up::Ready(v1::Ready { slot })).await;
        stream.refusal(why).await.unwrap();
    }
    stream.send(Up::Goodbye(v1::Goodbye { pause: false })).await;
    let checks = checking.await.unwrap();
    let why = broken(&checks[0]);
    assert!(why.contains("slot 0: the slot is busy"), "{why}");
    assert!(why.contains("slot 1: the slot does not exist"), "{why}");
}

/// Plays to step 2 of the only trial; returns the stream and the handle.
async fn play_to_fault(server: &Connection) -> (Stream, String) {
    let (mut stream, _) = server.enter(hello()).await.unwrap();
    let episode = stream.start().await.unwrap().episode;
    take_steps(&mut stream, 0, &episode, 1..=2).await;
    (stream, episode)
}

/// Plays on from step 3 to RunEnd.
async fn play_to_end(stream: &mut Stream, episode: &str) {
    take_steps(stream, 0, episode, 3..=6).await;
    stream.end().await.unwrap();
    stream.send(Up::Ready(v1::Ready { slot: 0 })).await;
    expect_run_end(stream, true).await;
}

#[tokio::test]
async fn draining_server_is_resumed() {
    let (server, checking) = hosted(&[(F::Draining, "resumes")]).await;
    let (mut stream, episode) = play_to_fault(&server).await;
    let fault = expect_fault(&mut stream).await;
    assert_eq!((fault.slot, fault.reason(), fault.recoverable), (None, v1::Reason::Draining, false));
    assert_eq!(fault.retry_after_s, Some(1));
    let status = expect_status(&mut stream).await;
    assert_eq!((status.code(), reason(&status).as_str()), (Code::Unavailable, "DRAINING"));
    let (mut stream, _) = server.enter(resume(&[at(0, &episode, 2)])).await.unwrap();
    assert_eq!(stream.observation().await.unwrap().step, 2);
    play_to_end(&mut stream, &episode).await;
    assert_eq!(outcomes(&checking.await.unwrap()), [&Outcome::Kept, &Outcome::NotOffered]);
}

#[tokio::test]
async fn lost_episode_is_reissued_with_new_handle() {
    let (server, checking) = hosted(&[(F::Reissued, "starts again")]).await;
    let (mut stream, episode) = play_to_fault(&server).await;
    expect_status(&mut stream).await;
    let (mut stream, welcome) = server.enter(resume(&[at(0, &episode, 2)])).await.unwrap();
    assert!(welcome.resumed.is_empty(), "{welcome:?}");
    let fault = expect_fault(&mut stream).await;
    assert_eq!((fault.slot, fault.episode.as_str()), (Some(0), episode.as_str()));
    assert_eq!((fault.reason(), fault.recoverable), (v1::Reason::EpisodeUnknown, true));
    let again = stream.start().await.unwrap().episode;
    assert_ne!(again, episode);
    take_steps(&mut stream, 0, &again, 1..=2).await;
    play_to_end(&mut stream, &again).await;
    assert_eq!(outcomes(&checking.await.unwrap()), [&Outcome::Kept, &Outcome::NotOffered]);
}

#[tokio::test]
async fn repeated_old_handle_is_reported() {
    let (server, checking) = hosted(&[(F::Reissued, "starts again")]).await;
    let (mut stream, episode) = play_to_fault(&server).await;
    expect_status(&mut stream).await;
    let (mut stream, _) = server.enter(resume(&[at(0, &episode, 2)])).await.unwrap();
    stream.refusal(v1::Reason::EpisodeUnknown).await.unwrap();
    // The first action may have crossed the fault.
    for _ in 0..2 {
        stream.act(&episode, 3, FORWARD).await;
        stream.refusal(v1::Reason::EpisodeUnknown).await.unwrap();
    }
    stream.send(Up::Goodbye(v1::Goodbye { pause: false })).await;
    let checks = checking.await.unwrap();
    assert_eq!(broken(&checks[0]), format!("episode '{episode}' is not open in slot 0"));
}

#[tokio::test]
async fn run_ends_while_client_is_away() {
    let (server, checking) = hosted(&[(F::EndedAway, "accepts the end")]).await;
    let (mut stream, episode) = play_to_fault(&server).await;
    expect_status(&mut stream).await;
    let over = status(&server).await;
    assert_eq!(over.state(), v1::RunState::Cancelled);
    let first = Up::Hello(resume(&[at(0, &episode, 2)]));
    let mut stream = server.dial("any", first.clone()).await.unwrap();
    let end = stream.end().await.unwrap();
    assert_eq!((end.reason(), end.step), (v1::EndReason::Disconnected, 2));
    assert_eq!(end.progress.unwrap_or_default().done, 1);
    expect_run_end(&mut stream, false).await;
    let refused = server.dial("any", first).await.err().expect("a refusal");
    assert_eq!(reason(&refused), "RUN_OVER");
    let checks = checking.await.unwrap();
    assert_eq!(broken(&checks[0]), "the client made another call after the end");
}

#[tokio::test]
async fn superseded_client_must_stay_away() {
    let (server, checking) = hosted(&[(F::Superseded, "stays away")]).await;
    let (mut stream, episode) = play_to_fault(&server).await;
    let fault = expect_fault(&mut stream).await;
    assert_eq!((fault.slot, fault.reason(), fault.recoverable), (None, v1::Reason::Superseded, false));
    let status = expect_status(&mut stream).await;
    assert_eq!((status.code(), reason(&status).as_str()), (Code::Aborted, "SUPERSEDED"));
    let again = server.dial("any", Up::Hello(resume(&[at(0, &episode, 2)]))).await;
    assert_eq!(reason(&again.err().expect("a refusal")), "SUPERSEDED");
    let checks = checking.await.unwrap();
    assert_eq!(broken(&checks[0]), "the client made another call after the end");
}

async fn reset(server: &Connection) -> Result<reset_response::Outcome, Status> {
    let request = v1::ResetRequest { hello: Some(hello()), ready: Some(v1::Ready { slot: 0 }) };
    let answer = server.play().reset(bearer(request, "any")).await?;
    Ok(answer.into_inner().outcome.expect("an outcome"))
}

async fn begin(server: &Connection) -> String {
    match reset(server).await.unwrap() {
        reset_response::Outcome::EpisodeStart(start) => start.episode,
        reset_response::Outcome::RunEnd(end) => panic!("{end:?}"),
    }
}

async fn step(server: &Connection, episode: &str, step: u32) -> Result<v1::StepResponse, Status> {
    let act = v1::Act { slot: 0, episode: episode.to_owned(), step, action: FORWARD };
    let request = v1::StepRequest { act: Some(act) };
    Ok(server.play().step(bearer(request, "any")).await?.into_inner())
}

/// Takes steps, repeated while the server is unavailable; returns the number of repetitions and the end.
async fn persist(
    server: &Connection,
    episode: &str,
    steps: RangeInclusive<u32>,
) -> (u32, Option<v1::EpisodeEnd>) {
    let (mut repeated, mut end) = (0, None);
    for number in steps {
        let response = loop {
            match step(server, episode, number).await {
                Ok(response) => break response,
                Err(status) => assert_eq!(status.code(), Code::Unavailable, "{status:?}"),
            }
            repeated += 1;
        };
        end = response.episode_end;
    }
    (repeated, end)
}

const UNARY: &[Trial] = &[
    (F::LostStart, "repeats Reset"),
    (F::LostObservation, "repeats Step"),
    (F::LostEnd, "repeats the last Step"),
    (F::Unreachable, "retries"),
    (F::BrokenStream, "needs a stream"),
    (F::SimulatorFault, "goes on"),
    (F::Reissued, "starts again"),
];

#[tokio::test]
async fn unary_client_survives_faults() {
    let (server, checking) = hosted(UNARY).await;
    assert_eq!(reset(&server).await.unwrap_err().code(), Code::Unavailable);
    for repetitions in [0, 1, 1, 3, 0] {
        let episode = begin(&server).await;
        let (repeated, end) = persist(&server, &episode, 1..=6).await;
        let why = end.expect("an end").reason();
        assert_eq!((repeated, why), (repetitions, v1::EndReason::StepLimit));
    }
    let episode = begin(&server).await;
    persist(&server, &episode, 1..=1).await;
    let failed = step(&server, &episode, 2).await.unwrap();
    assert_eq!(failed.observation, None);
    assert_eq!(failed.episode_end.map(|end| end.reason()), Some(v1::EndReason::ServerFault));
    let episode = begin(&server).await;
    persist(&server, &episode, 1..=2).await;
    let lost = step(&server, &episode, 3).await.unwrap_err();
    assert_eq!(reason(&lost), "EPISODE_UNKNOWN");
    let again = begin(&server).await;
    assert_ne!(again, episode);
    persist(&server, &again, 1..=6).await;
    for _ in 0..2 {
        assert!(matches!(reset(&server).await, Ok(reset_response::Outcome::RunEnd(end)) if end.complete));
    }
    let checks = checking.await.unwrap();
    let (kept, not) = (&Outcome::Kept, &Outcome::NotOffered);
    assert_eq!(outcomes(&checks), [kept, kept, kept, kept, not, kept, kept, not]);
}

#[tokio::test]
async fn changed_unary_repetition_is_reported() {
    let (server, checking) = hosted(&[(F::LostObservation, "repeats Step")]).await;
    let episode = begin(&server).await;
    step(&server, &episode, 1).await.unwrap();
    assert_eq!(step(&server, &episode, 2).await.unwrap_err().code(), Code::Unavailable);
    assert_eq!(reason(&reset(&server).await.unwrap_err()), "SLOT_BUSY");
    let goodbye = v1::end_request::Frame::Goodbye(v1::Goodbye { pause: false });
    let request = v1::EndRequest { frame: Some(goodbye) };
    server.play().end(bearer(request, "any")).await.unwrap();
    let checks = checking.await.unwrap();
    let why = broken(&checks[0]);
    assert!(why.contains("after a lost answer: expected the same Step"), "{why}");
}
