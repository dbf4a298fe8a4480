//! Request errors, with messages for visitors and programs, and request ids: in log lines, in the response header `x-request-id`
//! and in error bodies.
//!
//! A handler returns a [`RequestError`]. It travels as an extension in a response without a body; [`crate::middleware`] renders it as a
//! page or as problem details. Details about server faults go to the log, never to the client.

use avln_store::StoreError;
use axum::{
    extract::Request,
    http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header},
    middleware::Next,
    response::{IntoResponse, Response},
};
use serde::Serialize;
use std::{
    fmt,
    hash::{BuildHasher, Hasher, RandomState},
    ops::RangeInclusive,
};
use utoipa::ToSchema;

pub(crate) type Result<T, E = RequestError> = std::result::Result<T, E>;

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum RequestError {
    #[error("there is no {what} '{name}' that you may see")]
    Unknown { what: &'static str, name: String },
    #[error("there is no page at this address")]
    NoPage,
    #[error("{0}")]
    Invalid(String),
    #[error(
        "the token is invalid or has expired; leave it out to see public pages, or ask the organiser for a new one"
    )]
    BadToken,
    #[error("the address is longer than {limit} bytes")]
    TooLong { limit: usize },
    #[error("this address supports GET and HEAD only")]
    Method,
    #[error("the body of the request is too large")]
    Body,
    #[error(
        "this token cannot be used to sign in: it is unknown, expired, revoked, or the token of a run; use a token of a team or an organiser"
    )]
    WrongToken,
    #[error("too many failed attempts to sign in; wait a minute before the next one")]
    Attempts,
    #[error(
        "the form came from another site or from a page of an older session, and nothing was changed; reload the page and send the form from there"
    )]
    Foreign,
    #[error("{0}; nothing was changed")]
    Refused(String),
    #[error("too many visitors are waiting for pictures or sound; wait a few seconds")]
    Crowded,
    #[error(
        "{limit} visitors are following runs, which is the limit; reload the page to see the progress, or come back later"
    )]
    Followed { limit: usize },
    #[error("the server is busy; try again in a few seconds")]
    Busy,
    #[error("internal error; the organiser can find the cause in the server's log")]
    Internal,
}

/// An error for programs: problem details by RFC 9457.
#[derive(Serialize, ToSchema)]
pub(crate) struct Problem {
    r#type: &'static str,
    title: &'static str,
    status: u16,
    detail: String,
    instance: String,
    reason: &'static str,
    request_id: String,
}

/// An error's status, code for programs (as in gRPC) and page heading.
pub(crate) struct ErrorClass {
    pub(crate) status: StatusCode,
    pub(crate) reason: &'static str,
    pub(crate) title: &'static str,
}

impl RequestError {
    pub(crate) fn unknown(what: &'static str, name: impl Into<String>) -> Self {
        Self::Unknown { what, name: name.into() }
    }

    pub(crate) fn of_status(status: StatusCode) -> Self {
        match status {
            StatusCode::NOT_FOUND => Self::NoPage,
            StatusCode::METHOD_NOT_ALLOWED => Self::Method,
            StatusCode::PAYLOAD_TOO_LARGE => Self::Body,
            StatusCode::REQUEST_TIMEOUT | StatusCode::SERVICE_UNAVAILABLE => Self::Busy,
            status if status.is_server_error() => Self::Internal,
            _ => Self::Invalid("the request is invalid".to_owned()),
        }
    }

    pub(crate) fn class(&self) -> ErrorClass {
        let class = |status, reason, title| ErrorClass { status, reason, title };
        match self {
            Self::Unknown { .. } | Self::NoPage => class(StatusCode::NOT_FOUND, "NOT_FOUND", "Not found"),
            Self::Invalid(_) => class(StatusCode::BAD_REQUEST, "INVALID_ARGUMENT", "Invalid request"),
            Self::TooLong { .. } => class(StatusCode::URI_TOO_LONG, "INVALID_ARGUMENT", "Address too long"),
            Self::Body => class(StatusCode::PAYLOAD_TOO_LARGE, "INVALID_ARGUMENT", "Request too large"),
            Self::BadToken => class(StatusCode::UNAUTHORIZED, "UNAUTHENTICATED", "Token not accepted"),
            Self::Method => class(StatusCode::METHOD_NOT_ALLOWED, "METHOD_NOT_ALLOWED", "Read only"),
            Self::WrongToken => class(StatusCode::FORBIDDEN, "PERMISSION_DENIED", "Not signed in"),
            Self::Foreign => class(StatusCode::FORBIDDEN, "PERMISSION_DENIED", "Form not accepted"),
            Self::Refused(_) => class(StatusCode::CONFLICT, "FAILED_PRECONDITION", "Refused"),
            Self::Attempts => class(StatusCode::TOO_MANY_REQUESTS, "RESOURCE_EXHAUSTED", "Too many attempts"),
            Self::Crowded | Self::Followed { .. } => {
                class(StatusCode::TOO_MANY_REQUESTS, "RESOURCE_EXHAUSTED", "Too many visitors")
            }
            Self::Busy => class(StatusCode::SERVICE_UNAVAILABLE, "UNAVAILABLE", "Busy"),
            Self::Internal => class(StatusCode::INTERNAL_SERVER_ERROR, "INTERNAL", "Internal error"),
        }
    }

