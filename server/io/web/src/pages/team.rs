//! Sign-in, and the team page: tokens, quotas and runs.

use super::{FormContext, Page, PageShell, SiteSection, redirect_after, render, unknown_action};
use crate::{
    error::{RequestError, Result},
    format,
    management::{
        FormFields, ManagementState, SignInForm, SignedForm, SignedIn, TeamAction, is_management_page,
        session_cookie,
    },
    request::{StrictQuery, now_unix_ms},
    server::ClientAddress,
};
use askama::Template;
use avln_store::{Quota, Reader, RunLine, TokenHash, TokenLine, Viewer};
use axum::{
    Extension,
    extract::State,
    http::header,
    response::{IntoResponse, Redirect, Response},
};
use serde::Deserialize;
use std::{sync::Arc, time::Instant};

const LISTED_RUNS: u32 = 100;
const MAX_DAYS: u32 = 3650;

#[derive(Template)]
#[template(path = "sign_in.html")]
struct SignInPage {
    shell: PageShell,
    next: String,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NextQuery {
    #[serde(default)]
    next: String,
}

pub(super) async fn sign_in_page(StrictQuery(query): StrictQuery<NextQuery>) -> Page {
    let next = if is_management_page(&query.next) { query.next } else { String::new() };
    render(&SignInPage { shell: PageShell::new("Sign in", SiteSection::Own), next })
}

// Always a new id: an id that an attacker planted as a cookie is never used.
pub(super) async fn sign_in(
    State(reader): State<Reader>,
    Extension(management): Extension<Arc<ManagementState>>,
    client: Option<Extension<ClientAddress>>,
    before: Option<Extension<SignedIn>>,
    SignInForm(fields): SignInForm,
) -> Result<Response> {
    let client = client.map(|Extension(client)| client);
    if !management.sign_in_limiter.may_try(client, Instant::now()) {
        return Err(RequestError::Attempts);
    }
    let token = TokenHash::of(fields.get("token")?.trim());
    let Some(holder) = reader.holder(&token, now_unix_ms()).await? else {
        management.sign_in_limiter.record_failure(client, Instant::now());
        return Err(RequestError::WrongToken);
    };
    management.sign_in_limiter.record_success(client);
    if let Some(Extension(before)) = before {
        management.sessions.end(&before.id);
    }
    let next = fields.get("next")?;
    let home = if holder.viewer == Viewer::Organiser { "/organise" } else { "/me" };
    let to = if is_management_page(next) { next } else { home };
    let id = management.sessions.start(token, holder.viewer, Instant::now()).map_err(|error| {
        tracing::error!(%error, "cannot start a session");
        RequestError::Internal
    })?;
    let cookie = session_cookie(Some(&id), management.is_secure)?;
    Ok(([(header::SET_COOKIE, cookie)], Redirect::to(to)).into_response())
}

pub(super) async fn sign_out(
    Extension(management): Extension<Arc<ManagementState>>,
    form: SignedForm,
) -> Result<Response> {
    management.sessions.end(&form.by.id);
    let cookie = session_cookie(None, management.is_secure)?;
    Ok(([(header::SET_COOKIE, cookie)], Redirect::to("/")).into_response())
}

#[derive(Template)]
#[template(path = "team.html")]
struct TeamPage {
    shell: PageShell,
    by: SignedIn,
    team: String,
    secret: Option<String>,
    tokens: Vec<TokenLine>,
    quotas: Vec<Quota>,
    runs: Vec<RunLine>,
    now_unix_ms: i64,
}

pub(super) async fn page(
    State(reader): State<Reader>,
    Extension(management): Extension<Arc<ManagementState>>,
    by: SignedIn,
) -> Result<Response> {
    if by.holder.viewer == Viewer::Organiser {
        return Ok(Redirect::to("/organise").into_response());
    }
    Ok(show(&reader, &management, by, None).await?.into_response())
}

pub(super) async fn act(
    State(reader): State<Reader>,
    Extension(management): Extension<Arc<ManagementState>>,
    SignedForm { by, fields }: SignedForm,
) -> Result<Response> {
    let outcome = management.actions.team_action(by.team()?, action(&fields)?).await?;
    match outcome.secret {
        None => Ok(redirect_after(&management, &by, outcome, "/me")),
        secret => Ok(show(&reader, &management, by, secret).await?.into_response()),
    }
}

fn action(fields: &FormFields) -> Result<TeamAction> {
    Ok(match fields.get("action")? {
        "issue" => TeamAction::IssueToken {
            name: fields.name("name")?,
            looks_only: fields.get("kind")? == "read_only",
            days: fields.maybe_number("days", 1..=MAX_DAYS)?,
        },
        "revoke" => TeamAction::RevokeToken { id: fields.name("id")? },
        "cancel" => TeamAction::CancelRun { run: fields.name("run")? },
        other => return Err(unknown_action(other)),
    })
}

async fn show(reader: &Reader, management: &ManagementState, by: SignedIn, secret: Option<String>) -> Page {
    let viewer = &by.holder.viewer;
    let Viewer::Team(team) = viewer.clone() else { return Err(RequestError::NoPage) };
    let now_unix_ms = now_unix_ms();
    let shell = PageShell::new("My page", SiteSection::Own);
    render(&TeamPage {
        shell: PageShell { form: FormContext::new(management, &by), ..shell },
        tokens: reader.own_tokens(viewer).await?,
        quotas: reader.quotas(viewer, now_unix_ms).await?,
        runs: reader.own_runs(viewer, LISTED_RUNS).await?,
        team,
        secret,
        now_unix_ms,
        by,
    })
}

impl TeamPage {
    fn may_act(&self) -> bool {
        !self.by.holder.read_only
    }

    fn state(&self, token: &TokenLine) -> &'static str {
        match (token.revoked_ms, token.expires_ms) {
            (Some(_), _) => "revoked",
            (None, Some(moment)) if moment <= self.now_unix_ms => "expired",
            _ => "valid",
        }
    }
}
