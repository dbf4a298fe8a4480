use super::{Because, Desk, Member, Menu, sessions::form_key};
use crate::{trouble::Trouble, visit::now_unix_ms};
use avln_store::{Holder, Reader, Viewer};
use axum::{
    extract::{FromRequestParts, Request, State},
    http::{HeaderMap, HeaderValue, header, request::Parts},
    middleware::Next,
    response::{IntoResponse, Redirect, Response},
};
use std::{sync::Arc, time::Instant};

/// Name of the cookie. Browsers take the prefix to mean that no other site or port can have set it, and want TLS for that.
const COOKIE: &str = "avln-session";
const SECURE_COOKIE: &str = "__Host-avln-session";

/// A visitor who showed a token in this session, and whose token still holds.
#[derive(Clone, Debug)]
pub(crate) struct SignedIn {
    pub(crate) holder: Holder,
    /// The id of the session, which the cookie holds.
    pub(crate) id: String,
}

impl SignedIn {
    /// What every form of this session carries.
    pub(crate) fn form_key(&self) -> String {
        form_key(&self.id).to_string()
    }

    /// Whether a form carries the key of this session; takes as long whatever it carries.
    pub(super) fn made(&self, key: &str) -> bool {
        blake3::Hash::from_hex(key).is_ok_and(|key| key == form_key(&self.id))
    }

    /// The team that may act, by this token.
    pub(crate) fn member(&self) -> Result<Member, Trouble> {
        let Viewer::Team(team) = &self.holder.viewer else { return Err(Trouble::NoPage) };
        if self.holder.read_only {
            let words = "a token for looking changes nothing; sign in with an account token of the team";
            return Err(Trouble::Refused(words.to_owned()));
        }
        let Holder { token, expires_unix_ms, .. } = self.holder.clone();
        Ok(Member { team: team.clone(), token, expires_unix_ms })
    }
}

/// The organiser, who is signed in. For anybody else there is no such page.
pub(crate) struct Organiser(pub(crate) SignedIn);

impl Organiser {
    /// By whom and why something is asked for.
    pub(crate) fn because(&self, reason: String) -> Because {
        Because { token: self.0.holder.token.clone(), reason }
    }
}

impl<S: Sync> FromRequestParts<S> for SignedIn {
    type Rejection = Response;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Response> {
        let signed = parts.extensions.get::<Self>().cloned();
        let path = parts.uri.path();
        let next = if is_ours(path) { format!("?next={path}") } else { String::new() };
        signed.ok_or_else(|| Redirect::to(&format!("/sign-in{next}")).into_response())
    }
}

impl<S: Sync> FromRequestParts<S> for Organiser {
    type Rejection = Response;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Response> {
        let signed = SignedIn::from_request_parts(parts, state).await?;
        match signed.holder.viewer {
            Viewer::Organiser => Ok(Self(signed)),
            _ => Err(Trouble::NoPage.into_response()),
        }
    }
}

/// Recognises visitors by their cookies; each answer and its trouble have their menu.
pub(crate) async fn recognised(
    State((desk, reader)): State<(Arc<Desk>, Reader)>,
    mut request: Request,
    next: Next,
) -> Response {
    let signed = signed_in(&desk, &reader, request.headers()).await;
    let menu = match signed.as_ref().map(|signed| &signed.holder.viewer) {
        None | Some(Viewer::Anonymous) => Menu::Stranger,
        Some(Viewer::Team(_)) => Menu::Team,
        Some(Viewer::Organiser) => Menu::Organiser,
    };
    if let Some(signed) = signed {
        request.extensions_mut().insert(signed);
    }
    let mut response = menu.during(next.run(request)).await;
    response.extensions_mut().insert(menu);
    response
}

