//! Store types and errors converted for the gRPC server.

use crate::now_unix_ms;
use avln_challenge::{Account, Charge, PhaseInfo, RunStatus, TokenScope};
use avln_episode::EndReason;
use avln_grpc::{Reason, Refusal};
use avln_scoring::{Metric, Summary};
use avln_store::{EpisodeState, PhaseView, QuotaWindow, Run, RunView, StoreError, TokenState, Viewer};
use std::sync::atomic::{AtomicU64, Ordering};

pub(crate) fn viewer(account: &Account) -> Viewer {
    match account.scope {
        TokenScope::Organiser => Viewer::Organiser,
        TokenScope::Participant | TokenScope::ReadOnly | TokenScope::Run => {
            Viewer::Team(account.team.clone())
        }
    }
}

pub(crate) fn account_of(state: TokenState) -> Result<Account, Refusal> {
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

pub(crate) fn phase_info(phase: PhaseView) -> PhaseInfo {
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

pub(crate) fn status(view: RunView, charge: Charge) -> RunStatus {
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

// One counter per process: the web page and the metrics report all arenas together.
static FAULTS: AtomicU64 = AtomicU64::new(0);

/// Counts the store failures since the process start.
pub fn fault_count() -> u64 {
    FAULTS.load(Ordering::Relaxed)
}

/// Converts a store error. An agent's fault becomes a refusal, all else a server fault.
pub(crate) fn refusal(error: StoreError) -> Refusal {
    let reason = match &error {
        StoreError::Unknown { what: "phase", .. } => Reason::PhaseUnknown,
        StoreError::Unknown { what: "run", .. } => Reason::RunUnknown,
        StoreError::PhaseClosed(_) => Reason::PhaseClosed,
        StoreError::PhaseNotOpen { .. } => Reason::PhaseNotOpen,
        StoreError::PhasePaused { .. } => Reason::PhasePaused,
        StoreError::PhaseNotVisible { .. } => Reason::PhaseNotVisible,
        StoreError::TeamNotApproved { .. } | StoreError::PhaseSealed(_) => Reason::TeamNotApproved,
        StoreError::QuotaUsed(quota) => quota_reason(quota.window),
        StoreError::RunOver { .. } => Reason::RunOver,
        StoreError::OrderNotAllowed { .. } | StoreError::Taken { .. } => Reason::BadRequest,
        _ => {
            FAULTS.fetch_add(1, Ordering::Relaxed);
            return Refusal::internal(error);
        }
    };
    let refusal = Refusal::new(reason, error.to_string());
    let retry_unix_ms = match error {
        StoreError::PhaseNotOpen { opens_unix_ms, .. } => Some(opens_unix_ms),
        StoreError::QuotaUsed(quota) => quota.next_increase_unix_ms,
        _ => None,
    };
    match retry_unix_ms {
        Some(moment) => refusal.retry_after(seconds_until(moment, now_unix_ms())),
        None => refusal,
    }
}

fn quota_reason(window: QuotaWindow) -> Reason {
    match window {
        QuotaWindow::Day => Reason::QuotaDay,
        QuotaWindow::Month => Reason::QuotaMonth,
        QuotaWindow::Total | QuotaWindow::Uncharged => Reason::QuotaTotal,
        QuotaWindow::Concurrent => Reason::QuotaConcurrent,
    }
}

/// Returns the seconds until `moment`, rounded up and at least 1.
fn seconds_until(moment_unix_ms: i64, now_unix_ms: i64) -> u32 {
    let seconds = (moment_unix_ms - now_unix_ms).max(0) / 1000 + 1;
    u32::try_from(seconds).unwrap_or(u32::MAX)
}

pub(crate) fn token_refusal(state: &TokenState) -> Refusal {
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
