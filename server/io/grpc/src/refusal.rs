//! Refused requests, and their gRPC status.

use avln_proto::v1::{self, Reason};
use avln_proto::{REASON_KEY, RETRY_AFTER_KEY};
use std::{
    fmt::Display,
    future::Future,
    hash::{BuildHasher, Hasher},
    sync::Arc,
};
use tonic::{Code, Status, metadata::MetadataValue};
use tracing::Instrument;

pub(crate) type Result<T, E = Failure> = std::result::Result<T, E>;

/// A refused request. The message is logged and not sent for [`Reason::Internal`] and [`Reason::SimFault`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct Refusal {
    /// Reason, for programs.
    pub reason: Reason,
    /// Explanation for people: the attempt with its value, the limit, and the next step.
    pub message: String,
    /// Delay after which a retry makes sense, seconds.
    pub retry_after_s: Option<u32>,
}

impl Refusal {
    /// Creates a refusal without a retry delay.
    pub fn new(reason: Reason, message: impl Into<String>) -> Self {
        Self { reason, message: message.into(), retry_after_s: None }
    }

    /// Adds a retry delay, seconds.
    pub fn retry_after(self, seconds: u32) -> Self {
        Self { retry_after_s: Some(seconds), ..self }
    }

    /// Creates a server failure: `detail` is logged, the agent receives an incident id.
    pub fn internal(detail: impl Display) -> Self {
        Self::new(Reason::Internal, detail.to_string())
    }
}

/// A failed call, as reported to the client. A server failure's details are in the log only, under the incident id.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Failure {
    pub(crate) reason: Reason,
    pub(crate) message: String,
    retry_after_s: Option<u32>,
    /// Empty for a refusal.
    incident: String,
}

impl Failure {
    pub(crate) fn new(reason: Reason, message: impl Into<String>) -> Self {
        Self { reason, message: message.into(), retry_after_s: None, incident: String::new() }
    }

    /// Logs a server failure outside the simulator.
    pub(crate) fn server(attempt: &str, detail: impl Display) -> Self {
        let incident = log_incident(attempt, detail);
        let message = format!("the server failed; report {incident} to its organiser");
        Self { incident, ..Self::new(Reason::Internal, message) }
    }

    /// Logs a simulator failure.
    pub(crate) fn simulator(attempt: &str, detail: impl Display) -> Self {
        let incident = log_incident(attempt, detail);
        let message = format!("the simulator failed ({incident}); the episode does not count");
        Self { incident, ..Self::new(Reason::SimFault, message) }
    }

    pub(crate) fn frame(&self, subject: FaultSubject<'_>, recoverable: bool) -> v1::Fault {
        v1::Fault {
            slot: subject.slot,
            episode: subject.episode.to_owned(),
            step: subject.step,
            code: self.reason.code() as u32,
            reason: self.reason.into(),
            message: self.message.clone(),
            recoverable,
            retry_after_s: self.retry_after_s,
            id: self.incident.clone(),
        }
    }
}

fn log_incident(attempt: &str, detail: impl Display) -> String {
    let random = std::hash::RandomState::new().build_hasher().finish();
    let id = format!("inc_{random:016x}");
    tracing::error!(id, attempt, %detail, "server fault");
    id
}

/// A fault's subject; the default is the whole stream.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct FaultSubject<'a> {
    pub(crate) slot: Option<u32>,
    pub(crate) episode: &'a str,
    pub(crate) step: u32,
}

impl From<Refusal> for Failure {
    fn from(refusal: Refusal) -> Self {
        let Refusal { reason, message, retry_after_s } = refusal;
        match reason.code() {
            _ if reason == Reason::SimFault => Self::simulator("host", message),
            Code::Internal | Code::Unknown => Self::server("host", message),
            _ => Self { retry_after_s, ..Self::new(reason, message) },
        }
    }
}

impl From<Failure> for Status {
    fn from(failure: Failure) -> Self {
        let mut status = Self::new(failure.reason.code(), failure.message);
        let trailers = status.metadata_mut();
        trailers.insert(REASON_KEY, MetadataValue::from_static(failure.reason.word()));
        if let Some(seconds) = failure.retry_after_s {
            trailers.insert(RETRY_AFTER_KEY, MetadataValue::from(seconds));
        }
        status
    }
}

impl From<Refusal> for Status {
    fn from(refusal: Refusal) -> Self {
        Failure::from(refusal).into()
    }
}

/// Calls the host. A panic becomes a server fault.
pub(crate) async fn call_host<H, T, F>(
    attempt: &'static str,
    host: &Arc<H>,
    call: impl FnOnce(Arc<H>) -> F,
) -> Result<T>
where
    T: Send + 'static,
    F: Future<Output = Result<T, Refusal>> + Send + 'static,
{
    // In a task, so that a caller that hangs up does not cancel the work halfway.
    match tokio::spawn(call(host.clone()).in_current_span()).await {
        Ok(answer) => answer.map_err(Failure::from),
        Err(broken) => Err(Failure::server(attempt, broken)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_carries_code_reason_and_delay() {
        let refusal = Refusal::new(Reason::NoCapacity, "the server is full").retry_after(7);
        let status = Status::from(Failure::from(refusal));
        assert_eq!(status.code(), Code::ResourceExhausted);
        assert_eq!(status.message(), "the server is full");
        assert_eq!(status.metadata().get(REASON_KEY).unwrap(), "NO_CAPACITY");
        assert_eq!(status.metadata().get(RETRY_AFTER_KEY).unwrap(), "7");
    }

    #[test]
    fn server_fault_details_stay_in_the_log() {
        let status = Status::from(Failure::from(Refusal::internal("target 17 is a sofa")));
        assert_eq!(status.code(), Code::Internal);
        assert!(!status.message().contains("sofa"), "{}", status.message());
        assert!(status.message().contains("inc_"), "{}", status.message());
    }

    #[tokio::test]
    async fn host_panics_are_server_faults() {
        let failure =
            call_host::<_, (), _>("test", &Arc::new(()), |_| async { panic!("secret") }).await.unwrap_err();
        assert_eq!(failure.reason, Reason::Internal);
        assert!(!failure.message.contains("secret"));
    }
}
