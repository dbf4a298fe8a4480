//! The arena as the host behind the gRPC server; store types converted for it.

use crate::{
    Arena, BENCHMARK_VERSION,
    episodes::{ArenaEpisode, ReturnCause},
    failure::refusal,
    ids::IssuedRun,
    phases::{HostedPhase, PhaseList, find_phase},
};
use avln_challenge::{Account, Charge, EpisodeOutcome, PhaseInfo, Quota, RunStatus, TokenScope};
use avln_episode::{EndReason, Sensors};
use avln_grpc::{
    ClientRange, Control, Digests, Host, HostedEpisode, Interrupted, OpenRun, Reason, Refusal, RunRequest,
    RunTicket, ServerInfo, StoredEnd,
};
use avln_scoring::{Metric, Summary};
use avln_store::{
    EpisodeState, NewRun, PhaseView, Run, RunState, RunView, StoreError, Token, TokenState, Viewer,
};
use std::sync::Arc;

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

    fn now_unix_ms(&self) -> i64 {
        self.clock.now_unix_ms()
    }

    async fn phases(&self, account: Option<&Account>) -> Result<Vec<PhaseInfo>, Refusal> {
        self.now().await?;
        let viewer = account.map_or(Viewer::Anonymous, viewer);
        let views = self.store.reader().phases(&viewer, self.clock.now_unix_ms()).await.map_err(refusal)?;
        Ok(views.into_iter().map(phase_info).collect())
    }

    async fn account(&self, token: &str) -> Result<Account, Refusal> {
        account_of(self.store.find_token(token, self.clock.now_unix_ms()).await.map_err(refusal)?)
    }

    async fn start_run(&self, account: &Account, request: RunRequest) -> Result<RunTicket, Refusal> {
        self.control().check_open()?;
        let phase = self.stage_for(&request.phase, account).await?;
        let IssuedRun { run, token } = self.run_ids.next().map_err(Refusal::internal)?;
        let new = NewRun {
            id: &run,
            token: &token,
            phase: &request.phase,
            team: &account.team,
            method: &request.method,
            order: request.order,
            client_request_id: Some(request.client_request_id.as_str()).filter(|id| !id.is_empty()),
            digests: &phase.digests(),
        };
        let time = self.settled_time().await?;
        let started = self.store.start_run(&new, time.unix_ms()).await.map_err(refusal)?;
        drop(time);
        self.prefetch(&started.run, &phase);
        Ok(RunTicket {
            run: started.run.id,
            token,
            episodes: started.run.episodes,
            max_slots: phase.settings.max_slots,
            time: phase.settings.time,
            // The most restrictive quota.
            quota: started.quotas.into_iter().min_by_key(|quota| quota.remaining.unwrap_or(u32::MAX)),
        })
    }

    async fn quotas(&self, account: &Account, phase: Option<&str>) -> Result<Vec<Quota>, Refusal> {
        if let Some(phase) = phase {
            self.stage_for(phase, account).await?;
        }
        self.store.quotas(&account.team, phase, self.clock.now_unix_ms()).await.map_err(refusal)
    }

    async fn run(&self, account: &Account, run: &str) -> Result<RunStatus, Refusal> {
        let viewer = Viewer::Team(account.team.clone());
        let view = self.store.reader().run(&viewer, run).await.map_err(refusal)?;
        // Other teams' public runs are visible to the reader, but not as own runs.
        let own = view.filter(|view| view.line.team == account.team);
        let unknown = || Refusal::new(Reason::RunUnknown, format!("the team has no run '{run}'"));
        self.status(own.ok_or_else(unknown)?).await
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
        let id = match self.store.find_token(run_token, self.clock.now_unix_ms()).await.map_err(refusal)? {
            TokenState::Valid(Token { run: Some(run), .. }) => run,
            other => return Err(token_refusal(&other)),
        };
        self.describe(&id).await
    }

    async fn next_episode(
        &self,
        run: &str,
        slot: u32,
        sensors: &Sensors,
    ) -> Result<Option<HostedEpisode<ArenaEpisode>>, Refusal> {
        self.issue_next(run, slot, sensors).await
    }

    async fn conclude(
        &self,
        run: &str,
        hosted: HostedEpisode<ArenaEpisode>,
    ) -> Result<Option<EpisodeOutcome>, Refusal> {
        self.store_result(run, hosted).await
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
        self.open_episodes().issued.remove(&ticket);
        self.return_episode(run, handle, ReturnCause::Server).await;
        Ok(())
    }

    async fn overdue(&self) -> Result<Vec<String>, Refusal> {
        self.overdue_runs().await
    }

    async fn expire_run(&self, run: &str) -> Result<(), Refusal> {
        let ended =
            self.store.end_run(run, RunState::Expired, self.clock.now_unix_ms()).await.map_err(refusal)?;
        self.sign_if_over(&ended).await;
        Ok(())
    }

    async fn finish_run(&self, run: &str, abandons: bool) -> Result<RunStatus, Refusal> {
        // A change of the clock a moment ago must not expire the run.
        let time = self.settled_time().await?;
        let now = time.unix_ms();
        let mut finished = self.store.finish_run(run, now).await.map_err(refusal)?;
        if abandons && finished.state.is_open() {
            let state = if finished.is_overdue(now) { RunState::Expired } else { RunState::Cancelled };
            finished = self.store.end_run(run, state, now).await.map_err(refusal)?;
        }
        drop(time);
        self.sign_if_over(&finished).await;
        let view = self.store.reader().run(&Viewer::Team(finished.team), run).await.map_err(refusal)?;
        let missing = || Refusal::internal(format!("run {run} disappeared at its end"));
        self.status(view.ok_or_else(missing)?).await
    }
}

