use crate::talk::{Site, Talk, Trouble, bearer, hello, name, reason, told};
use avln_proto::v1::{
    self, Reason, info_service_client::InfoServiceClient, play_request::Frame as Up,
    play_response::Frame as Down, reset_response,
};
use tonic::Code;

/// A protocol rule and its result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Check {
    /// Rule, in the words of `PROTOCOL.md`.
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

type Found = Result<(), String>;

/// Runs all checks in a run of `phase`; `token` is an account token.
///
/// # Errors
/// If the server is unreachable or starts no run.
pub async fn check(site: &Site<'_>, token: &str, phase: &str) -> Result<Vec<Check>, Trouble> {
    let talk = Talk::open(site, token, phase).await?;
    let mut checks = Vec::new();
    let mut add = |rule: &'static str, found: Found| checks.push(Check { rule, outcome: outcome(found) });
    add("GetServerInfo needs no token and tells api_minor, benchmark and encodings", info(&talk).await);
    add("a token that is not the server's is TOKEN_MALFORMED", bad_token(&talk).await);
    add("an account token on PlayService is TOKEN_SCOPE", account_token(&talk).await);
    add("the first frame of a stream must be Hello", no_hello(&talk).await);
    add(
        "Welcome lists one TensorSpec a sensor, and observations have exactly these tensors",
        tensors(&talk).await,
    );
    add("the same step with the same action again yields the same observation again", repeat(&talk).await);
    add(
        "a frame that does not fit is answered by a recoverable Fault and changes nothing",
        misfits(&talk).await,
    );
    add("Stop ends an episode terminated, and EpisodeEnd follows", stop(&talk).await);
    add("Abandon ends an episode truncated, END_REASON_ABANDONED", abandon(&talk).await);
    add("a lost stream is resumed at the same step of the same episode", resume(&talk).await);
    add("Reset and Step mirror the stream", unary(&talk).await);
    add("Goodbye is answered by RunEnd, and the stream ends well", goodbye(&talk).await);
    Ok(checks)
}

fn outcome(found: Found) -> Outcome {
    match found {
        Ok(()) => Outcome::Kept,
        Err(what) if what.contains("UNSUPPORTED") => Outcome::NotOffered,
        Err(what) => Outcome::Broken(what),
    }
}

fn due<T: PartialEq + std::fmt::Debug>(what: &str, came: T, due: T) -> Found {
    if came == due { Ok(()) } else { Err(format!("{what}: {due:?} was due, and {came:?} came")) }
}

async fn info(talk: &Talk) -> Found {
    let asked =
        InfoServiceClient::new(talk.channel.clone()).get_server_info(v1::GetServerInfoRequest {}).await;
    let info = asked.map_err(|status| told(&status))?.into_inner();
    due("benchmark is told", info.benchmark.is_empty(), false)?;
    due("raw is offered", info.encodings.contains(&(v1::Encoding::Raw as i32)), true)
}

async fn bad_token(talk: &Talk) -> Found {
    let refused = talk.dial("nonsense", vec![Up::Hello(hello())]).await;
    refused_with(refused.map(drop), Code::Unauthenticated, Reason::TokenMalformed)
}

async fn account_token(talk: &Talk) -> Found {
    let refused = talk.dial(&talk.account_token, vec![Up::Hello(hello())]).await;
    refused_with(refused.map(drop), Code::PermissionDenied, Reason::TokenScope)
}

fn refused_with(answer: Result<(), tonic::Status>, code: Code, why: Reason) -> Found {
    match answer {
        Ok(()) => Err(format!("{} was due, and the stream opened", why.word())),
        Err(status) => due("status", (status.code(), reason(&status)), (code, why.word().to_owned())),
    }
}

async fn no_hello(talk: &Talk) -> Found {
    let opened = talk.dial(&talk.run_token, vec![Up::Ready(v1::Ready { slot: 0 })]).await;
    match opened {
        Err(status) => due("reason", reason(&status), Reason::BadRequest.word().to_owned()),
        Ok(mut stream) => match stream.next_or_end().await? {
            Err(status) => due("reason", reason(&status), Reason::BadRequest.word().to_owned()),
            Ok(Some(Down::Fault(fault))) => due("reason", fault.reason(), Reason::BadRequest),
            Ok(Some(frame)) => Err(format!("Ready without Hello was answered by {}", name(&frame))),
            Ok(None) => Err("the stream ended without a reason".to_owned()),
        },
    }
}

async fn tensors(talk: &Talk) -> Found {
    let (mut stream, welcome) = talk.enter(hello()).await?;
    due("sensors", welcome.tensors.len(), 3)?;
    let start = stream.start().await?;
    let first = start.observation.ok_or("EpisodeStart came without an observation")?;
    due("step", first.step, 0)?;
    due("goals are 2 to 4", (2..=4).contains(&start.mission.unwrap_or_default().goals.len()), true)?;
    let came: Vec<_> = first.tensors.iter().map(|tensor| (tensor.id, tensor.shape.clone())).collect();
    let told: Vec<_> = welcome.tensors.iter().map(|spec| (spec.id, spec.shape.clone())).collect();
    due("tensors", came, told)?;
    stream.send(Up::Abandon(v1::Abandon { slot: 0, episode: start.episode, step: 0 })).await;
    stream.end().await.map(drop)
}

