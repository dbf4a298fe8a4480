//! Errors of the client, and the reason behind a status of the server.

use avln_proto::{REASON_KEY, RETRY_AFTER_KEY, v1};
use std::{error::Error as StdError, fmt::Write};
use tonic::{Code, Status};
use v1::Reason;

/// Errors between agent and server. Every message contains the attempted operation and the next step.
#[derive(Clone, Debug, thiserror::Error)]
pub enum Error {
    /// Invalid server address.
    #[error("server address '{address}': {problem}; write it like http://127.0.0.1:50051")]
    Address {
        /// Given address.
        address: String,
        /// Problem.
        problem: String,
    },
    /// No answer at the server address.
    #[error(
        "cannot reach {address}: {detail}; is the server running there, and is this its gRPC port? \
         Set the address with --server"
    )]
    Unreachable {
        /// Given address.
        address: String,
        /// Network error.
        detail: String,
    },
    /// No secure connection to the server.
    #[error("{address}: {problem}")]
    Tls {
        /// Given address.
        address: String,
        /// Problem and next step.
        problem: String,
    },
    /// No Arena server at the address.
    #[error(
        "{address} is not an LH-AVLN Arena gRPC server ({detail}); \
         use the gRPC port instead of the web port, and https:// for a server with TLS"
    )]
    NotArena {
        /// Given address.
        address: String,
        /// Answer.
        detail: String,
    },
    /// The server refused the token.
    #[error("{attempted}: the server refused the token ({word}): {message}{}", token_hint(*reason), word = reason.word())]
    Token {
        /// Attempted operation.
        attempted: &'static str,
        /// Reason code.
        reason: Reason,
        /// Server message.
        message: String,
    },
    /// The server refused a request.
    #[error("{attempted}: refused ({word}): {message}{}", retry_hint(*retry_after_s), word = reason.word())]
    Refused {
        /// Attempted operation.
        attempted: &'static str,
        /// Reason code.
        reason: Reason,
        /// Server message.
        message: String,
        /// Delay before a retry, seconds.
        retry_after_s: Option<u32>,
    },
    /// The connection is lost: stored results remain, open episodes end as disconnected.
    #[error(
        "{attempted}: the connection to the server was lost ({detail}); stored episodes are safe; play the run again for the others"
    )]
    Lost {
        /// Attempted operation.
        attempted: &'static str,
        /// Known details.
        detail: String,
    },
    /// The server violated `avln.v1`.
    #[error("the server violated the protocol: {detail}; client {version} may be incompatible with the server", version = env!("CARGO_PKG_VERSION"))]
    Protocol {
        /// Message.
        detail: String,
    },
    /// The requested sensors are out of range for any server.
    #[error(
        "invalid camera of {width} x {height} pixels with hfov {hfov_rad} rad; use 64 to 1024 pixels and 0.35 to 2.4 rad"
    )]
    Sensors {
        /// Requested pixels in a row.
        width: u32,
        /// Requested rows.
        height: u32,
        /// Requested view angle, radians.
        hfov_rad: f32,
    },
    /// No phase was given, and there is no or no unique default phase.
    #[error("start a run without naming a phase: {}; choose a phase with --phase", what_phases(.free, .known))]
    Phase {
        /// Open phases with uncounted runs.
        free: Vec<String>,
        /// All phases visible to the team.
        known: Vec<String>,
    },
    /// A step after the end of the episode.
    #[error("the episode is over; call Play::next_episode for the next")]
    EpisodeOver,
}

impl Error {
    /// Returns the server's reason, if any.
    pub fn reason(&self) -> Option<Reason> {
        match self {
            Self::Token { reason, .. } | Self::Refused { reason, .. } => Some(*reason),
            _ => None,
        }
    }

    /// Returns the server's requested delay before a retry, seconds.
    pub(crate) fn retry_after_s(&self) -> Option<u32> {
        match self {
            Self::Refused { retry_after_s, .. } => *retry_after_s,
            _ => None,
        }
    }

    pub(crate) fn protocol(detail: impl Into<String>) -> Self {
        Self::Protocol { detail: detail.into() }
    }

    pub(crate) fn from_status(attempted: &'static str, status: &Status) -> Self {
        let word = metadata(status, REASON_KEY);
        let reason = word.and_then(Reason::from_word).unwrap_or(Reason::Unspecified);
        let retry_after_s = metadata(status, RETRY_AFTER_KEY).and_then(|text| text.parse().ok());
        let lost = matches!(
            status.code(),
            Code::Unavailable | Code::Cancelled | Code::Unknown | Code::DeadlineExceeded
        );
        // An error with a source was detected locally, for example a stream reset by a proxy.
        let lost = lost || status.source().is_some();
        // With a reason the server itself answered, even with one of these codes.
        if reason == Reason::Unspecified && lost {
            return Self::Lost { attempted, detail: chain(status) };
        }
        Self::refused(attempted, status.code(), reason, status.message(), retry_after_s)
    }

    /// Returns true for temporary errors.
    pub(crate) fn is_passing(&self) -> bool {
        match self {
            Self::Lost { .. } | Self::Unreachable { .. } => true,
            Self::Refused { reason, .. } => {
                matches!(reason, Reason::Draining | Reason::NoCapacity | Reason::RateLimit)
            }
            _ => false,
        }
    }

