//! State shared by all gRPC services, and the session lifecycle: admission, endings, detached sessions, and cancelled, expired and
//! interrupted runs.

use crate::{
    attachment::{AttachmentEvent, Ending, StopReason},
    host::{Host, Interrupted, OpenRun},
    limits::Limits,
    refusal::{Failure, Refusal, Result, call_host},
    registry::{SessionGuard, SessionRegistry},
    session::Session,
    sim_pool::SimPool,
    spans::RunSpans,
    watchdog::Watchdog,
    wire,
};
use avln_challenge::RunState;
use avln_episode::{EndReason, Sensors};
use avln_net::{HeldPlace, Places};
use avln_proto::v1::{self, Reason};
use std::{sync::Arc, time::Duration};
use tokio::time::{Instant, MissedTickBehavior, interval, sleep, sleep_until};
use tonic::{Response, Status, metadata::MetadataMap};
use tracing::Instrument;

/// State shared by all gRPC services.
pub(crate) struct ServiceContext<H: Host> {
    pub(crate) host: Arc<H>,
    pub(crate) limits: Arc<Limits>,
    pub(crate) registry: Arc<SessionRegistry<Session<H>>>,
    pub(crate) spans: Arc<RunSpans>,
    pool: SimPool,
    watchdog: Watchdog,
    /// WatchRun calls per team.
    watchers: Arc<Places<String>>,
}

impl<H: Host> ServiceContext<H> {
    pub(crate) fn new(host: Arc<H>, limits: Limits) -> Arc<Self> {
        let limits = Arc::new(limits);
        let watchdog = host.control().map(|control| control.watchdog().clone()).unwrap_or_default();
        let pool = SimPool::new(limits.max_simulations, watchdog.clone());
        let watchers = Places::new(Some(limits.max_watchers), limits.max_watchers);
        let registry = SessionRegistry::new(limits.clone());
        Arc::new(Self { host, registry, limits, spans: Arc::default(), pool, watchdog, watchers })
    }

    /// Refuses new runs while too many simulations hang.
    pub(crate) fn check_sound(&self) -> Result<(), Refusal> {
        let hanging = self.watchdog.hanging();
        if hanging < self.limits.max_hanging.max(1) {
            return Ok(());
        }
        let message = format!(
            "{hanging} simulations of the server hang, so no run can start; running runs continue. The organiser must restart the server"
        );
        Err(Refusal::new(Reason::NoCapacity, message).retry_after(300))
    }

    /// Takes a team's place among WatchRun calls, until it is dropped.
    pub(crate) fn watch(&self, team: &str) -> Result<HeldPlace<String>, Refusal> {
        self.watchers.take(team.to_owned()).map_err(|share| {
            let all = self.limits.max_watchers;
            let message = format!("the team watches its share of {share} of {all} runs; use GetRun");
            Refusal::new(Reason::NoCapacity, message).retry_after(60)
        })
    }

    /// Returns a run token's open run.
    pub(crate) async fn open_run(&self, token: &str) -> Result<OpenRun> {
        let open = self.any_run(token).await?;
        let Some(state) = &open.over else { return Ok(open) };
        let message = format!("run '{}' is {state}; start another run", open.run);
        Err(Failure::new(Reason::RunOver, message))
    }

    /// Returns a run token's run, open or over.
    pub(crate) async fn any_run(&self, token: &str) -> Result<OpenRun> {
        let token = token.to_owned();
        call_host("open a run", &self.host, |host| async move { host.open_run(&token).await }).await
    }

    /// Completes a run without episodes left. With `abandons`, ends the run in any case.
    pub(crate) async fn finish_run(&self, run: &str, abandons: bool) -> Result<v1::RunEnd> {
        let id = run.to_owned();
        let finish = |host: Arc<H>| async move { host.finish_run(&id, abandons).await };
        let status = call_host("finish a run", &self.host, finish).await?;
        if !status.state.is_open() {
            self.spans.end(run, status.state.as_str());
        }
        Ok(wire::run_end(status))
    }

    pub(crate) fn session(&self, interrupted: Interrupted<H::Episode>) -> Arc<Session<H>> {
        let run = self.spans.enter(&interrupted.open.run);
        Arc::new(Session::open(self.host.clone(), self.pool.clone(), &self.limits, interrupted, &run))
    }
}

