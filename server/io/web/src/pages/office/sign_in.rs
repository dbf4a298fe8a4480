use super::{Page, Part, Shell, write};
use crate::{
    office::{Desk, Form, Peer, SignInForm, SignedIn, cookie, is_ours, no_cookie},
    trouble::Trouble,
    visit::{Asked, now_unix_ms},
};
use askama::Template;
use avln_store::{Reader, TokenHash, Viewer};
use axum::{
    Extension,
    extract::State,
    http::header,
    response::{IntoResponse, Redirect, Response},
};
use serde::Deserialize;
use std::{sync::Arc, time::Instant};

#[derive(Template)]
#[template(path = "sign_in.html")]
struct SignInPage {
    shell: Shell,
    next: String,
}

/// Where a visitor wanted to go.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NextQuery {
    #[serde(default)]
    next: String,
}

pub(super) async fn page(Asked(query): Asked<NextQuery>) -> Page {
    let next = if is_ours(&query.next) { query.next } else { String::new() };
    write(&SignInPage { shell: Shell::new("Sign in", Part::Own), next })
}

/// Begins a session. It always has a new id, whatever cookie came along.
pub(super) async fn enter(
    State(reader): State<Reader>,
    Extension(desk): Extension<Arc<Desk>>,
    peer: Option<Extension<Peer>>,
    before: Option<Extension<SignedIn>>,
    SignInForm(fields): SignInForm,
) -> Result<Response, Trouble> {
    let peer = peer.map(|Extension(peer)| peer);
    if !desk.attempts.may_try(peer, Instant::now()) {
        return Err(Trouble::Attempts);
    }
    let token = TokenHash::of(fields.get("token")?.trim());
    let Some(holder) = reader.holder(&token, now_unix_ms()).await? else {
        desk.attempts.failed(peer, Instant::now());
        return Err(Trouble::WrongToken);
    };
    desk.attempts.succeeded(peer);
    if let Some(Extension(before)) = before {
        desk.sessions.end(&before.id);
    }
    let next = fields.get("next")?;
    let home = if holder.viewer == Viewer::Organiser { "/organise" } else { "/me" };
    let to = if is_ours(next) { next } else { home };
    let id = desk.sessions.begin(token, holder.viewer, Instant::now()).map_err(|error| {
        tracing::error!(%error, "no session can begin");
        Trouble::Internal
    })?;
    Ok(([(header::SET_COOKIE, cookie(&id, desk.is_secure)?)], Redirect::to(to)).into_response())
}

/// Ends the session.
pub(super) async fn leave(Extension(desk): Extension<Arc<Desk>>, form: Form) -> Result<Response, Trouble> {
    desk.sessions.end(&form.by.id);
    Ok(([(header::SET_COOKIE, no_cookie(desk.is_secure)?)], Redirect::to("/")).into_response())
}
