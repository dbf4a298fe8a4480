use std::{fmt, process::ExitCode};

/// A failure of a command: message, next step, and exit code.
#[derive(Debug)]
pub struct Failure {
    kind: FailureKind,
    message: String,
    hint: Option<String>,
}

/// Kinds of failure with their exit codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FailureKind {
    /// An internal error.
    Internal = 1,
    /// The data folder or its database is unusable.
    Data = 3,
    /// An address cannot be listened on.
    Address = 4,
    /// A scene or a split cannot be used.
    Scene = 5,
    /// An agent's run failed: no connection, a refused token, a lost stream.
    Run = 6,
}

impl Failure {
    /// A failure of `kind` with `message`.
    pub fn new(kind: FailureKind, message: impl fmt::Display) -> Self {
        Self { kind, message: message.to_string(), hint: None }
    }

    /// A failed run, check or request.
    pub fn run(message: impl fmt::Display) -> Self {
        Self::new(FailureKind::Run, message)
    }

    /// Adds the next step.
    pub fn hinted(self, hint: impl fmt::Display) -> Self {
        Self { hint: Some(hint.to_string()), ..self }
    }

    /// The exit code.
    pub fn exit_code(&self) -> ExitCode {
        ExitCode::from(self.kind as u8)
    }

    /// Kind of the failure.
    pub fn kind(&self) -> FailureKind {
        self.kind
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.message)?;
        match &self.hint {
            Some(hint) => write!(f, "\nhint: {hint}"),
            None => Ok(()),
        }
    }
}

impl std::error::Error for Failure {}

impl From<avln_store::StoreError> for Failure {
    fn from(error: avln_store::StoreError) -> Self {
        Self::new(FailureKind::Data, error)
    }
}

impl From<avln_dataset::DatasetError> for Failure {
    fn from(error: avln_dataset::DatasetError) -> Self {
        Self::new(FailureKind::Scene, error)
    }
}
