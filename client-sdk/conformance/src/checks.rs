//! Checks of a server against the rules of `PROTOCOL.md`.

use crate::talk::{Connection, Site, Stream, Trouble, bearer, describe, frame_name, hello, reason};
use avln_proto::v1::{
    self, Reason, RunState, info_service_client::InfoServiceClient, play_request::Frame as Up,
    play_response::Frame as Down, reset_response,
};
use tonic::{Code, Status};

/// A protocol rule with the result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Check {
    /// A rule of `PROTOCOL.md`.
    pub rule: &'static str,
    /// Result.
    pub outcome: Outcome,
}

/// Check result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The server follows the rule.
    Kept,
    /// The server violates the rule: expected and actual behaviour.
    Broken(String),
    /// The server reports the feature as unsupported.
    NotOffered,
}

const FORWARD: i32 = v1::Action::MoveForward as i32;
const LEFT: i32 = v1::Action::TurnLeft as i32;
const STOP: i32 = v1::Action::Stop as i32;

/// A violation's description as error.
type Found = Result<(), String>;

/// Runs all checks with an account `token` in a run of `phase`; fails if the server starts no run.
pub async fn check(site: &Site<'_>, token: &str, phase: &str) -> Result<Vec<Check>, Trouble> {
    let server = Connection::open(site, token, phase).await?;
    // Goodbye ends the run and therefore comes last.
    let results = [
        ("GetServerInfo needs no token and returns benchmark and encodings", info(&server).await),
        (
            "an invalid token is refused with TOKEN_MALFORMED",
            token_refusal(&server, "nonsense", Code::Unauthenticated, Reason::TokenMalformed).await,
        ),
        (
            "PlayService refuses an account token with TOKEN_SCOPE",
            token_refusal(&server, &server.account_token, Code::PermissionDenied, Reason::TokenScope).await,
        ),
        ("the first frame of a stream must be Hello", no_hello(&server).await),
        ("Welcome lists a TensorSpec per sensor, and observations match it", tensors(&server).await),
        ("a repeated action returns the same observation", repeat(&server).await),
        ("an invalid frame causes a recoverable Fault without side effects", invalid_frames(&server).await),
        ("Stop terminates an episode, and EpisodeEnd follows", stop(&server).await),
        ("Abandon truncates an episode with END_REASON_ABANDONED", abandon(&server).await),
        ("a lost stream resumes at the same step", resume(&server).await),
        ("Reset and Step correspond to the stream", unary(&server).await),
        ("RunEnd and the end of the stream follow Goodbye, and the run is over", goodbye(&server).await),
    ];
    Ok(results.into_iter().map(|(rule, found)| Check { rule, outcome: outcome(found) }).collect())
}

fn outcome(found: Found) -> Outcome {
    match found {
        Ok(()) => Outcome::Kept,
        // Servers may lack optional features, but must refuse them with this reason.
        Err(message) if message.contains("UNSUPPORTED") => Outcome::NotOffered,
        Err(message) => Outcome::Broken(message),
    }
}

fn expect<T: PartialEq + std::fmt::Debug>(subject: &str, actual: T, expected: T) -> Found {
    if actual == expected { Ok(()) } else { Err(format!("{subject}: expected {expected:?}, got {actual:?}")) }
}

async fn info(server: &Connection) -> Found {
    let mut client = InfoServiceClient::new(server.channel.clone());
    let answer = client.get_server_info(v1::GetServerInfoRequest {}).await;
    let info = answer.map_err(|status| describe(&status))?.into_inner();
    expect("benchmark is missing", info.benchmark.is_empty(), false)?;
    expect("RAW is offered", info.encodings.contains(&(v1::Encoding::Raw as i32)), true)
}

async fn token_refusal(server: &Connection, token: &str, code: Code, why: Reason) -> Found {
    match server.dial(token, Up::Hello(hello())).await {
        Ok(_) => Err(format!("expected a refusal with {}, got an open stream", why.word())),
        Err(status) => expect("status", (status.code(), reason(&status)), (code, why.word().to_owned())),
    }
}

async fn no_hello(server: &Connection) -> Found {
    let opened = server.dial(&server.run_token, Up::Ready(v1::Ready { slot: 0 })).await;
    refused("Ready without Hello", opened, Reason::BadRequest).await
}

/// Expects a refused stream. The protocol permits a refused call, a failed stream or a Fault.
async fn refused(attempt: &str, opened: Result<Stream, Status>, why: Reason) -> Found {
    let word = why.word().to_owned();
    match opened {
        Err(status) => expect("reason", reason(&status), word),
        Ok(mut stream) => match stream.next_or_end().await? {
            Err(status) => expect("reason", reason(&status), word),
            Ok(Some(Down::Fault(fault))) => expect("reason", fault.reason(), why),
            Ok(Some(frame)) => Err(format!("answer to {attempt}: {}", frame_name(&frame))),
            Ok(None) => Err("the stream ended without a reason".to_owned()),
        },
    }
}

async fn tensors(server: &Connection) -> Found {
    let (mut stream, welcome) = server.enter(hello()).await?;
    expect("sensors", welcome.tensors.len(), 3)?;
    let start = stream.start().await?;
    let first = start.observation.ok_or("EpisodeStart has no observation")?;
    expect("step", first.step, 0)?;
    expect("2 to 4 goals", (2..=4).contains(&start.mission.unwrap_or_default().goals.len()), true)?;
    let received: Vec<_> = first.tensors.iter().map(|tensor| (tensor.id, tensor.shape.clone())).collect();
    let announced: Vec<_> = welcome.tensors.iter().map(|spec| (spec.id, spec.shape.clone())).collect();
    expect("tensors", received, announced)?;
    stream.abandon(start.episode, 0).await.map(drop)
}