/// A stream with an episode that has just begun.
async fn begun(talk: &Talk) -> Result<(crate::talk::Stream, String), String> {
    let (mut stream, _) = talk.enter(hello()).await?;
    let start = stream.start().await?;
    Ok((stream, start.episode))
}

/// Ends the episode of a check.
async fn put_away(stream: &mut crate::talk::Stream, episode: String, step: u32) -> Found {
    stream.send(Up::Abandon(v1::Abandon { slot: 0, episode, step })).await;
    stream.end().await.map(drop)
}

async fn repeat(talk: &Talk) -> Found {
    let (mut stream, episode) = begun(talk).await?;
    stream.act(&episode, 1, LEFT).await;
    let first = stream.observation().await?;
    stream.act(&episode, 1, LEFT).await;
    let again = stream.observation().await?;
    due("tensors are the same", first.tensors == again.tensors && first.pose == again.pose, true)?;
    due("step", again.step, 1)?;
    put_away(&mut stream, episode, 1).await
}

async fn misfits(talk: &Talk) -> Found {
    let (mut stream, episode) = begun(talk).await?;
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
    stream.act("ep_of_nobody", 2, LEFT).await;
    stream.refusal(Reason::EpisodeUnknown).await?;
    stream.send(Up::Ready(v1::Ready { slot: 0 })).await;
    stream.refusal(Reason::SlotBusy).await?;
    stream.send(Up::Ready(v1::Ready { slot: 1000 })).await;
    stream.refusal(Reason::SlotUnknown).await?;
    stream.act(&episode, 2, LEFT).await;
    due("the next step", stream.observation().await?.step, 2)?;
    put_away(&mut stream, episode, 2).await
}

async fn stop(talk: &Talk) -> Found {
    let (mut stream, episode) = begun(talk).await?;
    stream.act(&episode, 1, STOP).await;
    let last = stream.observation().await?;
    due("terminated, truncated", (last.terminated, last.truncated), (true, false))?;
    let end = stream.end().await?;
    due("end", (end.reason(), end.step, end.terminated), (v1::EndReason::Stopped, 1, true))?;
    stream.act(&episode, 2, FORWARD).await;
    stream.refusal(Reason::EpisodeOver).await
}

async fn abandon(talk: &Talk) -> Found {
    let (mut stream, episode) = begun(talk).await?;
    stream.send(Up::Abandon(v1::Abandon { slot: 0, episode, step: 0 })).await;
    let end = stream.end().await?;
    due("end", (end.reason(), end.terminated), (v1::EndReason::Abandoned, false))
}

async fn resume(talk: &Talk) -> Found {
    let (mut stream, episode) = begun(talk).await?;
    stream.act(&episode, 1, LEFT).await;
    let seen = stream.observation().await?;
    drop(stream);
    let known = vec![v1::SlotPosition { slot: 0, episode: episode.clone(), step: 1 }];
    let (mut stream, welcome) =
        talk.enter(v1::Hello { resume: true, known: known.clone(), ..hello() }).await?;
    due("Welcome.resumed", welcome.resumed, known)?;
    let again = stream.observation().await?;
    due("the observation is the same", again.tensors == seen.tensors && again.step == seen.step, true)?;
    put_away(&mut stream, episode, 1).await
}

async fn unary(talk: &Talk) -> Found {
    let reset = v1::ResetRequest { hello: Some(hello()), ready: Some(v1::Ready { slot: 0 }) };
    let answer = talk.play().reset(bearer(reset, &talk.run_token)).await.map_err(|status| told(&status))?;
    let Some(reset_response::Outcome::EpisodeStart(start)) = answer.into_inner().outcome else {
        return Err("Reset began no episode".to_owned());
    };
    let act = v1::Act { slot: 0, episode: start.episode, step: 1, action: STOP };
    let step = v1::StepRequest { act: Some(act) };
    let answer = talk.play().step(bearer(step, &talk.run_token)).await.map_err(|status| told(&status))?;
    let answer = answer.into_inner();
    due("terminated", answer.observation.is_some_and(|last| last.terminated), true)?;
    due("end", answer.episode_end.map(|end| end.reason()), Some(v1::EndReason::Stopped))
}

async fn goodbye(talk: &Talk) -> Found {
    let (mut stream, _) = talk.enter(hello()).await?;
    stream.send(Up::Goodbye(v1::Goodbye { pause: false })).await;
    match stream.next().await? {
        Down::RunEnd(end) => due("run", end.run, talk.run.id.clone())?,
        other => return Err(format!("Goodbye was answered by {}", name(&other))),
    }
    let ended = stream.next_or_end().await?;
    due("the stream ends", matches!(ended, Ok(None)), true)
}
