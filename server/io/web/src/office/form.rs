//! Forms that change something: they come from a page of this server, and from the session that the page was made for.

use super::SignedIn;
use crate::trouble::Trouble;
use axum::{
    body::to_bytes,
    extract::{FromRequest, FromRequestParts, Query, Request},
    http::{HeaderMap, Uri, header},
    response::{IntoResponse, Response},
};
use std::{collections::BTreeMap, ops::RangeInclusive};

/// Most bytes of a form: a reason of four bytes a letter, each written as three, and what else there is.
pub(crate) const MAX_FORM_BYTES: usize = 16 << 10;
/// Most characters of a reason.
const MAX_REASON_CHARS: usize = 500;
/// Most characters of a name.
const MAX_NAME_CHARS: usize = 64;

/// What somebody who is signed in sent by a form of a page of this session.
pub(crate) struct Form {
    pub(crate) by: SignedIn,
    pub(crate) fields: Fields,
}

/// What somebody sent to sign in. There is no session yet that could have a key.
pub(crate) struct SignInForm(pub(crate) Fields);

/// The fields of a form by name.
#[derive(Debug, Default)]
pub(crate) struct Fields(BTreeMap<String, String>);

impl<S: Send + Sync> FromRequest<S> for SignInForm {
    type Rejection = Trouble;

    async fn from_request(request: Request, _: &S) -> Result<Self, Trouble> {
        refuse_foreign(request.headers())?;
        Fields::read(request).await.map(Self)
    }
}

impl<S: Send + Sync> FromRequest<S> for Form {
    type Rejection = Response;

    async fn from_request(request: Request, state: &S) -> Result<Self, Response> {
        refuse_foreign(request.headers()).map_err(Trouble::into_response)?;
        let (mut parts, body) = request.into_parts();
        let by = SignedIn::from_request_parts(&mut parts, state).await?;
        let request = Request::from_parts(parts, body);
        let fields = Fields::read(request).await.map_err(Trouble::into_response)?;
        let key = fields.0.get("key").map_or("", String::as_str);
        if by.made(key) { Ok(Self { by, fields }) } else { Err(Trouble::Foreign.into_response()) }
    }
}

/// Refuses a form that another site sent. Browsers tell where a form comes from by `Sec-Fetch-Site`, or by `Origin` where the
/// connection is plain text; no page can change either.
fn refuse_foreign(headers: &HeaderMap) -> Result<(), Trouble> {
    let text = |name| headers.get(name).and_then(|value| value.to_str().ok());
    let is_own = match (text(header::HeaderName::from_static("sec-fetch-site")), text(header::ORIGIN)) {
        (Some(site), _) => site == "same-origin",
        (None, Some(origin)) => {
            let host = origin.split_once("://").map(|(_, host)| host);
            host.is_some() && host == text(header::HOST)
        }
        (None, None) => false,
    };
    if is_own { Ok(()) } else { Err(Trouble::Foreign) }
}

impl Fields {
    async fn read(request: Request) -> Result<Self, Trouble> {
        let body = to_bytes(request.into_body(), MAX_FORM_BYTES).await.map_err(|_| Trouble::Body)?;
        let wrong = || Trouble::Invalid("the form cannot be read".to_owned());
        // A form is written as a query is.
        let text = std::str::from_utf8(&body).map_err(|_| wrong())?;
        let uri = format!("/?{text}").parse::<Uri>().map_err(|_| wrong())?;
        let Query(pairs) = Query::<Vec<(String, String)>>::try_from_uri(&uri).map_err(|_| wrong())?;
        Ok(Self(pairs.into_iter().collect()))
    }

    /// A field, as it was sent.
    pub(crate) fn get(&self, name: &str) -> Result<&str, Trouble> {
        let missing = || Trouble::Invalid(format!("the form has no field '{name}'"));
        self.0.get(name).map(String::as_str).ok_or_else(missing)
    }

