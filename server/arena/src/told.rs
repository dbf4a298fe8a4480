//! What the store knows, as the agents' door says it.

use super::refusals::token_refusal;
use avln_grpc::{
    Account, PhaseInfo, PhaseState, Quota, QuotaWindow, Refusal, Revealed, RunState, RunStatus, Scope,
    Visibility,
};
use avln_scoring::{Metric, Summary};
use avln_store::{Charge, PhaseView, RunView, TokenScope, TokenState, Viewer};
use std::collections::BTreeMap;

pub(super) fn viewer(account: &Account) -> Viewer {
    match account.scope {
        Scope::Organiser => Viewer::Organiser,
        Scope::Participant | Scope::ReadOnly => Viewer::Team(account.team.clone()),
    }
}

/// Who holds a token.
pub(super) fn account_of(state: TokenState) -> Result<Account, Refusal> {
    let TokenState::Valid(token) = state else { return Err(token_refusal(&state)) };
    let scope = match token.kind {
        TokenScope::Participant => Scope::Participant,
        TokenScope::ReadOnly => Scope::ReadOnly,
        TokenScope::Organiser => Scope::Organiser,
        TokenScope::Run => return Err(token_refusal(&TokenState::Valid(token))),
    };
    let team = token.team.unwrap_or_default();
    Ok(Account { team, scope, token_name: token.name, expires_unix_s: seconds(token.expires_unix_ms) })
}

/// Whole seconds of a moment; 0 where there is none.
fn seconds(unix_ms: Option<i64>) -> i64 {
    unix_ms.map_or(0, |ms| ms.div_euclid(1000))
}

pub(super) fn quota_of(quota: avln_store::Quota) -> Quota {
    use avln_store::QuotaWindow as Stored;
    Quota {
        phase: quota.phase,
        window: match quota.window {
            Stored::Day => QuotaWindow::Day,
            Stored::Month => QuotaWindow::Month,
            Stored::Total => QuotaWindow::Total,
            Stored::Concurrent => QuotaWindow::Concurrent,
            Stored::Uncharged => QuotaWindow::Uncharged,
        },
        limit: quota.limit,
        used: quota.used,
        remaining: quota.remaining,
        window_start_unix_s: quota.window_start_unix_ms.div_euclid(1000),
        next_increase_unix_s: seconds(quota.next_increase_unix_ms),
        charges: quota.charges.into_iter().map(|charge| (charge.run, charge.reason.to_owned())).collect(),
    }
}

pub(super) fn phase_info(phase: PhaseView) -> PhaseInfo {
    let promise = phase.promise;
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
        state: match phase.state {
            avln_store::PhaseState::Upcoming => PhaseState::Upcoming,
            avln_store::PhaseState::Open => PhaseState::Open,
            avln_store::PhaseState::Paused => PhaseState::Paused,
            avln_store::PhaseState::Closed => PhaseState::Closed,
        },
        state_reason: phase.state_reason.unwrap_or_default(),
        opens_unix_s: seconds(phase.opens_unix_ms),
        closes_unix_s: seconds(phase.closes_unix_ms),
        results: match phase.scores {
            avln_store::Visibility::Public => Visibility::Public,
            avln_store::Visibility::Team => Visibility::Team,
            avln_store::Visibility::Organiser => Visibility::Organiser,
        },
        sealed: phase.sealed,
        commitment: promise.as_ref().map(|promise| promise.commitment.clone()).unwrap_or_default(),
        revealed: promise.and_then(|promise| promise.revealed).map(|values| Revealed {
            pool: values.pool,
            scorer: values.scorer,
            secret: values.secret,
        }),
    }
}

/// A run as its own team may see it.
pub(super) fn status(view: RunView, charge: Charge) -> RunStatus {
    let sealed = view.digests.contains_key(avln_store::Run::SEALED);
    let line = view.line;
    let playing = view.episodes.iter().filter(|episode| episode.state == avln_store::EpisodeState::Running);
    let ineligible = !view.eligible && line.finished_unix_ms.is_some();
    RunStatus {
        url: format!("/runs/{}", line.run),
        sealed,
        charged: charge.charged,
        charge_reason: charge.reason.to_owned(),
        deadline_unix_ms: None,
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
            avln_store::RunState::Failed => RunState::Failed,
            avln_store::RunState::Expired => RunState::Expired,
        },
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