    /// Replaces the attempted operation.
    pub(crate) fn while_attempting(mut self, now: &'static str) -> Self {
        if let Self::Lost { attempted, .. }
        | Self::Refused { attempted, .. }
        | Self::Token { attempted, .. } = &mut self
        {
            *attempted = now;
        }
        self
    }

    pub(crate) fn from_fault(attempted: &'static str, fault: &v1::Fault) -> Self {
        let code = Code::from(i32::try_from(fault.code).unwrap_or(i32::MAX));
        let message = match fault.id.as_str() {
            "" => fault.message.clone(),
            id => format!("{} (server log {id})", fault.message),
        };
        Self::refused(attempted, code, fault.reason(), &message, fault.retry_after_s)
    }

    pub(crate) fn refused(
        attempted: &'static str,
        code: Code,
        reason: Reason,
        message: &str,
        retry_after_s: Option<u32>,
    ) -> Self {
        let message = if message.is_empty() { code.description().to_owned() } else { message.to_owned() };
        let about_token = code == Code::Unauthenticated || reason == Reason::TokenScope;
        if about_token {
            Self::Token { attempted, reason, message }
        } else {
            Self::Refused { attempted, reason, message, retry_after_s }
        }
    }
}

/// Returns all distinct sources of an error, outermost first.
pub(crate) fn chain(error: &dyn StdError) -> String {
    let mut text = String::new();
    let mut next = Some(error);
    while let Some(error) = next {
        let part = error.to_string();
        // tonic repeats the text of inner errors.
        if !text.contains(&part) {
            let colon = if text.is_empty() { "" } else { ": " };
            let _ = write!(text, "{colon}{part}");
        }
        next = error.source();
    }
    text
}

fn metadata<'a>(status: &'a Status, key: &str) -> Option<&'a str> {
    status.metadata().get(key)?.to_str().ok()
}

fn token_hint(reason: Reason) -> &'static str {
    match reason {
        Reason::TokenExpired | Reason::TokenRevoked => {
            "; ask the organiser for a new one and use it with --token or AVLN_TOKEN"
        }
        Reason::TokenScope => "; account tokens start runs, run tokens play them",
        _ => "; use the account's token with --token or AVLN_TOKEN",
    }
}

fn what_phases(free: &[String], known: &[String]) -> String {
    match (free, known) {
        ([], []) => "the server has no phase for your team".to_owned(),
        ([], known) => {
            format!("no open phase is without a quota; known phases: {}", known.join(", "))
        }
        (free, _) => format!("several phases have no quota: {}", free.join(", ")),
    }
}

fn retry_hint(retry_after_s: Option<u32>) -> String {
    retry_after_s.map(|s| format!("; try again in {s} s")).unwrap_or_default()
}

/// Returns the error for a pending call at the end of the stream.
pub(crate) fn closed(attempted: &'static str, end: Option<Error>) -> Error {
    match end {
        Some(error) => error.while_attempting(attempted),
        None => Error::Lost { attempted, detail: "the server ended the stream without a reason".to_owned() },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tonic::metadata::MetadataMap;

    fn status(code: Code, reason: &str, retry: Option<&str>) -> Status {
        let mut map = MetadataMap::new();
        map.insert(REASON_KEY, reason.parse().unwrap());
        if let Some(seconds) = retry {
            map.insert(RETRY_AFTER_KEY, seconds.parse().unwrap());
        }
        Status::with_metadata(code, "no", map)
    }

    #[test]
    fn a_bad_token_names_the_flag() {
        let error =
            Error::from_status("start a run", &status(Code::Unauthenticated, "TOKEN_MALFORMED", None));
        assert!(matches!(error, Error::Token { reason: Reason::TokenMalformed, .. }));
        let text = error.to_string();
        assert!(
            text.contains("--token") && text.contains("AVLN_TOKEN") && text.contains("TOKEN_MALFORMED"),
            "{text}"
        );
    }

    #[test]
    fn full_server_sends_retry_delay() {
        let error =
            Error::from_status("start a run", &status(Code::ResourceExhausted, "NO_CAPACITY", Some("7")));
        assert_eq!(error.reason(), Some(Reason::NoCapacity));
        assert!(error.to_string().ends_with("try again in 7 s"), "{error}");
    }

    #[test]
    fn draining_server_refuses_and_silent_server_is_lost() {
        let draining = Error::from_status("play", &status(Code::Unavailable, "DRAINING", Some("60")));
        assert_eq!(draining.reason(), Some(Reason::Draining));
        assert!(matches!(Error::from_status("play", &Status::unavailable("gone")), Error::Lost { .. }));
    }

    #[test]
    fn proxy_reset_is_lost_connection() {
        let mut reset = Status::internal("h2 protocol error");
        assert!(matches!(Error::from_status("play", &reset), Error::Refused { .. }));
        reset.set_source(std::sync::Arc::new(std::io::Error::other("stream error: INTERNAL_ERROR")));
        assert!(matches!(Error::from_status("play", &reset), Error::Lost { .. }));
    }

    #[test]
    fn newer_reason_keeps_its_text() {
        let error = Error::from_status("play", &status(Code::PermissionDenied, "MOON_PHASE", None));
        assert!(
            matches!(&error, Error::Refused { reason: Reason::Unspecified, message, .. } if message == "no")
        );
    }
}