async fn signed_in(desk: &Desk, reader: &Reader, headers: &HeaderMap) -> Option<SignedIn> {
    let id = session_id(headers, name(desk.is_secure))?;
    let token = desk.sessions.find(id, Instant::now())?;
    match reader.holder(&token, now_unix_ms()).await {
        Ok(Some(holder)) => Some(SignedIn { holder, id: id.to_owned() }),
        Ok(None) => {
            // The token was taken back or has expired.
            desk.sessions.end(id);
            None
        }
        Err(error) => {
            tracing::error!(%error, "a visitor cannot be recognised");
            None
        }
    }
}

fn name(is_secure: bool) -> &'static str {
    if is_secure { SECURE_COOKIE } else { COOKIE }
}

/// Whether a request may come from somebody who is signed in.
pub(crate) fn has_cookie(headers: &HeaderMap) -> bool {
    [COOKIE, SECURE_COOKIE].iter().any(|name| session_id(headers, name).is_some())
}

fn session_id<'a>(headers: &'a HeaderMap, name: &str) -> Option<&'a str> {
    let values = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
    let mut pairs = values.flat_map(|value| value.split(';')).filter_map(|pair| pair.trim().split_once('='));
    pairs.find(|(found, _)| *found == name).map(|(_, id)| id)
}

/// Whether an address is one of the pages that ask for a session.
pub(crate) fn is_ours(address: &str) -> bool {
    let plain = |letter: char| letter.is_ascii_alphanumeric() || matches!(letter, '/' | '-' | '_' | '.');
    let is_page = address == "/me" || address == "/organise" || address.starts_with("/organise/");
    is_page && address.chars().all(plain)
}

/// The header that gives a browser the session `id`.
pub(crate) fn cookie(id: &str, is_secure: bool) -> Result<HeaderValue, Trouble> {
    let secure = if is_secure { "; Secure" } else { "" };
    let text = format!("{}={id}; Path=/; HttpOnly; SameSite=Strict{secure}", name(is_secure));
    HeaderValue::try_from(text).map_err(|_| Trouble::Internal)
}

/// The header that takes it away.
pub(crate) fn no_cookie(is_secure: bool) -> Result<HeaderValue, Trouble> {
    let mut text = cookie("", is_secure)?.as_bytes().to_vec();
    text.extend_from_slice(b"; Max-Age=0");
    HeaderValue::try_from(text).map_err(|_| Trouble::Internal)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cookies_are_found_by_their_whole_name() {
        let mut headers = HeaderMap::new();
        headers.insert(header::COOKIE, HeaderValue::from_static("a=b; my-avln-session=1"));
        assert!(!has_cookie(&headers));
        headers.append(header::COOKIE, HeaderValue::from_static("x; avln-session=2; c=d"));
        assert_eq!(session_id(&headers, COOKIE), Some("2"));
        assert_eq!(session_id(&headers, SECURE_COOKIE), None);
        assert!(has_cookie(&headers));
    }

    #[test]
    fn a_door_with_tls_has_a_cookie_that_nobody_else_can_set() {
        let plain = cookie("ab", false).expect("a header");
        assert_eq!(plain, "avln-session=ab; Path=/; HttpOnly; SameSite=Strict");
        let secure = cookie("ab", true).expect("a header");
        assert_eq!(secure, "__Host-avln-session=ab; Path=/; HttpOnly; SameSite=Strict; Secure");
        let gone = no_cookie(true).expect("a header");
        assert_eq!(gone, "__Host-avln-session=; Path=/; HttpOnly; SameSite=Strict; Secure; Max-Age=0");
    }

    #[test]
    fn one_is_led_to_pages_of_this_door_only() {
        for ours in ["/me", "/organise", "/organise/phases/practice-3x4", "/organise/runs/run_1"] {
            assert!(is_ours(ours), "{ours}");
        }
        for other in
            ["", "/", "//evil.example", "https://evil.example", "/organised", "/me?x", "/organise/\r\nx"]
        {
            assert!(!is_ours(other), "{other}");
        }
    }
}
