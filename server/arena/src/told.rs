//! Conversion of store types to the domain types that the gRPC server sends.

use super::refusals::token_refusal;
use avln_challenge::{Account, Charge, PhaseInfo, RunStatus, TokenScope};
use avln_grpc::Refusal;
use avln_scoring::{Metric, Summary};
use avln_store::{PhaseView, RunView, TokenState, Viewer};
use std::collections::BTreeMap;

pub(super) fn viewer(account: &Account) -> Viewer {
    match account.scope {
        TokenScope::Organiser => Viewer::Organiser,
        TokenScope::Participant | TokenScope::ReadOnly | TokenScope::Run => {
            Viewer::Team(account.team.clone())
        }
    }
}

/// Returns the account of a token.
pub(super) fn account_of(state: TokenState) -> Result<Account, Refusal> {
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

pub(super) fn phase_info(phase: PhaseView) -> PhaseInfo {
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

/// Returns the status of a run for its own team.
pub(super) fn status(view: RunView, charge: Charge) -> RunStatus {
    let sealed = view.digests.contains_key(avln_store::Run::SEALED);
    let line = view.line;
    let playing = view.episodes.iter().filter(|episode| episode.state == avln_store::EpisodeState::Running);
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
        in_flight: playing.count() as u32,
        created_unix_ms: line.created_unix_ms,
        updated_unix_ms: line.finished_unix_ms.unwrap_or(line.created_unix_ms),
        ends: ends(&view.health),
        metrics: view.summary.filter(|_| view.scores_visible).as_ref().map(columns),
        ineligible_because: ineligible.then(|| why_ineligible(line.disqualified)).into_iter().collect(),
    }
}

/// Why a run that is over is on no board.
fn why_ineligible(disqualified: Option<String>) -> String {
    match disqualified {
        Some(reason) => format!("the organiser disqualified it: {reason}"),
        None => "only completed runs whose every episode counts are ranked".to_owned(),
    }
}

fn ends(health: &BTreeMap<&'static str, u32>) -> Vec<(avln_episode::EndReason, u32)> {
    let count = |end: avln_episode::EndReason| health.get(end.as_str()).map(|&count| (end, count));
    avln_episode::EndReason::ALL.into_iter().filter_map(count).collect()
}

fn columns(summary: &Summary) -> Vec<(String, f64)> {
    Metric::headlines().filter_map(|metric| Some((metric.id.to_owned(), metric.mean_of(summary)?))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_team_is_told_why_its_run_is_on_no_board() {
        assert_eq!(why_ineligible(None), "only completed runs whose every episode counts are ranked");
        let why = why_ineligible(Some("it knew the houses".to_owned()));
        assert_eq!(why, "the organiser disqualified it: it knew the houses");
    }
}
