//! Command failures.

use std::{fmt, path::Path, process::ExitCode};

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

impl From<avln_store::StoreError> for Failure {
    fn from(error: avln_store::StoreError) -> Self {
        Self::data(error)
    }
}

impl From<avln_dataset::DatasetError> for Failure {
    fn from(error: avln_dataset::DatasetError) -> Self {
        Self::scene(error)
    }
}
