use crate::{
    crew::Crew,
    gate::Gate,
    host::{Host, Interrupted, OpenRun, RunState, RunStatus},
    limits::Limits,
    refusal::{Failure, Refusal, ask},
    seat::Restored,
    session::{Opening, Session},
    watchdog::Watchdog,
    wire,
};
use avln_episode::Sensors;
use avln_proto::v1::{self, Reason};
use std::{sync::Arc, time::Duration};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// What all services of the door share.
#[derive(Clone)]
pub(crate) struct Door {
    pub(crate) host: Arc<dyn Host>,
    pub(crate) limits: Arc<Limits>,
    pub(crate) gate: Arc<Gate>,
    crew: Crew,
    watchdog: Watchdog,
    watchers: Arc<Semaphore>,
}

/// What a Hello was granted.
#[derive(Clone)]
pub(crate) struct Terms {
    pub(crate) sensors: Sensors,
    pub(crate) slots: u32,
    pub(crate) api_minor: u32,
}

impl Door {
    pub(crate) fn new(host: Arc<dyn Host>, limits: Limits) -> Self {
        let limits = Arc::new(limits);
        let watchdog = host.control().map(|control| control.watchdog().clone()).unwrap_or_default();
        let crew = Crew::new(limits.max_simulations, watchdog.clone());
        let watchers = Arc::new(Semaphore::new(limits.max_watchers));
        Self { host, gate: Gate::new(limits.clone()), limits, crew, watchdog, watchers }
    }

    /// Refuses new runs while too many simulations hang.
    pub(crate) fn check_sound(&self) -> Result<(), Refusal> {
        let hanging = self.watchdog.hanging();
        if hanging < self.limits.max_hanging.max(1) {
            return Ok(());
        }
        let message = format!(
            "{hanging} simulations of the server hang, so that no run starts; runs that were started go on. Its organiser has to start it again"
        );
        Err(Refusal::new(Reason::NoCapacity, message).retry_after(300))
    }

    /// A place among those who watch runs, until it is dropped.
    pub(crate) fn watch(&self) -> Result<OwnedSemaphorePermit, Refusal> {
        self.watchers.clone().try_acquire_owned().map_err(|_| {
            let message = format!("{} runs are being watched; ask with GetRun", self.limits.max_watchers);
            Refusal::new(Reason::NoCapacity, message).retry_after(60)
        })
    }

    /// The run that a run token plays.
    pub(crate) async fn open_run(&self, token: &str) -> Result<OpenRun, Failure> {
        let open = self.any_run(token).await?;
        let Some(state) = &open.over else { return Ok(open) };
        let message = format!("run '{}' is {state}; start another run", open.run);
        Err(Failure::new(Reason::RunOver, message))
    }

    /// The run that a run token plays or played.
    pub(crate) async fn any_run(&self, token: &str) -> Result<OpenRun, Failure> {
        let (host, token) = (self.host.clone(), token.to_owned());
        ask("open a run", async move { host.open_run(&token).await }).await
    }

    /// Closes the run and says how it stands.
    pub(crate) async fn finish_run(&self, run: &str) -> Result<v1::RunEnd, Failure> {
        let (host, run) = (self.host.clone(), run.to_owned());
        ask("finish a run", async move { host.finish_run(&run).await }).await.map(run_end)
    }

    /// How the episode ended that a client still holds, if its result is stored.
    pub(crate) async fn stored_end(
        &self,
        run: &str,
        known: &v1::SlotPosition,
    ) -> Result<Option<v1::EpisodeEnd>, Failure> {
        stored_end(&self.host, run, known).await
    }

    /// Checks a Hello against the run and the server.
    pub(crate) fn terms(&self, hello: &v1::Hello, open: &OpenRun) -> Result<Terms, Refusal> {
        if !hello.run.is_empty() && hello.run != open.run {
            let named = Limits::shorten(&hello.run);
            let message =
                format!("the token plays run {}, not '{named}'; use that run's own token", open.run);
            return Err(Refusal::new(Reason::TokenScope, message));
        }
        let info = self.host.info();
        wire::client_is_welcome(hello.client.as_ref(), &info.clients)?;
        let client_minor = hello.client.as_ref().map_or(0, |client| client.api_minor);
        Ok(Terms {
            sensors: wire::sensors(hello.sensors.as_ref(), &open.sensors)?,
            slots: hello.slots.clamp(1, most_slots(open)),
            api_minor: client_minor.min(info.api_minor),
        })
    }

