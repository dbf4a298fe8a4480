use super::{
    Arena, BENCHMARK_VERSION, Stage, now_unix_ms,
    refusals::{refusal, token_refusal},
    secret,
};
use avln_episode::Sensors;
use avln_grpc::{
    Account, ClientRange, Digests, EpisodeOutcome, Host, OpenRun, PhaseInfo, PhaseState, Reason, Refusal,
    RunRequest, RunState, RunStatus, RunTicket, Seat, ServerInfo,
};
use avln_scoring::Summary;
use avln_store::{NewRun, RunView, Token, TokenKind, TokenState, Viewer};
use std::{collections::BTreeMap, sync::Arc};

#[avln_grpc::async_trait]
impl Host for Arena {
    fn info(&self) -> ServerInfo {
        ServerInfo {
            name: "LH-AVLN Arena".to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            benchmark: BENCHMARK_VERSION.to_owned(),
            api_minor: avln_grpc::API_MINOR,
            clients: Vec::<ClientRange>::new(),
        }
    }

    async fn phases(&self) -> Result<Vec<PhaseInfo>, Refusal> {
        Ok(self.phases.values().map(|stage| phase_info(stage)).collect())
    }

    async fn account(&self, token: &str) -> Result<Account, Refusal> {
        match self.token(token, TokenKind::Account).await?.team {
            Some(team) => Ok(Account { team }),
            None => Err(Refusal::internal("an account token without a team")),
        }
    }

    async fn start_run(&self, account: &Account, request: RunRequest) -> Result<RunTicket, Refusal> {
        let stage = self.stage(&request.phase)?;
        let id = format!("run_{}", secret::random_hex().map_err(Refusal::internal)?);
        let token = secret::new_token("run").map_err(Refusal::internal)?;
        let new = NewRun {
            id: &id,
            token: &token,
            phase: &request.phase,
            team: &account.team,
            method: &request.method,
            version: &request.method_version,
            order: request.order,
            client_request_id: Some(request.client_request_id.as_str()).filter(|id| !id.is_empty()),
            digests: &stage.digests(),
        };
        let started = self.store.start_run(&new, now_unix_ms()).await.map_err(refusal)?;
        self.look_ahead(&started.run.id, stage);
        let (episodes, max_slots) = (started.run.episodes, stage.phase.max_slots);
        Ok(RunTicket { run: started.run.id, token, episodes, max_slots })
    }

    async fn run(&self, account: &Account, run: &str) -> Result<RunStatus, Refusal> {
        let viewer = Viewer::Team(account.team.clone());
        let view = self.store.reader().run(&viewer, run).await.map_err(refusal)?;
        let own = view.filter(|view| view.line.team == account.team);
        own.map(status)
            .ok_or_else(|| Refusal::new(Reason::RunUnknown, format!("the team has no run '{run}'")))
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
        self.store.cancel_run(run, now_unix_ms()).await.map_err(refusal)?;
        self.run(account, run).await
    }

    async fn open_run(&self, run_token: &str) -> Result<OpenRun, Refusal> {
        let Some(id) = self.token(run_token, TokenKind::Run).await?.run else {
            return Err(Refusal::internal("a run token without a run"));
        };
        let run = self.store.run(&id).await.map_err(refusal)?;
        if !run.state.is_open() {
            let message = format!("run '{id}' is {}; start another run", run.state.as_str());
            return Err(Refusal::new(Reason::RunOver, message));
        }
        let stage = self.stage(&run.phase)?;
        Ok(OpenRun {
            run: id,
            max_slots: stage.phase.max_slots,
            rules: stage.rules().clone(),
            sensors: stage.phase.sensors.clone(),
            episodes: run.episodes,
            done: run.done,
            digests: Digests {
                engine: format!("avln {}", env!("CARGO_PKG_VERSION")),
                dataset: stage.split.digest().to_owned(),
                scorer: BENCHMARK_VERSION.to_owned(),
                config: stage.config_digest(),
            },
        })
    }

    async fn next_episode(&self, run: &str, sensors: &Sensors) -> Result<Option<Seat>, Refusal> {
        self.seat_next(run, sensors).await
    }

    async fn conclude(&self, run: &str, seat: Seat) -> Result<Option<EpisodeOutcome>, Refusal> {
        self.conclude_seat(run, seat).await
    }

    async fn finish_run(&self, run: &str) -> Result<RunStatus, Refusal> {
        let finished = self.store.finish_run(run, now_unix_ms()).await.map_err(refusal)?;
        self.run(&Account { team: finished.team }, run).await
    }
}

impl Arena {
    pub(super) fn stage(&self, phase: &str) -> Result<&Arc<Stage>, Refusal> {
        self.phases.get(phase).ok_or_else(|| {
            let known: Vec<_> = self.phases.keys().map(String::as_str).collect();
            let message = format!("there is no phase '{phase}'; this server hosts: {}", known.join(", "));
            Refusal::new(Reason::PhaseUnknown, message)
        })
    }

    async fn token(&self, secret: &str, kind: TokenKind) -> Result<Token, Refusal> {
        match self.store.find_token(secret, now_unix_ms()).await.map_err(refusal)? {
            TokenState::Valid(token) if token.kind == kind => Ok(token),
            other => Err(token_refusal(&other)),
        }
    }
}

impl Stage {
    /// What was in force, for the record of a run.
    fn digests(&self) -> BTreeMap<String, String> {
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

fn phase_info(stage: &Stage) -> PhaseInfo {
    PhaseInfo {
        id: stage.phase.id.clone(),
        title: stage.phase.title.clone(),
        orders: stage.phase.orders.clone(),
        rules: stage.rules().name.clone(),
        episode_count: stage.phase.episodes.len() as u32,
        feedback: stage.feedback(),
        max_slots: stage.phase.max_slots,
        sensors: stage.phase.sensors.clone(),
        state: if stage.is_open() { PhaseState::Open } else { PhaseState::Closed },
    }
}

/// A run as its own team may see it.
fn status(view: RunView) -> RunStatus {
    let line = view.line;
    let ineligible = !view.eligible && line.finished_unix_ms.is_some();
    RunStatus {
        url: format!("/runs/{}", line.run),
        run: line.run,
        phase: line.phase,
        method: line.method,
        method_version: line.version,
        order: line.order,
        state: match line.state {
            avln_store::RunState::Created => RunState::Created,
            avln_store::RunState::Running => RunState::Running,
            avln_store::RunState::Completed => RunState::Completed,
            avln_store::RunState::Cancelled => RunState::Cancelled,
        },
        episodes: line.episodes,
        done: line.done,
        created_unix_ms: line.created_unix_ms,
        updated_unix_ms: line.finished_unix_ms.unwrap_or(line.created_unix_ms),
        ends: ends(&view.health),
        metrics: view.summary.filter(|_| view.scores_visible).as_ref().map(columns),
        ineligible_because: ineligible
            .then(|| "only completed runs whose every episode counts are ranked".to_owned())
            .into_iter()
            .collect(),
    }
}

fn ends(health: &BTreeMap<&'static str, u32>) -> Vec<(avln_episode::EndReason, u32)> {
    let count = |end: avln_episode::EndReason| health.get(end.as_str()).map(|&count| (end, count));
    avln_episode::EndReason::ALL.into_iter().filter_map(count).collect()
}

fn columns(summary: &Summary) -> Vec<(String, f64)> {
    let metrics = [
        ("sr", summary.sr.value),
        ("isr", summary.isr.value),
        ("osr", summary.osr.value),
        ("spl", summary.spl.value),
        ("soft_spl", summary.soft_spl.value),
    ];
    metrics.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}
