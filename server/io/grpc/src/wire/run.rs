//! Server, phases, quotas and runs.

use crate::{
    control::unix_ms,
    host::{ServerInfo, StoredEnd},
    limits::Limits,
};
use avln_challenge::{MethodInfo, MethodType, PhaseInfo, Quota, RunState, RunStatus, TokenScope};
use avln_episode::EndReason;
use avln_proto::v1::{self, SensorKind};

pub(crate) fn server_info(
    info: ServerInfo,
    limits: &Limits,
    draining: bool,
    notice: String,
) -> v1::GetServerInfoResponse {
    let state = if draining { v1::ServerState::Draining } else { v1::ServerState::Up };
    let clients = info.clients.into_iter().map(|range| v1::ClientRange {
        name: range.name,
        min_version: range.min_version,
        max_version: range.max_version,
        min_api_minor: 0,
        install: range.install,
    });
    v1::GetServerInfoResponse {
        name: info.name,
        version: info.version,
        api_minor: info.api_minor,
        benchmark: info.benchmark,
        digests: None,
        clients: clients.collect(),
        encodings: super::sensors::offered(),
        max_request_bytes: limits.decode_bytes as u32,
        server_time_unix_ms: unix_ms(),
        state: state.into(),
        notice,
    }
}

pub(crate) fn phase(phase: PhaseInfo) -> v1::Phase {
    let sensors = [
        (phase.sensors.rgb, SensorKind::Rgb),
        (phase.sensors.depth, SensorKind::Depth),
        (phase.sensors.audio, SensorKind::Audio),
    ];
    v1::Phase {
        id: phase.id,
        title: phase.title,
        description: phase.description,
        orders: phase.orders.into_iter().map(|order| super::order(order).into()).collect(),
        episodes: phase.episode_count,
        max_slots: phase.max_slots.min(Limits::MAX_SLOTS),
        feedback: super::feedback_rule(phase.feedback).into(),
        sensors: sensors.into_iter().filter(|(on, _)| *on).map(|(_, kind)| kind.into()).collect(),
        encodings: super::sensors::offered_in(&phase.sensors),
        state: super::phase_state(phase.state).into(),
        state_reason: phase.state_reason.unwrap_or_default(),
        opens_unix_s: seconds(phase.opens_unix_ms),
        closes_unix_s: seconds(phase.closes_unix_ms),
        results: super::visibility(phase.results).into(),
        commitment: phase.commitment.unwrap_or_default(),
        revealed: phase.revealed.map(|values| v1::Revealed {
            pool: values.pool,
            scorer: values.scorer,
            secret: values.secret,
        }),
        time: Some(super::time_limits(&phase.time)),
        rules: phase.rules,
        sealed: phase.sealed,
        max_side: phase.sensors.width.max(phase.sensors.height),
    }
}

pub(crate) fn scope(scope: TokenScope) -> v1::TokenScope {
    match scope {
        TokenScope::Participant => v1::TokenScope::Participant,
        TokenScope::ReadOnly => v1::TokenScope::ReadOnly,
        TokenScope::Organiser => v1::TokenScope::Organiser,
        // Run tokens have no account, so hosts never return this scope.
        TokenScope::Run => v1::TokenScope::Unspecified,
    }
}

/// Returns whole seconds, and 0 if there is no time.
pub(crate) fn seconds(unix_ms: Option<i64>) -> i64 {
    unix_ms.map_or(0, |ms| ms.div_euclid(1000))
}

pub(crate) fn quota(quota: Quota) -> v1::Quota {
    v1::Quota {
        phase: quota.phase,
        window: super::quota_window(quota.window).into(),
        limit: quota.limit,
        used: quota.used,
        remaining: quota.remaining,
        window_start_unix_s: quota.window_start_unix_ms.div_euclid(1000),
        next_increase_unix_s: seconds(quota.next_increase_unix_ms),
        charges: quota
            .charges
            .into_iter()
            .map(|charge| v1::Charge { run: charge.run, reason: charge.reason.to_owned() })
            .collect(),
    }
}

pub(crate) fn run(status: RunStatus) -> v1::Run {
    let over = !status.state.is_open();
    let progress = progress(&status);
    v1::Run {
        id: status.run,
        phase: status.phase,
        order: super::order(status.order).into(),
        method: Some(method(status.method)),
        state: super::run_state(status.state).into(),
        state_since_unix_ms: status.updated_unix_ms,
        state_deadline_unix_ms: status.deadline_unix_ms.unwrap_or_default(),
        created_unix_ms: status.created_unix_ms,
        ended_unix_ms: if over { status.updated_unix_ms } else { 0 },
        progress: Some(progress),
        ends: end_counts(&status.ends),
        eligible: status.ineligible_because.is_empty(),
        ineligible_because: status.ineligible_because,
        metrics: status.metrics.map(|metrics| public_metrics(metrics, status.done)),
        sealed: status.sealed,
        charged: status.charge.charged,
        charge_reason: status.charge.reason.to_owned(),
        url: status.url,
        ..v1::Run::default()
    }
}

/// Builds an episode's end, without the run's progress.
pub(crate) fn episode_end(slot: u32, episode: &str, end: StoredEnd) -> v1::EpisodeEnd {
    v1::EpisodeEnd {
        slot,
        episode: episode.to_owned(),
        step: end.steps,
        reason: super::end_reason(end.reason).into(),
        terminated: end.reason.is_terminated(),
        metrics: end.outcome.map(|outcome| public_metrics(outcome.metrics, 0)),
        progress: None,
    }
}

pub(crate) fn run_end(status: RunStatus) -> v1::RunEnd {
    let cut_short = matches!(status.state, RunState::Failed | RunState::Cancelled | RunState::Expired);
    v1::RunEnd {
        progress: Some(progress(&status)),
        run: status.run,
        ends: end_counts(&status.ends),
        metrics: status.metrics.map(|metrics| public_metrics(metrics, status.done)),
        complete: !cut_short && status.done >= status.episodes,
        url: status.url,
    }
}

fn progress(status: &RunStatus) -> v1::RunProgress {
    v1::RunProgress { total: status.episodes, done: status.done, in_flight: status.in_flight, eta_s: None }
}

fn method(method: MethodInfo) -> v1::MethodInfo {
    let MethodInfo { name, version, method_type, .. } = method;
    v1::MethodInfo {
        name,
        version,
        description: method.description,
        code_url: method.code_url,
        paper_url: method.paper_url,
        weights_licence: method.weights_licence,
        external_data: method.external_data,
        method_type: method_type.map_or(v1::MethodType::Unspecified, super::method_type).into(),
    }
}

/// Returns the type of a method; `None` if the client declared none.
pub(crate) fn declared_type(declared: v1::MethodType) -> Option<MethodType> {
    MethodType::ALL.iter().copied().find(|&known| super::method_type(known) == declared)
}

fn end_counts(ends: &[(EndReason, u32)]) -> Vec<v1::EndCount> {
    let count = |&(reason, episodes)| v1::EndCount { reason: super::end_reason(reason).into(), episodes };
    ends.iter().map(count).collect()
}

/// Builds public metrics over a number of episodes; 0 for a single episode.
fn public_metrics(metrics: Vec<(String, f64)>, episodes: u32) -> v1::PublicMetrics {
    let metric = |(name, value)| v1::Metric { name, value, low: None, high: None, n: episodes };
    v1::PublicMetrics { metrics: metrics.into_iter().map(metric).collect() }
}
