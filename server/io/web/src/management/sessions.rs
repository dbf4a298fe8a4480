//! Sessions: cookies, lifetime, and the middleware that identifies visitors.

use super::{ManagementState, TeamCredential};
use crate::{
    error::{RequestError, Result},
    request::{CONTEXT, Menu, PageContext, now_unix_ms},
};
use avln_store::{Holder, Reader, TokenHash, Viewer};
use axum::{
    extract::{FromRequestParts, Request, State},
    http::{HeaderMap, HeaderValue, header, request::Parts},
    middleware::Next,
    response::{IntoResponse, Redirect, Response},
};
use std::{
    collections::BTreeMap,
    fmt,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

// Cookie names. Browsers accept the prefix `__Host-` only over TLS, and then guarantee that no other site or port set the cookie.
const COOKIE: &str = "avln-session";
const SECURE_COOKIE: &str = "__Host-avln-session";
// Idle time-out, for pages left open on a shared computer.
const MAX_IDLE: Duration = Duration::from_secs(2 * 3600);
// Session lifetime: a working day.
const MAX_AGE: Duration = Duration::from_secs(12 * 3600);
// Session limit per team, and for all organisers together. Beyond it, the session unused for longest ends.
const MAX_PER_VIEWER: usize = 64;
// Total session limit, about 2 MiB. Beyond it, the session unused for longest ends.
const MAX_SESSIONS: usize = 4096;

#[derive(Clone, Debug)]
pub(crate) struct SignedIn {
    pub(crate) holder: Holder,
    pub(crate) id: String,
}

impl SignedIn {
    pub(crate) fn form_key(&self) -> String {
        form_key(&self.id).to_string()
    }

    pub(super) fn accepts_form_key(&self, key: &str) -> bool {
        // `blake3::Hash` compares in constant time, so the response time does not leak the key.
        blake3::Hash::from_hex(key).is_ok_and(|key| key == form_key(&self.id))
    }

    pub(crate) fn team(&self) -> Result<TeamCredential> {
        let Viewer::Team(team) = &self.holder.viewer else { return Err(RequestError::NoPage) };
        if self.holder.read_only {
            let message =
                "a read-only token cannot change anything; sign in with an account token of the team";
            return Err(RequestError::Refused(message.to_owned()));
        }
        let Holder { token, expires_unix_ms, .. } = self.holder.clone();
        Ok(TeamCredential { team: team.clone(), token, expires_unix_ms })
    }
}

impl<S: Sync> FromRequestParts<S> for SignedIn {
    type Rejection = Response;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Response> {
        let signed_in = parts.extensions.get::<Self>().cloned();
        let path = parts.uri.path();
        let next = if is_management_page(path) { format!("?next={path}") } else { String::new() };
        signed_in.ok_or_else(|| Redirect::to(&format!("/sign-in{next}")).into_response())
    }
}

/// Middleware that identifies visitors by cookie and selects the page menu.
pub(crate) async fn identify(
    State((management, reader)): State<(Arc<ManagementState>, Reader)>,
    mut request: Request,
    next: Next,
) -> Response {
    let signed_in = find_session(&management, &reader, request.headers()).await;
    let menu = match signed_in.as_ref().map(|signed_in| &signed_in.holder.viewer) {
        None | Some(Viewer::Anonymous) => Menu::Stranger,
        Some(Viewer::Team(_)) => Menu::Team,
        Some(Viewer::Organiser) => Menu::Organiser,
    };
    if let Some(signed_in) = signed_in {
        request.extensions_mut().insert(signed_in.holder.viewer.clone());
        request.extensions_mut().insert(signed_in);
    }
    let context = PageContext { menu, ..PageContext::current() };
    let mut response = CONTEXT.scope(context, next.run(request)).await;
    // Error pages are rendered outside this context.
    response.extensions_mut().insert(menu);
    response
}

async fn find_session(
    management: &ManagementState,
    reader: &Reader,
    headers: &HeaderMap,
) -> Option<SignedIn> {
    let id = session_id(headers, cookie_name(management.is_secure))?;
    let token = management.sessions.find(id, Instant::now())?;
    match reader.holder(&token, now_unix_ms()).await {
        Ok(Some(holder)) => Some(SignedIn { holder, id: id.to_owned() }),
        Ok(None) => {
            // The token was revoked or has expired since the sign-in.
            management.sessions.end(id);
            None
        }
        Err(error) => {
            tracing::error!(%error, "cannot look up the token of a session");
            None
        }
    }
}

fn cookie_name(is_secure: bool) -> &'static str {
    if is_secure { SECURE_COOKIE } else { COOKIE }
}