impl Arena {
    /// Cancels a run and signs the log. Running episodes may still store results.
    pub(crate) async fn cancel(&self, run: &str) -> Result<(), StoreError> {
        let cancelled = self.store.cancel_run(run, self.clock.now_unix_ms()).await?;
        self.sign_if_over(&cancelled).await;
        Ok(())
    }

    async fn status(&self, view: RunView) -> Result<RunStatus, Refusal> {
        let charge = self.store.charge(&view.line.run).await.map_err(refusal)?;
        let run = self.store.run(&view.line.run).await.map_err(refusal)?;
        let deadline_unix_ms = run.deadline_unix_ms.filter(|_| run.state.is_open());
        let status = status(view, charge);
        Ok(RunStatus { deadline_unix_ms, url: format!("{}{}", self.web_url, status.url), ..status })
    }

    pub(crate) async fn describe(&self, run: &str) -> Result<OpenRun, Refusal> {
        let time = self.settled_time().await?;
        let run = self.store.run(run).await.map_err(refusal)?;
        let is_overdue = run.is_overdue(time.unix_ms());
        drop(time);
        let phase = self.phase(&run.phase).await?;
        let dataset = self.store.agent_digest(&run.phase, phase.split.digest()).await.map_err(refusal)?;
        let dataset =
            dataset.ok_or_else(|| Refusal::internal(format!("phase '{}' has no commitment", run.phase)))?;
        Ok(OpenRun {
            run: run.id.clone(),
            team: run.team.clone(),
            time: phase.settings.time,
            deadline_unix_ms: run.deadline_unix_ms,
            over: match run.state {
                state if !state.is_open() => Some(state),
                _ if is_overdue => Some(RunState::Expired),
                _ => None,
            },
            max_slots: phase.settings.max_slots,
            rules: phase.rules().clone(),
            sensors: phase.settings.sensors.clone(),
            episodes: run.episodes,
            done: run.done,
            sealed: run.is_sealed(),
            digests: Digests {
                engine: format!("avln {}", env!("CARGO_PKG_VERSION")),
                dataset,
                scorer: BENCHMARK_VERSION.to_owned(),
                config: phase.config_digest(),
            },
        })
    }

    async fn now(&self) -> Result<PhaseList, Refusal> {
        self.phases.now(&self.store).await.map_err(Refusal::internal)
    }

    pub(crate) async fn phase(&self, phase: &str) -> Result<Arc<HostedPhase>, Refusal> {
        let found = find_phase(&self.now().await?, phase);
        found.ok_or_else(|| Refusal::internal(format!("phase '{phase}' is not hosted")))
    }

    async fn stage_for(&self, phase: &str, account: &Account) -> Result<Arc<HostedPhase>, Refusal> {
        if let Some(found) = find_phase(&self.now().await?, phase) {
            return Ok(found);
        }
        let known = Host::phases(self, Some(account)).await?;
        let known: Vec<_> = known.into_iter().map(|phase| phase.id).collect();
        let message = format!("there is no phase '{phase}'; this server hosts: {}", known.join(", "));
        Err(Refusal::new(Reason::PhaseUnknown, message))
    }
}

fn viewer(account: &Account) -> Viewer {
    match account.scope {
        TokenScope::Organiser => Viewer::Organiser,
        TokenScope::Participant | TokenScope::ReadOnly | TokenScope::Run => {
            Viewer::Team(account.team.clone())
        }
    }
}