pub(crate) type RunGuard<H> = SessionGuard<Session<H>>;

pub(crate) type Reply<T> = Result<Response<T>, Status>;

pub(crate) fn bearer(metadata: &MetadataMap) -> Result<String, Refusal> {
    let Some(value) = metadata.get("authorization") else {
        let message = "this call needs the metadata 'authorization: Bearer <token>'";
        return Err(Refusal::new(Reason::TokenMissing, message));
    };
    let token = value.to_str().ok().and_then(|text| text.strip_prefix("Bearer ")).map(str::trim);
    match token {
        Some(token) if (1..=Limits::MAX_TOKEN_BYTES).contains(&token.len()) => Ok(token.to_owned()),
        _ => {
            let limit = Limits::MAX_TOKEN_BYTES;
            let message = format!("authorization is not 'Bearer ' and a token of 1 to {limit} bytes");
            Err(Refusal::new(Reason::TokenMalformed, message))
        }
    }
}

pub(crate) struct Admission<H: Host> {
    pub(crate) open: OpenRun,
    pub(crate) session: Arc<Session<H>>,
    pub(crate) guard: RunGuard<H>,
    /// Answer to the client's Hello.
    pub(crate) welcome: v1::Welcome,
}

pub(crate) struct Agreement {
    pub(crate) sensors: Sensors,
    slots: u32,
    api_minor: u32,
}

impl<H: Host> ServiceContext<H> {
    /// Checks a Hello, stops or takes over the run's present session, and returns the session to play, with up to `slots` slots.
    pub(crate) async fn admit(
        self: &Arc<Self>,
        token: &str,
        hello: &v1::Hello,
        slots: u32,
    ) -> Result<Admission<H>> {
        // Before the present session is stopped: a Hello that will be refused must not end the run of another connection.
        let (open, _) = self.check(token, hello).await?;
        let reason = if hello.resume { StopReason::Resumed } else { StopReason::Superseded };
        let (guard, previous) = self.registry.enter(&open.run, &open.team, reason).await?;
        // A second time, because the previous session has stored open episodes since: the run may even be over.
        let (open, agreement) = match self.check(token, hello).await {
            Ok(checked) => checked,
            Err(refused) => return self.detach_and_refuse(previous, guard, refused).await,
        };
        let session = match previous {
            Some(session) if hello.resume => match session.check_sensors(&agreement.sensors) {
                Ok(()) => session,
                Err(refused) => {
                    return self.detach_and_refuse(Some(session), guard, refused.into()).await;
                }
            },
            previous => {
                if let Some(session) = previous {
                    // It was handed over for a connection that resumes, but this one, which starts over, entered first.
                    session.close(EndReason::Disconnected, StopReason::Superseded).await;
                }
                // Only for a new session: another keeps its sensors when the organiser lowers the limits of the phase.
                wire::check_sensors(&agreement.sensors, &open.sensors)?;
                self.session(Interrupted {
                    open: open.clone(),
                    sensors: agreement.sensors.clone(),
                    episodes: Vec::new(),
                    away: Duration::ZERO,
                })
            }
        };
        let resumed = session.positions().await;
        let held = resumed.iter().map(|held| held.slot + 1).max().unwrap_or(0);
        // Open episodes keep their slots if the organiser has lowered the limit of the phase since; a raised limit adds none.
        let wished = agreement.slots.min(slots).min(open.slot_limit().max(held)).min(session.slot_count());
        let granted = guard.take_slots(wished, held.min(wished));
        let welcome = self.welcome(&open, &session, Agreement { slots: granted, ..agreement }, resumed);
        Ok(Admission { open, session, guard, welcome })
    }

    pub(crate) async fn check(&self, token: &str, hello: &v1::Hello) -> Result<(OpenRun, Agreement)> {
        let open = self.open_run(token).await?;
        if !hello.run.is_empty() && hello.run != open.run {
            let named = Limits::shorten(&hello.run);
            let message =
                format!("the token plays run {}, not '{named}'; use the token of that run", open.run);
            return Err(Failure::new(Reason::TokenScope, message));
        }
        let info = self.host.info();
        wire::check_client(hello.client.as_ref(), &info.clients)?;
        let client_minor = hello.client.as_ref().map_or(0, |client| client.api_minor);
        let sensors = wire::requested_sensors(hello.sensors.as_ref(), &open.sensors)?;
        if !hello.resume {
            wire::check_sensors(&sensors, &open.sensors)?;
        }
        let agreement = Agreement {
            sensors,
            slots: hello.slots.clamp(1, Limits::MAX_SLOTS),
            api_minor: client_minor.min(info.api_minor),
        };
        Ok((open, agreement))
    }

