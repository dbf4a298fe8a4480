//! What goes wrong, in the words that a visitor may read.

use crate::office::Undone;
use avln_store::StoreError;
use axum::{
    http::{StatusCode, header},
    response::{IntoResponse, Response},
};

/// Why a visitor gets no answer. It travels as an extension of the response; [`crate::guard`] gives it a body.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum Trouble {
    #[error("there is no {what} '{name}' that you may see")]
    Unknown { what: &'static str, name: String },
    #[error("there is nothing at this address")]
    NoPage,
    #[error("{0}")]
    Invalid(String),
    #[error(
        "the token is not valid or has expired; leave it out to look as anybody, or ask the organiser for a new one"
    )]
    BadToken,
    #[error("the address is longer than {limit} bytes")]
    TooLong { limit: usize },
    #[error("this address answers GET and HEAD only")]
    Method,
    #[error("the request has a body, which nothing here reads")]
    Body,
    #[error(
        "the token opens no page: it is unknown, has expired, was taken back or plays a run; use the token of a team or an organiser"
    )]
    WrongToken,
    #[error("too many attempts to sign in failed; try again in a minute")]
    Attempts,
    #[error(
        "the form was sent by another site, or its page is older than the session; nothing was done: open the page again and send it from there"
    )]
    Foreign,
    #[error("{0}; nothing was done")]
    Refused(String),
    #[error("too many visitors wait for pictures or sound already; try again in a few seconds")]
    Crowded,
    #[error(
        "{limit} visitors follow runs already, which is as many as may; load the page again to see how far a run is, or come back later"
    )]
    Followed { limit: usize },
    #[error("the server is busy; try again in a few seconds")]
    Busy,
    #[error("the server failed at this; the organiser finds the cause in its log")]
    Internal,
}

impl Trouble {
    /// The trouble that a bare status stands for.
    pub(crate) fn of_status(status: StatusCode) -> Self {
        match status {
            StatusCode::NOT_FOUND => Self::NoPage,
            StatusCode::METHOD_NOT_ALLOWED => Self::Method,
            StatusCode::PAYLOAD_TOO_LARGE => Self::Body,
            StatusCode::REQUEST_TIMEOUT | StatusCode::SERVICE_UNAVAILABLE => Self::Busy,
            status if status.is_server_error() => Self::Internal,
            _ => Self::Invalid("the address cannot be understood".to_owned()),
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

    /// A word for programs.
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

    /// A heading.
    pub(crate) fn title(&self) -> &'static str {
        match self {
            Self::Unknown { .. } | Self::NoPage => "Not found",
            Self::Invalid(_) => "Not understood",
            Self::BadToken => "Token not accepted",
            Self::TooLong { .. } => "Address too long",
            Self::Method => "Only for reading",
            Self::Body => "Too much sent",
            Self::WrongToken => "Not signed in",
            Self::Attempts => "Wait a minute",
            Self::Foreign => "Form not accepted",
            Self::Refused(_) => "Not done",
            Self::Crowded | Self::Followed { .. } => "Crowded",
            Self::Busy => "Busy",
            Self::Internal => "Something broke",
        }
    }
}

impl IntoResponse for Trouble {
    fn into_response(self) -> Response {
        let mut response = self.status().into_response();
        let headers = response.headers_mut();
        match self {
            Self::BadToken => {
                headers.insert(header::WWW_AUTHENTICATE, header::HeaderValue::from_static("Bearer"));
            }
            Self::Busy | Self::Crowded | Self::Followed { .. } => {
                headers.insert(header::RETRY_AFTER, header::HeaderValue::from_static("5"));
            }
            Self::Attempts => {
                headers.insert(header::RETRY_AFTER, header::HeaderValue::from_static("60"));
            }
            _ => {}
        }
        response.extensions_mut().insert(self);
        response
    }
}

impl From<StoreError> for Trouble {
    fn from(error: StoreError) -> Self {
        tracing::error!(%error, "the store failed");
        Self::Internal
    }
}

impl From<Undone> for Trouble {
    fn from(undone: Undone) -> Self {
        match undone {
            Undone::Refused(words) => Self::Refused(words),
            Undone::Failed(error) => {
                tracing::error!(error, "a deed was not done");
                Self::Internal
            }
        }
    }
}

impl From<askama::Error> for Trouble {
    fn from(error: askama::Error) -> Self {
        tracing::error!(%error, "a page could not be written");
        Self::Internal
    }
}

impl From<serde_json::Error> for Trouble {
    fn from(error: serde_json::Error) -> Self {
        tracing::error!(%error, "an answer could not be written");
        Self::Internal
    }
}
