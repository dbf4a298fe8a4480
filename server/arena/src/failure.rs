//! Command failures, and refusals of the gRPC server for store errors.

use crate::now_unix_ms;
use avln_dataset::DatasetError;
use avln_grpc::{Reason, Refusal};
use avln_store::{QuotaWindow, StoreError};
use std::{
    fmt,
    path::Path,
    process::ExitCode,
    sync::atomic::{AtomicU64, Ordering},
};

/// A failed command: message, next step and exit code.
#[derive(Debug, thiserror::Error)]
#[error("{message}{hint}")]
pub struct Failure {
    kind: FailureKind,
    message: String,
    /// A line with the next step, after a line break; may be empty.
    hint: String,
}

/// Failure kinds with exit codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FailureKind {
    /// An internal error.
    Internal = 1,
    /// An unusable data folder, database or input file.
    Data = 3,
    /// An unavailable address.
    Address = 4,
    /// An unusable scene or split.
    Scene = 5,
    /// A failed run, check or request.
    Run = 6,
    /// An intact run log without proof of completeness.
    Unproven = 7,
}

impl Failure {
    /// Creates a failure without a next step.
    pub fn new(kind: FailureKind, message: impl fmt::Display) -> Self {
        Self { kind, message: message.to_string(), hint: String::new() }
    }

    /// Creates an internal failure.
    pub fn internal(message: impl fmt::Display) -> Self {
        Self::new(FailureKind::Internal, message)
    }

    /// Creates a data failure.
    pub fn data(message: impl fmt::Display) -> Self {
        Self::new(FailureKind::Data, message)
    }

    /// Creates an address failure.
    pub fn address(message: impl fmt::Display) -> Self {
        Self::new(FailureKind::Address, message)
    }

    /// Creates a scene failure.
    pub fn scene(message: impl fmt::Display) -> Self {
        Self::new(FailureKind::Scene, message)
    }

    /// Creates a run failure.
    pub fn run(message: impl fmt::Display) -> Self {
        Self::new(FailureKind::Run, message)
    }

    /// Creates a failure for an intact run log without proof of completeness.
    pub fn unproven(message: impl fmt::Display) -> Self {
        Self::new(FailureKind::Unproven, message)
    }

    /// Creates a data failure for a file: "cannot read FILE: error". `verb` is the action.
    pub fn file(verb: &str, path: &Path, error: impl fmt::Display) -> Self {
        Self::data(format!("cannot {verb} {}: {error}", path.display()))
    }

    /// Adds the next step.
    pub fn hinted(self, hint: impl fmt::Display) -> Self {
        Self { hint: format!("\nhint: {hint}"), ..self }
    }

    /// Returns the exit code.
    pub fn exit_code(&self) -> ExitCode {
        ExitCode::from(self.kind as u8)
    }

    /// Returns the kind.
    pub fn kind(&self) -> FailureKind {
        self.kind
    }
}

impl From<StoreError> for Failure {
    fn from(error: StoreError) -> Self {
        Self::data(error)
    }
}

impl From<DatasetError> for Failure {
    fn from(error: DatasetError) -> Self {
        Self::scene(error)
    }
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
