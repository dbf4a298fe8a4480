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

/// A request that the server refuses.
///
/// If the reason is [`Reason::Internal`] or [`Reason::SimFault`], the message is logged and not sent to the agent.
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

/// A server failure. The log has the details under the id; the agent receives only the id.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ServerFault {
    reason: Reason,
    id: String,
}

impl ServerFault {
    /// Logs a failure outside the simulator.
    pub(crate) fn log(attempt: &str, detail: impl Display) -> Self {
        Self::record(Reason::Internal, attempt, detail)
    }

    /// Logs a simulator failure.
    pub(crate) fn simulator(attempt: &str, detail: impl Display) -> Self {
        Self::record(Reason::SimFault, attempt, detail)
    }

    fn record(reason: Reason, attempt: &str, detail: impl Display) -> Self {
        let random = std::hash::RandomState::new().build_hasher().finish();
        let id = format!("inc_{random:016x}");
        tracing::error!(id, attempt, %detail, "server fault");
        Self { reason, id }
    }

    fn message(&self) -> String {
        match self.reason {
            Reason::SimFault => format!("the simulator failed ({}); the episode does not count", self.id),
            _ => format!("the server failed; report {} to its organiser", self.id),
        }
    }
}

/// A failed call: the client's or the server's fault.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Failure {
    Refused(Refusal),
    Fault(ServerFault),
}

impl Failure {
    pub(crate) fn new(reason: Reason, message: impl Into<String>) -> Self {
        Self::from(Refusal::new(reason, message))
    }

    pub(crate) fn reason(&self) -> Reason {
        match self {
            Self::Refused(refusal) => refusal.reason,
            Self::Fault(fault) => fault.reason,
        }
    }

    pub(crate) fn message(&self) -> String {
        match self {
            Self::Refused(refusal) => refusal.message.clone(),
            Self::Fault(fault) => fault.message(),
        }
    }

    fn retry_after_s(&self) -> Option<u32> {
        match self {
            Self::Refused(refusal) => refusal.retry_after_s,
            Self::Fault(_) => None,
        }
    }

    /// Returns the frame that reports the failure on a stream.
    pub(crate) fn frame(&self, subject: FaultSubject<'_>, recoverable: bool) -> v1::Fault {
        v1::Fault {
            slot: subject.slot,
            episode: subject.episode.to_owned(),
            step: subject.step,
            code: self.reason().code() as u32,
            reason: self.reason().into(),
            message: self.message(),
            recoverable,
            retry_after_s: self.retry_after_s(),
            id: match self {
                Self::Refused(_) => String::new(),
                Self::Fault(fault) => fault.id.clone(),
            },
        }
    }
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
        match refusal.reason {
            Reason::SimFault => Self::Fault(ServerFault::simulator("host", refusal.message)),
            reason if matches!(reason.code(), Code::Internal | Code::Unknown) => {
                Self::Fault(ServerFault::log("host", refusal.message))
            }
            _ => Self::Refused(refusal),
        }
    }
}

impl From<ServerFault> for Failure {
    fn from(fault: ServerFault) -> Self {
        Self::Fault(fault)
    }
}

impl From<Failure> for Status {
    fn from(failure: Failure) -> Self {
        let mut status = Self::new(failure.reason().code(), failure.message());
        let trailers = status.metadata_mut();
        trailers.insert(REASON_KEY, MetadataValue::from_static(failure.reason().word()));
        if let Some(seconds) = failure.retry_after_s() {
            trailers.insert(RETRY_AFTER_KEY, MetadataValue::from(seconds));
        }
        status
    }
}

/// Calls the host. A panic becomes a server fault.
pub(crate) async fn call_host<H, T, F>(
    attempt: &'static str,
    host: &Arc<H>,
    call: impl FnOnce(Arc<H>) -> F,
) -> Result<T, Failure>
where
    T: Send + 'static,
    F: Future<Output = Result<T, Refusal>> + Send + 'static,
{
    // In a task, so that a caller that hangs up does not cancel the work halfway.
    match tokio::spawn(call(host.clone()).in_current_span()).await {
        Ok(answer) => answer.map_err(Failure::from),
        Err(broken) => Err(ServerFault::log(attempt, broken).into()),
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
    fn details_of_a_server_fault_stay_in_the_log() {
        let status = Status::from(Failure::from(Refusal::internal("target 17 is a sofa")));
        assert_eq!(status.code(), Code::Internal);
        assert!(!status.message().contains("sofa"), "{}", status.message());
        assert!(status.message().contains("inc_"), "{}", status.message());
    }

    #[tokio::test]
    async fn a_panic_of_the_host_is_a_server_fault() {
        let failure =
            call_host::<_, (), _>("test", &Arc::new(()), |_| async { panic!("secret") }).await.unwrap_err();
        assert_eq!(failure.reason(), Reason::Internal);
        assert!(!failure.message().contains("secret"));
    }
}