/// Returns true if a request has a session cookie, valid or not.
pub(crate) fn has_session_cookie(headers: &HeaderMap) -> bool {
    [COOKIE, SECURE_COOKIE].iter().any(|name| session_id(headers, name).is_some())
}

// Written here: the crate `cookie` would add eight crates (`time` and the parts of it) for these lines.
fn session_id<'a>(headers: &'a HeaderMap, name: &str) -> Option<&'a str> {
    let values = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
    let mut pairs = values.flat_map(|value| value.split(';')).filter_map(|pair| pair.trim().split_once('='));
    pairs.find(|(found, _)| *found == name).map(|(_, id)| id)
}

/// Returns true for pages that require a session; they are safe targets after sign-in.
pub(crate) fn is_management_page(address: &str) -> bool {
    let is_plain = |letter: char| letter.is_ascii_alphanumeric() || matches!(letter, '/' | '-' | '_' | '.');
    let is_page = address == "/me" || address == "/organise" || address.starts_with("/organise/");
    is_page && address.chars().all(is_plain)
}

/// Returns the `Set-Cookie` value that starts the session `id`; `None` deletes the cookie.
pub(crate) fn session_cookie(id: Option<&str>, is_secure: bool) -> Result<HeaderValue> {
    let (name, value) = (cookie_name(is_secure), id.unwrap_or_default());
    let secure = if is_secure { "; Secure" } else { "" };
    let expired = if id.is_none() { "; Max-Age=0" } else { "" };
    let text = format!("{name}={value}; Path=/; HttpOnly; SameSite=Strict{secure}{expired}");
    HeaderValue::try_from(text).map_err(|_| RequestError::Internal)
}

/// All sessions by id hash: a memory dump opens no session.
#[derive(Default)]
pub(crate) struct Sessions(Mutex<BTreeMap<SessionKey, Session>>);

type SessionKey = [u8; 32];

struct Session {
    token: TokenHash,
    viewer: Viewer,
    started: Instant,
    used: Instant,
    message: Option<String>,
}

impl Session {
    fn has_expired(&self, now: Instant) -> bool {
        now.saturating_duration_since(self.used) >= MAX_IDLE
            || now.saturating_duration_since(self.started) >= MAX_AGE
    }
}

impl fmt::Debug for Sessions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Sessions({})", self.all().len())
    }
}

fn session_key(id: &str) -> SessionKey {
    *blake3::hash(id.as_bytes()).as_bytes()
}

/// Derives a session's form key, which does not reveal the cookie.
fn form_key(id: &str) -> blake3::Hash {
    blake3::Hash::from_bytes(blake3::derive_key("LH-AVLN Arena: key of a session's forms", id.as_bytes()))
}

impl Sessions {
    fn all(&self) -> MutexGuard<'_, BTreeMap<SessionKey, Session>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Starts a session for the holder of `token` and returns a random id. Fails without system randomness.
    pub(crate) fn start(
        &self,
        token: TokenHash,
        viewer: Viewer,
        now: Instant,
    ) -> Result<String, getrandom::Error> {
        let mut bytes = [0_u8; 32];
        getrandom::fill(&mut bytes)?;
        let id = hex::encode(bytes);
        let mut all = self.all();
        all.retain(|_, session| !session.has_expired(now));
        evict(&mut all, MAX_PER_VIEWER, |session| session.viewer == viewer);
        evict(&mut all, MAX_SESSIONS, |_| true);
        all.insert(session_key(&id), Session { token, viewer, started: now, used: now, message: None });
        Ok(id)
    }

    /// Returns a session's token and marks the session as used.
    pub(crate) fn find(&self, id: &str, now: Instant) -> Option<TokenHash> {
        let mut all = self.all();
        let key = session_key(id);
        let session = all.get_mut(&key)?;
        if session.has_expired(now) {
            all.remove(&key);
            return None;
        }
        session.used = now;
        Some(session.token.clone())
    }

    pub(crate) fn end(&self, id: &str) {
        self.all().remove(&session_key(id));
    }

    pub(crate) fn set_message(&self, id: &str, message: String) {
        if let Some(session) = self.all().get_mut(&session_key(id)) {
            session.message = Some(message);
        }
    }

    pub(crate) fn take_message(&self, id: &str) -> Option<String> {
        self.all().get_mut(&session_key(id))?.message.take()
    }
}