    /// Refuses a client and detaches the session that was handed over to it.
    async fn detach_and_refuse<T>(
        self: &Arc<Self>,
        previous: Option<Arc<Session<H>>>,
        guard: RunGuard<H>,
        refused: Failure,
    ) -> Result<T> {
        if let Some(session) = previous {
            self.end(session, guard, StopReason::ConnectionLost).await?;
        }
        Err(refused)
    }

    fn welcome(
        &self,
        open: &OpenRun,
        session: &Session<H>,
        agreement: Agreement,
        resumed: Vec<v1::SlotPosition>,
    ) -> v1::Welcome {
        let info = self.host.info();
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
            server_time_unix_ms: self.host.now_unix_ms(),
            run_deadline_unix_ms: open.deadline_unix_ms.unwrap_or_default(),
        }
    }

    /// Ends an attachment. Returns the run's end if the run ends as well.
    pub(crate) async fn end(
        self: &Arc<Self>,
        session: Arc<Session<H>>,
        guard: RunGuard<H>,
        reason: StopReason,
    ) -> Result<Option<v1::RunEnd>> {
        match reason.ending() {
            Ending::Close(end) => session.close(end, reason).await,
            Ending::KeepForRestart => session.leave().await,
            Ending::Detach => {
                self.detach(session, guard).await;
                return Ok(None);
            }
            Ending::HandOver => {
                self.hand_over(session, guard).await;
                return Ok(None);
            }
        }
        if !reason.finishes_run() {
            return Ok(None);
        }
        // With the guard alive: a connection that waits for the run enters after the end and learns that the run is over.
        self.finish_run(&guard.run, reason.abandons_run()).await.map(Some)
    }

    /// Lets a session wait for the client, or closes it if the run allows no time to reconnect.
    async fn detach(self: &Arc<Self>, session: Arc<Session<H>>, guard: RunGuard<H>) {
        let patience = session.detach().await;
        if patience.is_zero() {
            tracing::info!("connection lost; the run has no time left to reconnect");
            return session.close(EndReason::Disconnected, StopReason::ConnectionLost).await;
        }
        tracing::info!(?patience, "connection lost; open episodes wait");
        self.spawn_wait(session, guard, Instant::now() + patience);
    }

    // Not async: the future of this wait contains that of `end`, and with it this call.
    fn spawn_wait(self: &Arc<Self>, session: Arc<Session<H>>, mut guard: RunGuard<H>, until: Instant) {
        guard.apply(AttachmentEvent::Detached { until });
        let context = self.clone();
        let wait = async move {
            let reason = tokio::select! {
                // First: a client that resumes in the last moment gets the session.
                biased;
                reason = guard.stopped() => reason,
                () = sleep_until(until) => guard.ends(StopReason::AwayTooLong),
            };
            if let Err(failure) = context.end(session, guard, reason).await {
                tracing::warn!(why = failure.message, "run not finished");
            }
        };
        tokio::spawn(wait.in_current_span());
    }

    /// Passes a session to the connection that stopped it.
    async fn hand_over(&self, session: Arc<Session<H>>, guard: RunGuard<H>) {
        session.detach().await;
        let registry = self.registry.clone();
        let patience = self.limits.handover;
        let run = guard.run.clone();
        let number = guard.hand_over(session);
        tokio::spawn(async move {
            // That connection may have given up meanwhile. Without this task, the session would stay open for ever.
            sleep(patience).await;
            if let Some(session) = registry.take_unclaimed(&run, number) {
                session.close(EndReason::Disconnected, StopReason::AwayTooLong).await;
            }
        });
    }

    /// Claims runs interrupted by a server restart, before any client is admitted.
    pub(crate) async fn claim_interrupted(&self) -> Vec<RunGuard<H>> {
        let interrupted = |host: Arc<H>| async move { host.interrupted().await };
        let runs = match call_host("look for interrupted runs", &self.host, interrupted).await {
            Ok(runs) => runs,
            Err(failure) => {
                tracing::error!(why = failure.message, "interrupted runs are not restored");
                return Vec::new();
            }
        };
        let mut guards = Vec::new();
        for run in runs {
            // Without a team, which is known after the restoration: a run in progress is not refused for a smaller share.
            match self.registry.enter(&run, "", StopReason::Resumed).await {
                Ok((guard, _)) => guards.push(guard),
                Err(refused) => tracing::error!(run, %refused, "an interrupted run is not restored"),
            }
        }
        guards
    }

    /// Restores an interrupted run and waits for the client.
    pub(crate) async fn restore(self: Arc<Self>, guard: RunGuard<H>) {
        let span = self.spans.enter(&guard.run);
        if let Err(failure) = self.try_restore(guard).instrument(span).await {
            tracing::error!(why = failure.message, "an interrupted run could not be restored");
        }
    }

    async fn try_restore(self: &Arc<Self>, guard: RunGuard<H>) -> Result<()> {
        let run = guard.run.clone();
        let restore = |host: Arc<H>| async move { host.restore(&run).await };
        let interrupted = call_host("restore a run", &self.host, restore).await?;
        guard.set_team(&interrupted.open.team);
        tracing::info!(episodes = interrupted.episodes.len(), "an interrupted run continues");
        // The run may have ended while the server was down.
        let reason = match interrupted.open.over {
            None => StopReason::ConnectionLost,
            Some(RunState::Expired) => StopReason::Expired,
            Some(_) => StopReason::Cancelled,
        };
        let session = self.session(interrupted);
        self.end(session, guard, reason).await.map(drop)
    }

    /// Ends sessions after a cancellation outside gRPC, on the web page or the command line. Never returns.
    pub(crate) async fn end_cancelled_runs(&self) {
        let Some(control) = self.host.control().cloned() else { return std::future::pending().await };
        loop {
            for run in control.cancelled_runs().await {
                let (registry, spans) = (self.registry.clone(), self.spans.clone());
                // A task per run, because a session may need long to store its episodes.
                tokio::spawn(async move {
                    registry.stop(&run, StopReason::Cancelled).await;
                    spans.end(&run, RunState::Cancelled.as_str());
                });
            }
        }
    }

    /// Ends expired runs, connected or not. Never returns.
    pub(crate) async fn end_expired_runs(&self) {
        let mut ticks = interval(self.limits.overdue_interval);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            ticks.tick().await;
            let overdue = |host: Arc<H>| async move { host.overdue().await };
            let runs = match call_host("look for expired runs", &self.host, overdue).await {
                Ok(runs) => runs,
                Err(failure) => {
                    tracing::error!(why = failure.message, "cannot look for expired runs");
                    continue;
                }
            };
            for run in runs {
                let span = self.spans.enter(&run);
                self.expire(run).instrument(span).await;
            }
        }
    }

    async fn expire(&self, run: String) {
        let id = run.clone();
        // The host first: from then on no episode begins in the run, so none can start while the session ends.
        let expired =
            call_host("end an expired run", &self.host, |host| async move { host.expire_run(&id).await });
        if let Err(failure) = expired.await {
            tracing::error!(why = failure.message, "an expired run was not ended");
            return;
        }
        let (registry, spans) = (self.registry.clone(), self.spans.clone());
        let stop = async move {
            registry.stop(&run, StopReason::Expired).await;
            tracing::info!("the run's wall time has passed");
            spans.end(&run, RunState::Expired.as_str());
        };
        tokio::spawn(stop.in_current_span());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_bearer_tokens_pass() {
        let read = |value: Option<&str>| {
            let mut metadata = MetadataMap::new();
            if let Some(value) = value {
                metadata.insert("authorization", value.parse().unwrap());
            }
            bearer(&metadata).map_err(|refusal| refusal.reason)
        };
        assert_eq!(read(Some("Bearer abc")), Ok("abc".to_owned()));
        assert_eq!(read(None), Err(Reason::TokenMissing));
        let long = format!("Bearer {}", "x".repeat(Limits::MAX_TOKEN_BYTES + 1));
        for wrong in ["abc", "Basic abc", "Bearer ", "Bearer", &long] {
            assert_eq!(read(Some(wrong)), Err(Reason::TokenMalformed), "{wrong}");
        }
    }
}
