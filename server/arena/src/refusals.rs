//! Conversion of store errors to gRPC refusals.

use super::now_unix_ms;
use avln_grpc::{Reason, Refusal};
use avln_store::{QuotaWindow, StoreError, TokenState};
use std::sync::atomic::{AtomicU64, Ordering};

/// Store failures of all arenas in the process.
static FAULTS: AtomicU64 = AtomicU64::new(0);

/// Number of store failures since the start of the process.
pub fn fault_count() -> u64 {
    FAULTS.load(Ordering::Relaxed)
}

/// Converts a store error: agent faults become refusals, others server faults.
pub(super) fn refusal(error: StoreError) -> Refusal {
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
    match waiting_helps_at(&error) {
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

/// From when the same request can succeed, milliseconds since 1970-01-01 UTC.
fn waiting_helps_at(error: &StoreError) -> Option<i64> {
    match error {
        StoreError::PhaseNotOpen { opens_unix_ms, .. } => Some(*opens_unix_ms),
        StoreError::QuotaUsed(quota) => quota.next_increase_unix_ms,
        _ => None,
    }
}

/// Seconds from `now` to `moment`, rounded up, 1 at least.
fn seconds_until(moment_unix_ms: i64, now_unix_ms: i64) -> u32 {
    let seconds = (moment_unix_ms - now_unix_ms).max(0) / 1000 + 1;
    u32::try_from(seconds).unwrap_or(u32::MAX)
}

/// Refusal for an unusable token.
pub(super) fn token_refusal(state: &TokenState) -> Refusal {
    let renew = "ask the organiser for a new one (avln challenge team add NAME)";
    match state {
        TokenState::Expired => Refusal::new(Reason::TokenExpired, format!("the token has expired; {renew}")),
        TokenState::Revoked => Refusal::new(Reason::TokenRevoked, format!("the token was revoked; {renew}")),
        TokenState::Valid(_) => Refusal::new(
            Reason::TokenScope,
            "the token is of another kind; account tokens start runs, run tokens play them",
        ),
        TokenState::Unknown => Refusal::new(
            Reason::TokenMalformed,
            format!("the token is not one of this server's; check that it was copied whole, or {renew}"),
        ),
    }
}
