//! Management by teams (own tokens and runs) and organisers. The arena implements [`Management`]; permissions are decided here.
//! Forms are protected against requests from other sites.

mod sessions;

pub(crate) use sessions::{
    Sessions, SignedIn, has_session_cookie, identify, is_management_page, session_cookie,
};

use crate::{
    error::{ActionError, RequestError, Result},
    server::ClientAddress,
};
use avln_challenge::names::is_visible_text;
use axum::{
    body::to_bytes,
    extract::{FromRequest, FromRequestParts, Request},
    http::{HeaderMap, header},
    response::{IntoResponse, Response},
};
use std::{
    collections::BTreeMap,
    fmt,
    ops::RangeInclusive,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

/// The team token behind an action.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TeamCredential {
    /// Team name.
    pub team: String,
    /// Public token id.
    pub token: String,
    /// Token expiry time, milliseconds since 1970-01-01 UTC; `None` if it never expires.
    pub expires_unix_ms: Option<i64>,
}

/// A team's action.
#[expect(missing_docs, reason = "the documentation of a variant explains the fields")]
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TeamAction {
    /// Creates a token, which expires no later than the token used to sign in.
    IssueToken {
        /// Token name; may be empty.
        name: String,
        /// True if the token only grants read access.
        looks_only: bool,
        /// Lifetime, days; `None` for the longest possible one.
        days: Option<u32>,
    },
    /// Revokes the token with a public id.
    RevokeToken { id: String },
    /// Cancels a run.
    CancelRun { run: String },
}

/// The token and the reason behind an organiser action, for the audit log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ActionOrigin {
    /// The organiser token's public id.
    pub token: String,
    /// Reason; may be empty unless the action requires one.
    pub reason: String,
}

/// An organiser's action.
#[expect(missing_docs, reason = "the documentation of a variant explains the fields")]
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum OrganiserAction {
    /// Admits a team if it is new, and creates an account token for it.
    Admit { team: String },
    /// Approves a team for a phase that requires approval, or withdraws the approval.
    Approve { team: String, phase: String, approved: bool },
    /// Grants a team runs beyond the quota, at least 1; requires a reason.
    Grant { team: String, phase: String, runs: u32 },
    /// Stops new runs in a phase for now; requires a reason, which is public.
    Pause(String),
    /// Allows new runs in a phase that was paused or closed manually.
    Resume(String),
    /// Stops new runs in a phase.
    Close(String),
    /// Publishes a closed phase's committed secrets.
    Reveal(String),
    /// Marks a run as verified, or removes the mark.
    Verify { run: String, verified: bool },
    /// Removes a run from all leaderboards; the reason is public.
    Disqualify(String),
    /// Returns a disqualified run to the leaderboards.
    Reinstate(String),
}

/// Action outcome.
#[derive(Clone, Default, PartialEq, Eq)]
pub struct ActionOutcome {
    /// Confirmation for the visitor.
    pub message: String,
    /// A new token, shown once and never stored.
    pub secret: Option<String>,
}

impl fmt::Debug for ActionOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ActionOutcome").field("message", &self.message).finish_non_exhaustive()
    }
}

/// A running server's health.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ServerHealth {
    /// Drain reason while draining.
    pub draining: Option<String>,
    /// Announcement; empty if there is none.
    pub notice: String,
    /// Slots with an open episode: run, slot number, steps.
    pub slots: Vec<(String, u32, u32)>,
    /// Steps since the server started.
    pub steps: u64,
    /// Memory for loaded scenes, bytes.
    pub scene_bytes: usize,
    /// Simulation threads that hang.
    pub hanging: usize,
    /// Internal errors since the server started.
    pub faults: u64,
}

/// Management actions, implemented by a running arena. Each action writes a line to the audit log.
#[async_trait::async_trait]
pub trait Management: fmt::Debug + Send + Sync {
    /// Executes a team action. Fails if it is refused or the server fails.
    async fn team_action(
        &self,
        team: TeamCredential,
        action: TeamAction,
    ) -> Result<ActionOutcome, ActionError>;
    /// Executes an organiser action. Fails if it is refused or the server fails.
    async fn organiser_action(
        &self,
        origin: ActionOrigin,
        action: OrganiserAction,
    ) -> Result<ActionOutcome, ActionError>;
    /// Returns the server's current health.
    fn health(&self) -> ServerHealth;
}

