use super::{
    Arena, BENCHMARK_VERSION, Stage,
    episode::ArenaEpisode,
    now_unix_ms,
    refusals::{refusal, token_refusal},
    secret,
    stages::StageList,
    told::{account_of, phase_info, status, viewer},
};
use avln_challenge::{Account, EpisodeOutcome, PhaseInfo, Quota, RunStatus};
use avln_episode::Sensors;
use avln_grpc::{
    ClientRange, Control, Digests, Host, HostedEpisode, Interrupted, OpenRun, Reason, Refusal, RunRequest,
    RunTicket, ServerInfo, StoredEnd,
};
use avln_store::{NewRun, Run, RunState, RunView, StoreError, Token, TokenState, Viewer};
use std::{collections::BTreeMap, sync::Arc};

#[avln_grpc::async_trait]
impl Host for Arena {
    type Episode = ArenaEpisode;

    fn info(&self) -> ServerInfo {
        ServerInfo {
            name: "LH-AVLN Arena".to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            benchmark: BENCHMARK_VERSION.to_owned(),
            api_minor: avln_grpc::API_MINOR,
            clients: Vec::<ClientRange>::new(),
        }
    }

    fn control(&self) -> Option<&Control> {
        Some(self.control())
    }

    async fn phases(&self, account: Option<&Account>) -> Result<Vec<PhaseInfo>, Refusal> {
        self.now().await?;
        let viewer = account.map_or(Viewer::Anonymous, viewer);
        let views = self.store.reader().phases(&viewer, now_unix_ms()).await.map_err(refusal)?;
        Ok(views.into_iter().map(phase_info).collect())
    }

    async fn account(&self, token: &str) -> Result<Account, Refusal> {
        let state = self.store.find_token(token, now_unix_ms()).await.map_err(refusal)?;
        account_of(state)
    }

    async fn start_run(&self, account: &Account, request: RunRequest) -> Result<RunTicket, Refusal> {
        self.control().check_open()?;
        let stage = self.stage_for(&request.phase, account).await?;
        let id = format!("run_{}", secret::random_hex().map_err(Refusal::internal)?);
        let token = secret::new_token("run").map_err(Refusal::internal)?;
        let new = NewRun {
            id: &id,
            token: &token,
            phase: &request.phase,
            team: &account.team,
            method: &request.method,
            order: request.order,
            client_request_id: Some(request.client_request_id.as_str()).filter(|id| !id.is_empty()),
            digests: &stage.digests(),
        };
        let started = self.store.start_run(&new, now_unix_ms()).await.map_err(refusal)?;
        self.look_ahead(&started.run.id, &stage);
        let (episodes, max_slots) = (started.run.episodes, stage.phase.max_slots);
        let scarcest = started.quotas.into_iter().min_by_key(|quota| quota.remaining.unwrap_or(u32::MAX));
        let (time, quota) = (stage.phase.time, scarcest);
        Ok(RunTicket { run: started.run.id, token, episodes, max_slots, time, quota })
    }

    async fn quotas(&self, account: &Account, phase: Option<&str>) -> Result<Vec<Quota>, Refusal> {
        let quotas = self.store.quotas(&account.team, phase, now_unix_ms()).await.map_err(refusal)?;
        Ok(quotas)
    }

    async fn run(&self, account: &Account, run: &str) -> Result<RunStatus, Refusal> {
        let viewer = Viewer::Team(account.team.clone());
        let view = self.store.reader().run(&viewer, run).await.map_err(refusal)?;
        let own = view.filter(|view| view.line.team == account.team);
        let own =
            own.ok_or_else(|| Refusal::new(Reason::RunUnknown, format!("the team has no run '{run}'")))?;
        self.status(own).await
    }

    async fn runs(&self, account: &Account) -> Result<Vec<RunStatus>, Refusal> {
        let mut statuses = Vec::new();
        for run in self.store.runs_of(&account.team).await.map_err(refusal)? {
            statuses.push(self.run(account, &run.id).await?);
        }
        Ok(statuses)
    }

    async fn cancel_run(&self, account: &Account, run: &str) -> Result<RunStatus, Refusal> {
        self.run(account, run).await?;
        self.cancel(run).await.map_err(refusal)?;
        self.run(account, run).await
    }

    async fn open_run(&self, run_token: &str) -> Result<OpenRun, Refusal> {
        let id = match self.store.find_token(run_token, now_unix_ms()).await.map_err(refusal)? {
            TokenState::Valid(Token { run: Some(run), .. }) => run,
            other => return Err(token_refusal(&other)),
        };
        self.describe(&self.store.run(&id).await.map_err(refusal)?).await
    }

    async fn next_episode(
        &self,
        run: &str,
        slot: u32,
        sensors: &Sensors,
    ) -> Result<Option<HostedEpisode<ArenaEpisode>>, Refusal> {
        self.seat_next(run, slot, sensors).await
    }

    async fn conclude(
        &self,
        run: &str,
        seat: HostedEpisode<ArenaEpisode>,
    ) -> Result<Option<EpisodeOutcome>, Refusal> {
        self.conclude_seat(run, seat).await
    }