async fn start_episode(server: &Connection) -> Result<(Stream, String), String> {
    let (mut stream, _) = server.enter(hello()).await?;
    let start = stream.start().await?;
    Ok((stream, start.episode))
}

async fn repeat(server: &Connection) -> Found {
    let (mut stream, episode) = start_episode(server).await?;
    stream.act(&episode, 1, LEFT).await;
    let first = stream.observation().await?;
    stream.act(&episode, 1, LEFT).await;
    let again = stream.observation().await?;
    expect("equal observation", first.tensors == again.tensors && first.pose == again.pose, true)?;
    expect("step", again.step, 1)?;
    stream.abandon(episode, 1).await.map(drop)
}

async fn invalid_frames(server: &Connection) -> Found {
    let (mut stream, episode) = start_episode(server).await?;
    stream.act(&episode, 1, FORWARD).await;
    stream.observation().await?;
    stream.act(&episode, 1, LEFT).await;
    stream.refusal(Reason::StepConflict).await?;
    stream.act(&episode, 5, LEFT).await;
    stream.refusal(Reason::StepAhead).await?;
    for action in [0, 6, -1] {
        stream.act(&episode, 2, action).await;
        stream.refusal(Reason::ActionOutOfRange).await?;
    }
    stream.act("ep_unknown", 2, LEFT).await;
    stream.refusal(Reason::EpisodeUnknown).await?;
    stream.send(Up::Ready(v1::Ready { slot: 0 })).await;
    stream.refusal(Reason::SlotBusy).await?;
    stream.send(Up::Ready(v1::Ready { slot: 1000 })).await;
    stream.refusal(Reason::SlotUnknown).await?;
    stream.act(&episode, 2, LEFT).await;
    expect("the next step", stream.observation().await?.step, 2)?;
    stream.abandon(episode, 2).await.map(drop)
}

async fn stop(server: &Connection) -> Found {
    let (mut stream, episode) = start_episode(server).await?;
    stream.act(&episode, 1, STOP).await;
    let last = stream.observation().await?;
    expect("terminated, truncated", (last.terminated, last.truncated), (true, false))?;
    let end = stream.end().await?;
    expect("end", (end.reason(), end.step, end.terminated), (v1::EndReason::Stopped, 1, true))?;
    stream.act(&episode, 2, FORWARD).await;
    stream.refusal(Reason::EpisodeOver).await
}

async fn abandon(server: &Connection) -> Found {
    let (mut stream, episode) = start_episode(server).await?;
    let end = stream.abandon(episode, 0).await?;
    expect("end", (end.reason(), end.terminated), (v1::EndReason::Abandoned, false))
}

async fn resume(server: &Connection) -> Found {
    let (mut stream, episode) = start_episode(server).await?;
    stream.act(&episode, 1, LEFT).await;
    let seen = stream.observation().await?;
    drop(stream);
    let known = vec![v1::SlotPosition { slot: 0, episode: episode.clone(), step: 1 }];
    let (mut stream, welcome) =
        server.enter(v1::Hello { resume: true, known: known.clone(), ..hello() }).await?;
    expect("Welcome.resumed", welcome.resumed, known)?;
    let again = stream.observation().await?;
    expect("equal observation", again.tensors == seen.tensors && again.step == seen.step, true)?;
    stream.abandon(episode, 1).await.map(drop)
}

async fn unary(server: &Connection) -> Found {
    let reset = v1::ResetRequest { hello: Some(hello()), ready: Some(v1::Ready { slot: 0 }) };
    let answer =
        server.play().reset(bearer(reset, &server.run_token)).await.map_err(|status| describe(&status))?;
    let Some(reset_response::Outcome::EpisodeStart(start)) = answer.into_inner().outcome else {
        return Err("Reset started no episode".to_owned());
    };
    let act = v1::Act { slot: 0, episode: start.episode, step: 1, action: STOP };
    let step = v1::StepRequest { act: Some(act) };
    let answer = server.play().step(bearer(step, &server.run_token)).await;
    let answer = answer.map_err(|status| describe(&status))?.into_inner();
    expect("terminated", answer.observation.is_some_and(|last| last.terminated), true)?;
    expect("end", answer.episode_end.map(|end| end.reason()), Some(v1::EndReason::Stopped))
}

async fn goodbye(server: &Connection) -> Found {
    let (mut stream, _) = server.enter(hello()).await?;
    stream.send(Up::Goodbye(v1::Goodbye { pause: false })).await;
    match stream.next().await? {
        Down::RunEnd(end) => expect("run", end.run, server.run.id.clone())?,
        other => return Err(format!("answer to Goodbye: {}", frame_name(&other))),
    }
    let ended = stream.next_or_end().await?;
    expect("end of the stream", matches!(ended, Ok(None)), true)?;
    let request = v1::GetRunRequest { run: server.run.id.clone() };
    let answer = server.runs().get_run(bearer(request, &server.account_token)).await;
    let state = answer.map_err(|status| describe(&status))?.into_inner().run.unwrap_or_default().state();
    let ends = [RunState::Completed, RunState::Failed, RunState::Cancelled, RunState::Expired];
    let is_end = ends.contains(&state);
    expect("GetRun after Goodbye has an end state", (state, is_end), (state, true))?;
    let opened = server.dial(&server.run_token, Up::Hello(hello())).await;
    refused("Hello after Goodbye", opened, Reason::RunOver).await
}