#[derive(Debug)]
pub(crate) struct ManagementState {
    pub(crate) actions: Arc<dyn Management>,
    pub(crate) sessions: Sessions,
    pub(crate) sign_in_limiter: SignInLimiter,
    pub(crate) is_secure: bool,
    /// Canonical origin of the pages; `None` for the host in a request.
    pub(crate) origin: Option<String>,
}

impl ManagementState {
    pub(crate) fn new(actions: Arc<dyn Management>, is_secure: bool, origin: Option<String>) -> Self {
        let (sessions, sign_in_limiter) = (Sessions::default(), SignInLimiter::default());
        Self { actions, sessions, sign_in_limiter, is_secure, origin }
    }
}

// Consecutive failures before an address must wait; people do paste a wrong token a few times.
const MAX_FAILURES: u32 = 10;
const WAIT: Duration = Duration::from_secs(60);
// Bounds the memory: beyond it, the oldest failure is forgotten.
const MAX_CLIENTS: usize = 4096;

/// Failed sign-ins by client address: count and last time. `None`: requests without an address.
#[derive(Debug, Default)]
pub(crate) struct SignInLimiter(Mutex<BTreeMap<Option<ClientAddress>, (u32, Instant)>>);

impl SignInLimiter {
    fn failures(&self) -> MutexGuard<'_, BTreeMap<Option<ClientAddress>, (u32, Instant)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn may_try(&self, client: Option<ClientAddress>, now: Instant) -> bool {
        let failures = self.failures();
        let must_wait = |&(failed, last): &(u32, Instant)| {
            failed >= MAX_FAILURES && now.saturating_duration_since(last) < WAIT
        };
        !failures.get(&client).is_some_and(must_wait)
    }

    pub(crate) fn record_failure(&self, client: Option<ClientAddress>, now: Instant) {
        let mut failures = self.failures();
        failures.retain(|_, (_, last)| now.saturating_duration_since(*last) < WAIT);
        if failures.len() >= MAX_CLIENTS && !failures.contains_key(&client) {
            let oldest = failures.iter().min_by_key(|(_, (_, last))| *last).map(|(client, _)| *client);
            if let Some(oldest) = oldest {
                failures.remove(&oldest);
            }
        }
        let entry = failures.entry(client).or_insert((0, now));
        *entry = (entry.0.saturating_add(1), now);
    }

    pub(crate) fn record_success(&self, client: Option<ClientAddress>) {
        self.failures().remove(&client);
    }
}

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
    use std::net::IpAddr;

    fn client(text: &str) -> Option<ClientAddress> {
        Some(ClientAddress::new(text.parse().expect("an address")))
    }

    #[test]
    fn only_the_failing_client_waits() {
        let (limiter, start) = (SignInLimiter::default(), Instant::now());
        for _ in 0..MAX_FAILURES {
            assert!(limiter.may_try(client("192.0.2.1"), start));
            limiter.record_failure(client("192.0.2.1"), start);
        }
        assert!(!limiter.may_try(client("192.0.2.1"), start));
        assert!(!limiter.may_try(client("::ffff:192.0.2.1"), start), "the same address");
        assert!(limiter.may_try(client("192.0.2.2"), start) && limiter.may_try(None, start));
        assert!(limiter.may_try(client("192.0.2.1"), start + WAIT));
        limiter.record_success(client("192.0.2.1"));
        assert!(limiter.may_try(client("192.0.2.1"), start));
    }

    #[test]
    fn ipv6_network_counts_as_one_client() {
        assert_eq!(client("2001:db8::1"), client("2001:db8::ffff"));
        assert_ne!(client("2001:db8::1"), client("2001:db8:0:1::1"));
        let (limiter, start) = (SignInLimiter::default(), Instant::now());
        for index in 0..=MAX_CLIENTS as u32 {
            let address = ClientAddress::new(IpAddr::from(index.to_be_bytes()));
            limiter.record_failure(Some(address), start + Duration::from_micros(u64::from(index)));
        }
        assert_eq!(limiter.failures().len(), MAX_CLIENTS);
        assert!(!limiter.failures().contains_key(&client("0.0.0.0")), "the oldest was forgotten");
    }

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