    /// A name, which may be empty.
    pub(crate) fn name(&self, name: &str) -> Result<String, Trouble> {
        printable(name, self.get(name)?, MAX_NAME_CHARS)
    }

    /// A reason; there is one.
    pub(crate) fn reason(&self) -> Result<String, Trouble> {
        match self.maybe_reason()? {
            reason if reason.is_empty() => Err(Trouble::Invalid("the reason is empty; say why".to_owned())),
            reason => Ok(reason),
        }
    }

    /// A reason, or nothing.
    pub(crate) fn maybe_reason(&self) -> Result<String, Trouble> {
        printable("reason", self.get("reason")?, MAX_REASON_CHARS)
    }

    /// A whole number of some.
    pub(crate) fn number(&self, name: &str, range: RangeInclusive<u32>) -> Result<u32, Trouble> {
        let value = self.get(name)?.trim();
        value.parse().ok().filter(|number| range.contains(number)).ok_or_else(|| {
            let (low, high) = (range.start(), range.end());
            Trouble::Invalid(format!("{name} is '{value}' and must be {low} to {high}"))
        })
    }

    /// The same, for what may be left empty.
    pub(crate) fn maybe_number(
        &self,
        name: &str,
        range: RangeInclusive<u32>,
    ) -> Result<Option<u32>, Trouble> {
        if self.get(name)?.trim().is_empty() { Ok(None) } else { self.number(name, range).map(Some) }
    }

    /// Refuses unless the field `typed` is `expected`, so that nobody does by mistake what cannot be taken back.
    pub(crate) fn confirm(&self, expected: &str) -> Result<(), Trouble> {
        let typed = self.get("typed")?.trim();
        if typed == expected {
            return Ok(());
        }
        Err(Trouble::Invalid(format!("'{typed}' was typed, and '{expected}' is to be; nothing was done")))
    }
}

fn printable(what: &str, text: &str, most_chars: usize) -> Result<String, Trouble> {
    let text = text.trim();
    if text.chars().count() <= most_chars && !text.chars().any(char::is_control) {
        return Ok(text.to_owned());
    }
    Err(Trouble::Invalid(format!("{what} takes at most {most_chars} printable characters on one line")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::{body::Body, http::HeaderValue};

    fn from(headers: &[(&'static str, &'static str)]) -> bool {
        let pairs = headers
            .iter()
            .map(|&(name, value)| (header::HeaderName::from_static(name), HeaderValue::from_static(value)));
        refuse_foreign(&pairs.collect()).is_ok()
    }

    #[test]
    fn forms_come_from_pages_of_this_server() {
        assert!(from(&[("sec-fetch-site", "same-origin"), ("origin", "null"), ("host", "a.example")]));
        assert!(from(&[("origin", "http://a.example:8080"), ("host", "a.example:8080")]));
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
            assert!(!from(foreign), "{foreign:?}");
        }
    }

    #[tokio::test]
    async fn fields_are_read_as_browsers_write_them() {
        let request = Request::new(Body::from("reason=the+roof+leaks%21&runs=+3&name=a%0Ab&days=&typed=x"));
        let fields = Fields::read(request).await.expect("a form");
        assert_eq!(fields.reason().expect("a reason"), "the roof leaks!");
        assert_eq!(fields.number("runs", 1..=9).expect("a number"), 3);
        assert_eq!(fields.maybe_number("days", 1..=9).expect("nothing"), None);
        fields.number("runs", 4..=9).expect_err("too few");
        fields.name("name").expect_err("two lines");
        fields.get("nothing").expect_err("no such field");
        fields.confirm("y").expect_err("another word");
        fields.confirm("x").expect("the word");
        let large = Request::new(Body::from("x".repeat(MAX_FORM_BYTES + 1)));
        assert_eq!(Fields::read(large).await.expect_err("too large"), Trouble::Body);
    }
}