    pub(crate) fn problem(&self, path: &str, request_id: &str) -> Problem {
        let ErrorClass { status, reason, title } = self.class();
        Problem {
            r#type: "about:blank",
            title,
            status: status.as_u16(),
            detail: self.to_string(),
            instance: path.to_owned(),
            reason,
            request_id: request_id.to_owned(),
        }
    }
}

impl IntoResponse for RequestError {
    fn into_response(self) -> Response {
        let mut response = self.class().status.into_response();
        let extra = match self {
            Self::BadToken => Some((header::WWW_AUTHENTICATE, "Bearer")),
            Self::Busy | Self::Crowded | Self::Followed { .. } => Some((header::RETRY_AFTER, "5")),
            Self::Attempts => Some((header::RETRY_AFTER, "60")),
            _ => None,
        };
        if let Some((name, value)) = extra {
            response.headers_mut().insert(name, HeaderValue::from_static(value));
        }
        response.extensions_mut().insert(self);
        response
    }
}

impl From<StoreError> for RequestError {
    fn from(error: StoreError) -> Self {
        tracing::error!(%error, "cannot read the database");
        Self::Internal
    }
}

/// Cause of a failed action.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ActionError {
    /// The action is not possible; the message is for the visitor.
    #[error("{0}")]
    Refused(String),
    /// The server failed; the message is for the log.
    #[error("{0}")]
    Failed(String),
}

impl From<ActionError> for RequestError {
    fn from(error: ActionError) -> Self {
        match error {
            ActionError::Refused(message) => Self::Refused(message),
            ActionError::Failed(error) => {
                tracing::error!(error, "a management action failed");
                Self::Internal
            }
        }
    }
}

impl From<askama::Error> for RequestError {
    fn from(error: askama::Error) -> Self {
        tracing::error!(%error, "cannot render a page");
        Self::Internal
    }
}

impl From<serde_json::Error> for RequestError {
    fn from(error: serde_json::Error) -> Self {
        tracing::error!(%error, "cannot write a JSON response");
        Self::Internal
    }
}

/// Header of requests and responses.
const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

/// Accepted lengths of an id from outside.
const LENGTHS: RangeInclusive<usize> = 8..=64;

/// Id of a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct RequestId(HeaderValue);

impl RequestId {
    /// Returns the id of a proxy in front of this server if it is well-formed, otherwise a random one.
    fn of(headers: &HeaderMap) -> Self {
        let sent = headers.get(&REQUEST_ID).filter(|value| is_well_formed(value.as_bytes()));
        sent.cloned().map_or_else(Self::random, Self)
    }

    fn random() -> Self {
        // The keys of a new state differ from all others; an id needs no secrecy.
        let random = RandomState::new().build_hasher().finish() >> 16;
        let id = HeaderValue::from_str(&format!("req_{random:012x}"));
        Self(id.unwrap_or(HeaderValue::from_static("req_")))
    }
}

impl fmt::Display for RequestId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.0.to_str().unwrap_or_default())
    }
}

/// Allows nothing that could look like another part of a log line or a page.
fn is_well_formed(id: &[u8]) -> bool {
    LENGTHS.contains(&id.len()) && id.iter().all(|byte| byte.is_ascii_alphanumeric() || b"-_".contains(byte))
}

/// Adds an id to the request, for all inner layers, and to the response.
pub(crate) async fn add_request_id(mut request: Request, next: Next) -> Response {
    let id = RequestId::of(request.headers());
    request.extensions_mut().insert(id.clone());
    let mut response = next.run(request).await;
    response.headers_mut().insert(REQUEST_ID, id.0);
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    fn id_for(sent: &'static str) -> RequestId {
        RequestId::of(&HeaderMap::from_iter([(REQUEST_ID, HeaderValue::from_static(sent))]))
    }

    #[test]
    fn well_formed_ids_are_kept() {
        for sent in ["req_0123456789ab", "7d1f3c2a-0b7e-4f6e-9a55-0c1d2e3f4a5b"] {
            assert_eq!(id_for(sent).to_string(), sent);
        }
    }

    #[test]
    fn malformed_ids_are_replaced() {
        let long = "x".repeat(65);
        for sent in ["", "short", "<script>alert", "a=1 level=ERROR", long.leak()] {
            let id = id_for(sent).to_string();
            assert!(id.starts_with("req_") && id.len() == 16, "{sent}: {id}");
        }
    }

    #[test]
    fn ids_differ() {
        assert_ne!(RequestId::random(), RequestId::random());
    }
}
