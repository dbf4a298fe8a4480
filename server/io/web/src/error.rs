//! Request errors, with messages for visitors and programs.
//!
//! A handler returns a [`RequestError`]. It travels as an extension in a response without a body; [`crate::middleware`] renders it as a
//! page or as problem details. Details about server faults go to the log, never to the client.

use crate::management::ActionError;
use avln_store::StoreError;
use axum::{
    http::{StatusCode, header},
    response::{IntoResponse, Response},
};

/// Cause of a failed request.
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
    #[error("too many failed attempts to sign in; try again in a minute")]
    Attempts,
    #[error(
        "the form came from another site or from a page of an older session, and nothing was changed; open the page again and send the form from there"
    )]
    Foreign,
    #[error("{0}; nothing was changed")]
    Refused(String),
    #[error("too many visitors are waiting for pictures or sound; try again in a few seconds")]
    Crowded,
    #[error(
        "{limit} visitors are following runs, which is the limit; load the page again to see the progress, or come back later"
    )]
    Followed { limit: usize },
    #[error("the server is busy; try again in a few seconds")]
    Busy,
    #[error("internal error; the organiser can find the cause in the server's log")]
    Internal,
}

impl RequestError {
    /// Returns the error for a response that has only a status.
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

    pub(crate) fn status(&self) -> StatusCode {
        match self {
            Self::Unknown { .. } | Self::NoPage => StatusCode::NOT_FOUND,
            Self::Invalid(_) => StatusCode::BAD_REQUEST,
            Self::BadToken => StatusCode::UNAUTHORIZED,
            Self::TooLong { .. } => StatusCode::URI_TOO_LONG,
            Self::Method => StatusCode::METHOD_NOT_ALLOWED,
            Self::Body => StatusCode::PAYLOAD_TOO_LARGE,
            Self::WrongToken | Self::Foreign => StatusCode::FORBIDDEN,
            Self::Refused(_) => StatusCode::CONFLICT,
            Self::Crowded | Self::Followed { .. } | Self::Attempts => StatusCode::TOO_MANY_REQUESTS,
            Self::Busy => StatusCode::SERVICE_UNAVAILABLE,
            Self::Internal => StatusCode::INTERNAL_SERVER_ERROR,
        }
    }

    /// Returns the code for programs, named as in gRPC.
    pub(crate) fn reason(&self) -> &'static str {
        match self {
            Self::Unknown { .. } | Self::NoPage => "NOT_FOUND",
            Self::Invalid(_) | Self::TooLong { .. } | Self::Body => "INVALID_ARGUMENT",
            Self::BadToken => "UNAUTHENTICATED",
            Self::Method => "METHOD_NOT_ALLOWED",
            Self::WrongToken | Self::Foreign => "PERMISSION_DENIED",
            Self::Refused(_) => "FAILED_PRECONDITION",
            Self::Crowded | Self::Followed { .. } | Self::Attempts => "RESOURCE_EXHAUSTED",
            Self::Busy => "UNAVAILABLE",
            Self::Internal => "INTERNAL",
        }
    }

    /// Returns the page heading.
    pub(crate) fn title(&self) -> &'static str {
        match self {
            Self::Unknown { .. } | Self::NoPage => "Not found",
            Self::Invalid(_) => "Invalid request",
            Self::BadToken => "Token not accepted",
            Self::TooLong { .. } => "Address too long",
            Self::Method => "Read only",
            Self::Body => "Request too large",
            Self::WrongToken => "Not signed in",
            Self::Attempts => "Too many attempts",
            Self::Foreign => "Form not accepted",
            Self::Refused(_) => "Refused",
            Self::Crowded | Self::Followed { .. } => "Too many visitors",
            Self::Busy => "Busy",
            Self::Internal => "Internal error",
        }
    }
}

impl IntoResponse for RequestError {
    fn into_response(self) -> Response {
        let mut response = self.status().into_response();
        let extra = match self {
            Self::BadToken => Some((header::WWW_AUTHENTICATE, "Bearer")),
            Self::Busy | Self::Crowded | Self::Followed { .. } => Some((header::RETRY_AFTER, "5")),
            Self::Attempts => Some((header::RETRY_AFTER, "60")),
            _ => None,
        };
        if let Some((name, value)) = extra {
            response.headers_mut().insert(name, header::HeaderValue::from_static(value));
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
