//! Management forms, protected against requests from other sites.

use super::{ManagementState, SignedIn};
use crate::error::{RequestError, Result};
use avln_challenge::names::is_visible_text;
use axum::{
    body::to_bytes,
    extract::{FromRequest, FromRequestParts, Request},
    http::{HeaderMap, header},
    response::{IntoResponse, Response},
};
use std::{collections::BTreeMap, ops::RangeInclusive, sync::Arc};

// Form size limit, bytes: a reason in four-byte characters, percent-encoded at three characters per byte, plus the other fields.
pub(crate) const MAX_FORM_BYTES: usize = 16 << 10;
const MAX_REASON_CHARS: usize = 500;
const MAX_NAME_CHARS: usize = 64;

/// A signed-in visitor's form, sent from a page in the same session.
pub(crate) struct SignedForm {
    pub(crate) by: SignedIn,
    pub(crate) fields: FormFields,
}

/// The sign-in form. There is no session yet, so it has no form key.
pub(crate) struct SignInForm(pub(crate) FormFields);

#[derive(Debug, Default)]
pub(crate) struct FormFields(BTreeMap<String, String>);

impl<S: Send + Sync> FromRequest<S> for SignInForm {
    type Rejection = RequestError;

    async fn from_request(request: Request, _: &S) -> Result<Self> {
        reject_other_sites(request.headers(), canonical_origin(&request))?;
        FormFields::read(request).await.map(Self)
    }
}

impl<S: Send + Sync> FromRequest<S> for SignedForm {
    type Rejection = Response;

    async fn from_request(request: Request, state: &S) -> Result<Self, Response> {
        let checked = reject_other_sites(request.headers(), canonical_origin(&request));
        checked.map_err(RequestError::into_response)?;
        let (mut parts, body) = request.into_parts();
        let by = SignedIn::from_request_parts(&mut parts, state).await?;
        let request = Request::from_parts(parts, body);
        let fields = FormFields::read(request).await.map_err(RequestError::into_response)?;
        let key = fields.0.get("key").map_or("", String::as_str);
        if by.accepts_form_key(key) {
            Ok(Self { by, fields })
        } else {
            Err(RequestError::Foreign.into_response())
        }
    }
}

fn canonical_origin(request: &Request) -> Option<&str> {
    request.extensions().get::<Arc<ManagementState>>()?.origin.as_deref()
}

// Rejects a form from another site. Browsers send a form's origin in `Sec-Fetch-Site`, or in `Origin` without TLS; pages
// cannot change either header.
fn reject_other_sites(headers: &HeaderMap, canonical: Option<&str>) -> Result<()> {
    let text = |name| headers.get(name).and_then(|value| value.to_str().ok());
    let is_own = match (text(header::HeaderName::from_static("sec-fetch-site")), text(header::ORIGIN)) {
        (Some(site), _) => site == "same-origin",
        (None, Some(origin)) => match canonical {
            Some(canonical) => origin == canonical,
            None => {
                let host = origin.split_once("://").map(|(_, host)| host);
                host.is_some() && host == text(header::HOST)
            }
        },
        (None, None) => false,
    };
    if is_own { Ok(()) } else { Err(RequestError::Foreign) }
}

impl FormFields {
    async fn read(request: Request) -> Result<Self> {
        let body = to_bytes(request.into_body(), MAX_FORM_BYTES).await.map_err(|_| RequestError::Body)?;
        let pairs: Vec<(String, String)> = serde_urlencoded::from_bytes(&body)
            .map_err(|error| RequestError::Invalid(format!("cannot read the form: {error}")))?;
        Ok(Self(pairs.into_iter().collect()))
    }

    pub(crate) fn get(&self, name: &str) -> Result<&str> {
        let missing = || RequestError::Invalid(format!("the form has no field '{name}'"));
        self.0.get(name).map(String::as_str).ok_or_else(missing)
    }

    pub(crate) fn name(&self, name: &str) -> Result<String> {
        printable(name, self.get(name)?, MAX_NAME_CHARS)
    }

    pub(crate) fn reason(&self) -> Result<String> {
        let reason = self.maybe_reason()?;
        if reason.is_empty() {
            return Err(RequestError::Invalid("the reason is empty; please enter one".to_owned()));
        }
        Ok(reason)
    }