/// Ends the longest unused sessions among those accepted by `selects`, until fewer than `limit` remain.
fn evict(all: &mut BTreeMap<SessionKey, Session>, limit: usize, selects: impl Fn(&Session) -> bool) {
    while all.values().filter(|session| selects(session)).count() >= limit {
        let oldest =
            all.iter().filter(|(_, session)| selects(session)).min_by_key(|(_, session)| session.used);
        let Some(key) = oldest.map(|(key, _)| *key) else { return };
        all.remove(&key);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn start(sessions: &Sessions, team: &str, now: Instant) -> String {
        sessions.start(TokenHash::of(team), Viewer::Team(team.to_owned()), now).expect("randomness")
    }

    #[test]
    fn sessions_expire_by_idle_time_and_age() {
        let (sessions, begun) = (Sessions::default(), Instant::now());
        let id = start(&sessions, "red", begun);
        assert_eq!(id.len(), 64);
        let second = Duration::from_secs(1);
        assert_eq!(sessions.find(&id, begun + MAX_IDLE - second), Some(TokenHash::of("red")));
        assert!(sessions.find(&id, begun + 2 * MAX_IDLE - 2 * second).is_some(), "used in between");
        assert_eq!(sessions.find(&id, begun + 3 * MAX_IDLE), None);
        assert_eq!(sessions.find(&id, begun), None, "removed");
        let old = start(&sessions, "red", begun);
        let mut now = begun;
        while now + MAX_IDLE < begun + MAX_AGE {
            now += MAX_IDLE - second;
            assert!(sessions.find(&old, now).is_some());
        }
        assert_eq!(sessions.find(&old, begun + MAX_AGE), None);
    }

    #[test]
    fn ending_a_session_keeps_others() {
        let (sessions, now) = (Sessions::default(), Instant::now());
        let [one, other] = [start(&sessions, "red", now), start(&sessions, "red", now)];
        assert_ne!(one, other);
        sessions.end(&one);
        assert_eq!((sessions.find(&one, now), sessions.find(&other, now).is_some()), (None, true));
        assert_eq!(sessions.find("", now), None);
    }

    #[test]
    fn session_limits_apply_per_viewer_and_in_total() {
        let (sessions, begun) = (Sessions::default(), Instant::now());
        let organiser = sessions.start(TokenHash::of("o"), Viewer::Organiser, begun).expect("randomness");
        let moment = |index: usize| begun + Duration::from_millis(index as u64);
        let many: Vec<String> =
            (0..=MAX_PER_VIEWER).map(|index| start(&sessions, "red", moment(index))).collect();
        let now = moment(MAX_PER_VIEWER);
        assert_eq!(sessions.find(&many[0], now), None, "the oldest of the team ended");
        assert!(sessions.find(&many[1], now).is_some() && sessions.find(&organiser, now).is_some());
        for index in 0..MAX_SESSIONS {
            start(&sessions, &format!("team {index}"), now + Duration::from_secs(1));
        }
        assert_eq!(sessions.all().len(), MAX_SESSIONS);
    }

    #[test]
    fn messages_are_shown_once_and_form_keys_differ() {
        let (sessions, now) = (Sessions::default(), Instant::now());
        let id = start(&sessions, "red", now);
        sessions.set_message(&id, "done".to_owned());
        assert_eq!((sessions.take_message(&id), sessions.take_message(&id)), (Some("done".to_owned()), None));
        assert_eq!(form_key(&id), form_key(&id));
        assert_ne!(form_key(&id), form_key("other"));
        assert!(!format!("{sessions:?}").contains(&id));
    }

    #[test]
    fn cookies_match_by_their_whole_name() {
        let mut headers = HeaderMap::new();
        headers.insert(header::COOKIE, HeaderValue::from_static("a=b; my-avln-session=1"));
        assert!(!has_session_cookie(&headers));
        headers.append(header::COOKIE, HeaderValue::from_static("x; avln-session=2; c=d"));
        assert_eq!(session_id(&headers, COOKIE), Some("2"));
        assert_eq!(session_id(&headers, SECURE_COOKIE), None);
        assert!(has_session_cookie(&headers));
    }

    #[test]
    fn tls_uses_the_host_prefix() {
        let plain = session_cookie(Some("ab"), false).expect("a header");
        assert_eq!(plain, "avln-session=ab; Path=/; HttpOnly; SameSite=Strict");
        let secure = session_cookie(Some("ab"), true).expect("a header");
        assert_eq!(secure, "__Host-avln-session=ab; Path=/; HttpOnly; SameSite=Strict; Secure");
        let gone = session_cookie(None, true).expect("a header");
        assert_eq!(gone, "__Host-avln-session=; Path=/; HttpOnly; SameSite=Strict; Secure; Max-Age=0");
    }

    #[test]
    fn only_management_pages_are_redirect_targets() {
        for ours in ["/me", "/organise", "/organise/phases/practice-3x4", "/organise/runs/run_1"] {
            assert!(is_management_page(ours), "{ours}");
        }
        for other in
            ["", "/", "//evil.example", "https://evil.example", "/organised", "/me?x", "/organise/\r\nx"]
        {
            assert!(!is_management_page(other), "{other}");
        }
    }
}