    /// Opens a run's slots.
    pub(crate) fn session(&self, open: &OpenRun, sensors: &Sensors) -> Arc<Session> {
        self.open_session(open, sensors, Vec::new(), Duration::ZERO)
    }

    /// Opens the slots of a run that the server was stopped in.
    pub(crate) fn session_again(&self, interrupted: Interrupted) -> Arc<Session> {
        let Interrupted { open, sensors, episodes, away } = interrupted;
        self.open_session(&open, &sensors, episodes, away)
    }

    fn open_session(
        &self,
        open: &OpenRun,
        sensors: &Sensors,
        episodes: Vec<Restored>,
        away: Duration,
    ) -> Arc<Session> {
        Arc::new(Session::open(Opening {
            host: self.host.clone(),
            crew: self.crew.clone(),
            limits: &self.limits,
            open,
            sensors,
            episodes,
            away,
        }))
    }

    /// The frame that answers a Hello; `resumed` are the slots that hold an episode.
    pub(crate) fn welcome(
        &self,
        open: &OpenRun,
        terms: &Terms,
        session: &Session,
        resumed: Vec<v1::SlotPosition>,
    ) -> v1::Welcome {
        let info = self.host.info();
        let frame_bytes = Limits::frame_bytes(&terms.sensors, open.rules.audio_samples);
        v1::Welcome {
            run: open.run.clone(),
            api_minor: terms.api_minor,
            slots: terms.slots,
            task: Some(wire::task_spec(&open.rules, &terms.sensors)),
            tensors: wire::tensor_specs(&terms.sensors, &open.rules),
            max_message_bytes: u32::try_from(frame_bytes).unwrap_or(u32::MAX),
            time: Some(wire::time_limits(&open.time)),
            progress: Some(session.progress()),
            resumed,
            digests: Some(wire::digests(&open.digests)),
            benchmark: info.benchmark,
            server_version: info.version,
            sealed: open.sealed,
            server_time_unix_ms: wire::unix_ms(),
            run_deadline_unix_ms: open.deadline_unix_ms.unwrap_or_default(),
        }
    }
}

/// Most slots of one stream of the run.
pub(crate) fn most_slots(open: &OpenRun) -> u32 {
    open.max_slots.clamp(1, Limits::MAX_SLOTS)
}

/// How an episode ended that a client still holds, if its result is stored.
pub(crate) async fn stored_end(
    host: &Arc<dyn Host>,
    run: &str,
    known: &v1::SlotPosition,
) -> Result<Option<v1::EpisodeEnd>, Failure> {
    let (host, run, handle) = (host.clone(), run.to_owned(), known.episode.clone());
    let stored = ask("look up an episode", async move { host.ended(&run, &handle).await }).await?;
    Ok(stored.map(|end| v1::EpisodeEnd {
        slot: known.slot,
        episode: known.episode.clone(),
        step: end.steps,
        reason: wire::end_reason(end.reason).into(),
        terminated: end.reason.is_terminated(),
        metrics: end.outcome.map(|outcome| wire::public_metrics(outcome.metrics, 0)),
        progress: None,
    }))
}

/// How a run stands at the end of a stream.
fn run_end(status: RunStatus) -> v1::RunEnd {
    let cut_short = matches!(status.state, RunState::Failed | RunState::Cancelled | RunState::Expired);
    let progress = v1::RunProgress {
        total: status.episodes,
        done: status.done,
        in_flight: status.in_flight,
        eta_s: None,
    };
    v1::RunEnd {
        run: status.run,
        progress: Some(progress),
        ends: wire::end_counts(&status.ends),
        metrics: status.metrics.map(|metrics| wire::public_metrics(metrics, status.done)),
        complete: !cut_short && status.done >= status.episodes,
        url: status.url,
    }
}