    async fn ended(&self, run: &str, handle: &str) -> Result<Option<StoredEnd>, Refusal> {
        self.stored_end(run, handle).await
    }

    async fn interrupted(&self) -> Result<Vec<String>, Refusal> {
        self.interrupted_runs().await
    }

    async fn restore(&self, run: &str) -> Result<Interrupted<ArenaEpisode>, Refusal> {
        self.restore_run(run).await
    }

    async fn lose(&self, run: &str, handle: &str, ticket: u64) -> Result<(), Refusal> {
        self.lose_seat(run, handle, ticket).await
    }

    async fn overdue(&self) -> Result<Vec<String>, Refusal> {
        self.overdue_now().await
    }

    async fn expire_run(&self, run: &str) -> Result<(), Refusal> {
        let ended = self.store.end_run(run, RunState::Expired, now_unix_ms()).await.map_err(refusal)?;
        self.sign_if_over(&ended).await;
        Ok(())
    }

    async fn finish_run(&self, run: &str) -> Result<RunStatus, Refusal> {
        let finished = self.store.finish_run(run, now_unix_ms()).await.map_err(refusal)?;
        self.sign_if_over(&finished).await;
        let view = self.store.reader().run(&Viewer::Team(finished.team), run).await.map_err(refusal)?;
        let view =
            view.ok_or_else(|| Refusal::internal(format!("run {run} went away while it was finished")))?;
        self.status(view).await
    }
}

impl Arena {
    /// Cancels a run and signs its log. Running episodes may still be recorded.
    pub(crate) async fn cancel(&self, run: &str) -> Result<(), StoreError> {
        let cancelled = self.store.cancel_run(run, now_unix_ms()).await?;
        self.sign_if_over(&cancelled).await;
        Ok(())
    }

    /// Status of a run for its own team.
    async fn status(&self, view: RunView) -> Result<RunStatus, Refusal> {
        let charge = self.store.charge(&view.line.run).await.map_err(refusal)?;
        let run = self.store.run(&view.line.run).await.map_err(refusal)?;
        let deadline_unix_ms = run.deadline_unix_ms.filter(|_| run.state.is_open());
        Ok(RunStatus { deadline_unix_ms, ..status(view, charge) })
    }

    /// Run description for its player.
    pub(super) async fn describe(&self, run: &Run) -> Result<OpenRun, Refusal> {
        let stage = self.stage(&run.phase).await?;
        Ok(OpenRun {
            run: run.id.clone(),
            team: run.team.clone(),
            time: stage.phase.time,
            deadline_unix_ms: run.deadline_unix_ms,
            over: match run.state {
                state if !state.is_open() => Some(state),
                _ if run.is_overdue(now_unix_ms()) => Some(RunState::Expired),
                _ => None,
            },
            max_slots: stage.phase.max_slots,
            rules: stage.rules().clone(),
            sensors: stage.phase.sensors.clone(),
            episodes: run.episodes,
            done: run.done,
            sealed: run.is_sealed(),
            digests: Digests {
                engine: format!("avln {}", env!("CARGO_PKG_VERSION")),
                dataset: stage.split.digest().to_owned(),
                scorer: BENCHMARK_VERSION.to_owned(),
                config: stage.config_digest(),
            },
        })
    }

    /// The phases as the organiser has them now.
    async fn now(&self) -> Result<StageList, Refusal> {
        self.stages.now(&self.store).await.map_err(Refusal::internal)
    }

    /// The phase of a run that exists.
    pub(super) async fn stage(&self, phase: &str) -> Result<Arc<Stage>, Refusal> {
        let found = self.now().await?.iter().find(|stage| stage.phase.id == phase).cloned();
        found.ok_or_else(|| Refusal::internal(format!("phase '{phase}' is not hosted")))
    }

    /// The phase requested by a team.
    async fn stage_for(&self, phase: &str, account: &Account) -> Result<Arc<Stage>, Refusal> {
        if let Some(stage) = self.now().await?.iter().find(|stage| stage.phase.id == phase) {
            return Ok(stage.clone());
        }
        let known = Host::phases(self, Some(account)).await?;
        let known: Vec<_> = known.into_iter().map(|phase| phase.id).collect();
        let message = format!("there is no phase '{phase}'; this server hosts: {}", known.join(", "));
        Err(Refusal::new(Reason::PhaseUnknown, message))
    }
}

impl Stage {
    /// Digests for the record of a run.
    pub(super) fn digests(&self) -> BTreeMap<String, String> {
        let digests = [
            ("benchmark", BENCHMARK_VERSION.to_owned()),
            ("server", env!("CARGO_PKG_VERSION").to_owned()),
            ("split", self.split.digest().to_owned()),
            ("config", self.config_digest()),
        ];
        digests.into_iter().map(|(name, digest)| (name.to_owned(), digest)).collect()
    }

    /// Digest of the rules with every option.
    fn config_digest(&self) -> String {
        let rules = serde_json::to_vec(self.rules()).unwrap_or_default();
        blake3::hash(&rules).to_hex().to_string()
    }
}