    pub(crate) fn maybe_reason(&self) -> Result<String> {
        printable("reason", self.get("reason")?, MAX_REASON_CHARS)
    }

    pub(crate) fn number(&self, name: &str, range: RangeInclusive<u32>) -> Result<u32> {
        let value = self.get(name)?.trim();
        value.parse().ok().filter(|number| range.contains(number)).ok_or_else(|| {
            let (low, high) = (range.start(), range.end());
            RequestError::Invalid(format!("{name} is '{value}', but must be {low} to {high}"))
        })
    }

    /// Returns a whole number within `range`, or `None` for an empty field.
    pub(crate) fn maybe_number(&self, name: &str, range: RangeInclusive<u32>) -> Result<Option<u32>> {
        if self.get(name)?.trim().is_empty() { Ok(None) } else { self.number(name, range).map(Some) }
    }

    /// Rejects the form unless the visitor typed `expected`, as a safeguard for irreversible actions.
    pub(crate) fn confirm(&self, expected: &str) -> Result<()> {
        let typed = self.get("typed")?.trim();
        if typed == expected {
            return Ok(());
        }
        Err(RequestError::Invalid(format!("expected '{expected}', but got '{typed}'; nothing was changed")))
    }
}

fn printable(what: &str, text: &str, max_chars: usize) -> Result<String> {
    let text = text.trim();
    if is_visible_text(text, &(0..=max_chars)) {
        return Ok(text.to_owned());
    }
    let message = format!("{what} must be a single line of at most {max_chars} printable characters");
    Err(RequestError::Invalid(message))
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::{body::Body, http::HeaderValue};

    fn from(headers: &[(&'static str, &'static str)], canonical: Option<&str>) -> bool {
        let pairs = headers
            .iter()
            .map(|&(name, value)| (header::HeaderName::from_static(name), HeaderValue::from_static(value)));
        reject_other_sites(&pairs.collect(), canonical).is_ok()
    }

    #[test]
    fn forms_of_other_sites_are_rejected() {
        assert!(from(&[("sec-fetch-site", "same-origin"), ("origin", "null"), ("host", "a.example")], None));
        assert!(from(&[("origin", "http://a.example:8080"), ("host", "a.example:8080")], None));
        for foreign in [
            &[][..],
            &[("host", "a.example")],
            &[("origin", "null"), ("host", "a.example")],
            &[("origin", "https://b.example"), ("host", "a.example")],
            &[("origin", "http://a.example:8081"), ("host", "a.example:8080")],
            &[("origin", "http://a.example"), ("host", "a.example"), ("sec-fetch-site", "same-site")],
            &[("origin", "http://a.example"), ("host", "a.example"), ("sec-fetch-site", "cross-site")],
            &[("sec-fetch-site", "none"), ("host", "a.example")],
        ] {
            assert!(!from(foreign, None), "{foreign:?}");
        }
    }

    #[test]
    fn canonical_origin_replaces_the_host_header() {
        let canonical = Some("https://a.example");
        assert!(from(&[("origin", "https://a.example"), ("host", "127.0.0.1:8080")], canonical));
        assert!(from(&[("sec-fetch-site", "same-origin"), ("host", "127.0.0.1:8080")], canonical));
        for foreign in ["https://evil.example", "http://a.example", "https://a.example:8443", "null"] {
            assert!(!from(&[("origin", foreign), ("host", "evil.example")], canonical), "{foreign}");
        }
    }

    #[tokio::test]
    async fn fields_are_decoded_and_checked() {
        let request = Request::new(Body::from("reason=the+roof+leaks%21&runs=+3&name=a%0Ab&days=&typed=x"));
        let fields = FormFields::read(request).await.expect("a form");
        assert_eq!(fields.reason().expect("a reason"), "the roof leaks!");
        assert_eq!(fields.number("runs", 1..=9).expect("a number"), 3);
        assert_eq!(fields.maybe_number("days", 1..=9).expect("an empty field"), None);
        fields.number("runs", 4..=9).expect_err("too few");
        fields.name("name").expect_err("two lines");
        fields.get("an empty field").expect_err("no such field");
        fields.confirm("y").expect_err("another word");
        fields.confirm("x").expect("the word");
        let large = Request::new(Body::from("x".repeat(MAX_FORM_BYTES + 1)));
        assert_eq!(FormFields::read(large).await.expect_err("too large"), RequestError::Body);
    }
}