fn account_of(state: TokenState) -> Result<Account, Refusal> {
    match state {
        TokenState::Valid(token) if token.kind != TokenScope::Run => Ok(Account {
            team: token.team.unwrap_or_default(),
            scope: token.kind,
            token_name: token.name,
            expires_unix_ms: token.expires_unix_ms,
        }),
        other => Err(token_refusal(&other)),
    }
}

fn phase_info(phase: PhaseView) -> PhaseInfo {
    PhaseInfo {
        id: phase.id,
        title: phase.title,
        description: phase.description,
        time: phase.time,
        orders: phase.orders,
        rules: phase.rules.name,
        episode_count: phase.episodes,
        feedback: phase.feedback,
        max_slots: phase.max_slots,
        sensors: phase.sensors,
        state: phase.state,
        state_reason: phase.state_reason,
        opens_unix_ms: phase.opens_unix_ms,
        closes_unix_ms: phase.closes_unix_ms,
        results: phase.scores,
        sealed: phase.sealed,
        commitment: phase.promise.as_ref().map(|promise| promise.commitment.clone()),
        revealed: phase.promise.and_then(|promise| promise.revealed),
    }
}

fn status(view: RunView, charge: Charge) -> RunStatus {
    let sealed = view.digests.contains_key(Run::SEALED);
    let line = view.line;
    let running = view.episodes.iter().filter(|episode| episode.state == EpisodeState::Running);
    let count = |end: EndReason| view.health.get(end.as_str()).map(|&count| (end, count));
    let ineligible = !view.eligible && line.finished_unix_ms.is_some();
    RunStatus {
        url: format!("/runs/{}", line.run),
        sealed,
        charge,
        deadline_unix_ms: None,
        run: line.run,
        phase: line.phase,
        method: view.method,
        order: line.order,
        state: line.state,
        episodes: line.episodes,
        done: line.done,
        in_flight: running.count() as u32,
        created_unix_ms: line.created_unix_ms,
        updated_unix_ms: line.finished_unix_ms.unwrap_or(line.created_unix_ms),
        ends: EndReason::ALL.into_iter().filter_map(count).collect(),
        metrics: view.summary.filter(|_| view.scores_visible).as_ref().map(columns),
        ineligible_because: ineligible.then(|| why_ineligible(line.disqualified)).into_iter().collect(),
    }
}

fn why_ineligible(disqualified: Option<String>) -> String {
    match disqualified {
        Some(reason) => format!("the organiser disqualified it: {reason}"),
        None => "only completed runs whose every episode counts are ranked".to_owned(),
    }
}

fn columns(summary: &Summary) -> Vec<(String, f64)> {
    Metric::headlines().filter_map(|metric| Some((metric.id.to_owned(), metric.mean_of(summary)?))).collect()
}

fn token_refusal(state: &TokenState) -> Refusal {
    let renew = "ask the organiser for a new one (avln challenge team add NAME)";
    match state {
        TokenState::Expired => Refusal::new(Reason::TokenExpired, format!("the token has expired; {renew}")),
        TokenState::Revoked => Refusal::new(Reason::TokenRevoked, format!("the token was revoked; {renew}")),
        TokenState::Valid(token) => Refusal::new(Reason::TokenScope, wrong_kind(token.kind)),
        TokenState::Unknown => Refusal::new(
            Reason::TokenMalformed,
            format!("this server has not issued the token; check that it was copied completely, or {renew}"),
        ),
    }
}

/// Describes a token of the wrong kind, and the right kind: only run tokens play, and they do nothing else.
fn wrong_kind(given: TokenScope) -> String {
    let run_token = "the run token that StartRun returned";
    let (given, needed) = match given {
        TokenScope::Run => ("a run token", "an account token of the team"),
        TokenScope::Participant => ("an account token", run_token),
        TokenScope::ReadOnly => ("a read-only account token", run_token),
        TokenScope::Organiser => ("an organiser token", run_token),
    };
    format!("this is {given}; this call needs {needed}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scope_refusals_name_both_kinds_of_tokens() {
        for (kind, given, needed) in [
            (TokenScope::Run, "is a run token;", "needs an account token"),
            (TokenScope::Participant, "is an account token;", "needs the run token"),
            (TokenScope::ReadOnly, "is a read-only account token;", "needs the run token"),
            (TokenScope::Organiser, "is an organiser token;", "needs the run token"),
        ] {
            let message = wrong_kind(kind);
            assert!(message.contains(given) && message.contains(needed), "{message}");
        }
    }

    #[test]
    fn unranked_runs_report_a_reason() {
        assert_eq!(why_ineligible(None), "only completed runs whose every episode counts are ranked");
        let why = why_ineligible(Some("it knew the houses".to_owned()));
        assert_eq!(why, "the organiser disqualified it: it knew the houses");
    }
}
