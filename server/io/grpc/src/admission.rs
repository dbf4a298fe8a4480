//! Admission of clients to runs, the same for Play streams and unary calls.

use crate::{
    attachment::StopReason,
    context::ServiceContext,
    host::{Host, OpenRun},
    limits::Limits,
    reaper,
    refusal::{Failure, Refusal},
    registry::SessionGuard,
    session::Session,
    wire,
};
use avln_episode::{EndReason, Sensors};
use avln_proto::v1::{self, Reason};
use std::sync::Arc;

/// A client that was admitted to a run.
pub(crate) struct Admission<H: Host> {
    pub(crate) open: OpenRun,
    pub(crate) session: Arc<Session<H>>,
    pub(crate) guard: SessionGuard<Session<H>>,
    /// Answer to the client's Hello.
    pub(crate) welcome: v1::Welcome,
}

/// Values agreed with a client.
pub(crate) struct Agreement {
    pub(crate) sensors: Sensors,
    slots: u32,
    api_minor: u32,
}

/// Checks a Hello, stops or takes over the run's present session, and returns the session to play.
///
/// `slots` is the limit for the connection type.
pub(crate) async fn admit<H: Host>(
    context: &ServiceContext<H>,
    token: &str,
    hello: &v1::Hello,
    slots: u32,
) -> Result<Admission<H>, Failure> {
    // Before the present session is stopped: a Hello that will be refused must not end the run of another connection.
    let (open, _) = check(context, token, hello).await?;
    let reason = if hello.resume { StopReason::Resumed } else { StopReason::Superseded };
    let (guard, previous) = context.registry.enter(&open.run, reason).await?;
    // A second time, because the previous session has stored open episodes since: the run may even be over.
    let (open, agreement) = match check(context, token, hello).await {
        Ok(checked) => checked,
        Err(refused) => return detach_and_refuse(context, previous, guard, refused).await,
    };
    let session = match previous {
        Some(session) if hello.resume => match session.check_sensors(&agreement.sensors) {
            Ok(()) => session,
            Err(refused) => {
                return detach_and_refuse(context, Some(session), guard, refused.into()).await;
            }
        },
        Some(session) => {
            // It was handed over for a connection that resumes, but this one, which starts over, entered first.
            session.close(EndReason::Disconnected).await;
            context.open_session(&open, &agreement.sensors)
        }
        None => context.open_session(&open, &agreement.sensors),
    };
    let resumed = session.positions().await;
    let wished = agreement.slots.min(slots);
    let held = resumed.iter().map(|held| held.slot + 1).max().unwrap_or(0).min(wished);
    let granted = guard.take_slots(&open.team, wished, held);
    let welcome = welcome(context, &open, &session, Agreement { slots: granted, ..agreement }, resumed);
    Ok(Admission { open, session, guard, welcome })
}

/// Checks a Hello against the run of the token and the server.
pub(crate) async fn check<H: Host>(
    context: &ServiceContext<H>,
    token: &str,
    hello: &v1::Hello,
) -> Result<(OpenRun, Agreement), Failure> {
    let open = context.open_run(token).await?;
    let agreement = agree(context, hello, &open)?;
    Ok((open, agreement))
}

fn agree<H: Host>(
    context: &ServiceContext<H>,
    hello: &v1::Hello,
    open: &OpenRun,
) -> Result<Agreement, Refusal> {
    if !hello.run.is_empty() && hello.run != open.run {
        let named = Limits::shorten(&hello.run);
        let message = format!("the token plays run {}, not '{named}'; use the token of that run", open.run);
        return Err(Refusal::new(Reason::TokenScope, message));
    }
    let info = context.host.info();
    wire::check_client(hello.client.as_ref(), &info.clients)?;
    let client_minor = hello.client.as_ref().map_or(0, |client| client.api_minor);
    Ok(Agreement {
        sensors: wire::sensors(hello.sensors.as_ref(), &open.sensors)?,
        slots: hello.slots.clamp(1, open.slot_limit()),
        api_minor: client_minor.min(info.api_minor),
    })
}

/// Refuses a client and detaches the session that was handed over to it.
async fn detach_and_refuse<H: Host, T>(
    context: &ServiceContext<H>,
    previous: Option<Arc<Session<H>>>,
    guard: SessionGuard<Session<H>>,
    refused: Failure,
) -> Result<T, Failure> {
    if let Some(session) = previous {
        reaper::end(context, session, guard, StopReason::ConnectionLost).await?;
    }
    Err(refused)
}

fn welcome<H: Host>(
    context: &ServiceContext<H>,
    open: &OpenRun,
    session: &Session<H>,
    agreement: Agreement,
    resumed: Vec<v1::SlotPosition>,
) -> v1::Welcome {
    let info = context.host.info();
    let frame_bytes = Limits::frame_bytes(&agreement.sensors, open.rules.audio_samples);
    v1::Welcome {
        run: open.run.clone(),
        api_minor: agreement.api_minor,
        slots: agreement.slots,
        task: Some(wire::task_spec(&open.rules, &agreement.sensors)),
        tensors: wire::tensor_specs(&agreement.sensors, &open.rules),
        max_message_bytes: u32::try_from(frame_bytes).unwrap_or(u32::MAX),
        time: Some(wire::time_limits(&open.time)),
        progress: Some(session.progress()),
        resumed,
        digests: Some(wire::digests(&open.digests)),
        benchmark: info.benchmark,
        server_version: info.version,
        sealed: open.sealed,
        server_time_unix_ms: crate::control::unix_ms(),
        run_deadline_unix_ms: open.deadline_unix_ms.unwrap_or_default(),
    }
}
