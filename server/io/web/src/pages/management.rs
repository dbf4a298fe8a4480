//! Management pages: sign-in; the team's tokens, quotas and runs; the organiser's phases, teams, runs, audit log and health.

use super::{FormContext, Page, PageShell, SiteSection, redirect_after, render, unknown_action};
use crate::{
    error::{RequestError, Result},
    format::{self, url_encode},
    management::{
        ActionOrigin, ActionOutcome, FormFields, ManagementState, OrganiserAction, ServerHealth, SignInForm,
        SignedForm, SignedIn, TeamAction, is_management_page, session_cookie,
    },
    request::{NoParameters, RequestContext, RunsQuery, StrictQuery, now_unix_ms},
    server::ClientAddress,
};
use askama::Template;
use avln_scoring::Key;
use avln_store::{
    AuditLine, Census, PhaseState, PhaseView, Quota, Reader, RunLine, RunList, RunView, TeamsView, TokenHash,
    TokenLine, Viewer,
};
use axum::{
    Extension,
    extract::{FromRequestParts, Path, State},
    http::{header, request::Parts},
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

pub(super) async fn team(
    State(reader): State<Reader>,
    Extension(management): Extension<Arc<ManagementState>>,
    by: SignedIn,
) -> Result<Response> {
    if by.holder.viewer == Viewer::Organiser {
        return Ok(Redirect::to("/organise").into_response());
    }
    Ok(show_team(&reader, &management, by, None).await?.into_response())
}

pub(super) async fn act_as_team(
    State(reader): State<Reader>,
    Extension(management): Extension<Arc<ManagementState>>,
    SignedForm { by, fields }: SignedForm,
) -> Result<Response> {
    let outcome = management.actions.team_action(by.team()?, own_action(&fields)?).await?;
    match outcome.secret {
        None => Ok(redirect_after(&management, &by, outcome, "/me")),
        secret => Ok(show_team(&reader, &management, by, secret).await?.into_response()),
    }
}

fn own_action(fields: &FormFields) -> Result<TeamAction> {
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

async fn show_team(
    reader: &Reader,
    management: &ManagementState,
    by: SignedIn,
    secret: Option<String>,
) -> Page {
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

const MAX_GRANTED_RUNS: u32 = 1000;
const AUDIT_LINES: u32 = 100;

struct Tab {
    name: &'static str,
    href: &'static str,
}

const PHASES: Tab = Tab { name: "Phases", href: "/organise" };
const TEAMS: Tab = Tab { name: "Teams", href: "/organise/teams" };
const RUNS: Tab = Tab { name: "Runs", href: "/organise/runs" };
const AUDIT: Tab = Tab { name: "Audit log", href: "/organise/audit" };
const HEALTH: Tab = Tab { name: "Health", href: "/organise/health" };
const TABS: [Tab; 5] = [PHASES, TEAMS, RUNS, AUDIT, HEALTH];

/// A signed-in organiser's request. For other visitors the page does not exist.
pub(super) struct OrganiserRequest {
    by: SignedIn,
    context: RequestContext,
    management: Arc<ManagementState>,
}

impl FromRequestParts<Reader> for OrganiserRequest {
    type Rejection = Response;

    async fn from_request_parts(parts: &mut Parts, reader: &Reader) -> Result<Self, Response> {
        let by = SignedIn::from_request_parts(parts, reader).await?;
        if by.holder.viewer != Viewer::Organiser {
            return Err(RequestError::NoPage.into_response());
        }
        let context = RequestContext::from_request_parts(parts, reader).await;
        let context = context.map_err(IntoResponse::into_response)?;
        let management = Extension::from_request_parts(parts, reader).await;
        let Extension(management) = management.map_err(IntoResponse::into_response)?;
        Ok(Self { by, context, management })
    }
}

impl OrganiserRequest {
    fn shell(&self, title: impl Into<String>, tab: &Tab) -> PageShell {
        let shell = PageShell::new(title, SiteSection::Own);
        let form = FormContext::new(&self.management, &self.by);
        PageShell { form, tab: tab.name, ..shell }.below("Organise", PHASES.href)
    }

    async fn act(&self, action: OrganiserAction, reason: String) -> Result<ActionOutcome> {
        let origin = ActionOrigin { token: self.by.holder.token.clone(), reason };
        Ok(self.management.actions.organiser_action(origin, action).await?)
    }
}

#[derive(Template)]
#[template(path = "organise.html")]
struct OrganisePhasesPage {
    shell: PageShell,
    phases: Vec<PhaseView>,
}

pub(super) async fn phases(organiser: OrganiserRequest) -> Page {
    let context = &organiser.context;
    let phases = context.reader.phases(&Viewer::Organiser, context.now_unix_ms).await?;
    let shell = PageShell { trail: vec![], ..organiser.shell("Organise", &PHASES) };
    render(&OrganisePhasesPage { shell, phases })
}

#[derive(Template)]
#[template(path = "organise_phase.html")]
struct OrganisePhasePage {
    shell: PageShell,
    phase: PhaseView,
}

pub(super) async fn phase(organiser: OrganiserRequest, Path(id): Path<String>) -> Page {
    let phase = organiser.context.phase(&id).await?;
    render(&OrganisePhasePage { shell: organiser.shell(phase.title.clone(), &PHASES), phase })
}

pub(super) async fn act_on_phase(
    organiser: OrganiserRequest,
    Path(id): Path<String>,
    SignedForm { fields, .. }: SignedForm,
) -> Result<Response> {
    let (action, reason) = phase_action(&id, &fields)?;
    let outcome = organiser.act(action, reason).await?;
    Ok(redirect_after(
        &organiser.management,
        &organiser.by,
        outcome,
        &format!("/organise/phases/{}", url_encode(&id)),
    ))
}

/// Returns action and reason. Irreversible actions require the typed phase id.
fn phase_action(id: &str, fields: &FormFields) -> Result<(OrganiserAction, String)> {
    let phase = id.to_owned();
    Ok(match fields.get("action")? {
        "pause" => (OrganiserAction::Pause(phase), fields.reason()?),
        "resume" => (OrganiserAction::Resume(phase), fields.maybe_reason()?),
        "close" => {
            fields.confirm(id)?;
            (OrganiserAction::Close(phase), fields.reason()?)
        }
        "reveal" => {
            fields.confirm(id)?;
            (OrganiserAction::Reveal(phase), fields.maybe_reason()?)
        }
        other => return Err(unknown_action(other)),
    })
}

impl OrganisePhasePage {
    fn may_resume(&self) -> bool {
        matches!(self.phase.state, PhaseState::Paused | PhaseState::Closed)
    }

    fn may_reveal(&self) -> bool {
        let promise = self.phase.promise.as_ref();
        self.phase.state == PhaseState::Closed && promise.is_some_and(|promise| promise.revealed.is_none())
    }
}

#[derive(Template)]
#[template(path = "organise_runs.html")]
struct OrganiseRunsPage {
    shell: PageShell,
    list: RunList,
    query: RunsQuery,
    limit: u32,
}

pub(super) async fn runs(organiser: OrganiserRequest, StrictQuery(query): StrictQuery<RunsQuery>) -> Page {
    let limit = query.limit()?;
    let list = query.list(&organiser.context.reader, &Viewer::Organiser).await?;
    render(&OrganiseRunsPage { shell: organiser.shell("Runs", &RUNS), list, query, limit })
}

#[derive(Template)]
#[template(path = "organise_run.html")]
struct OrganiseRunPage {
    shell: PageShell,
    view: RunView,
}

pub(super) async fn run(organiser: OrganiserRequest, Path(id): Path<String>) -> Page {
    let view = organiser.context.run(&id).await?;
    let RunLine { method, version, team, .. } = &view.line;
    let shell = organiser.shell(format!("{method} {version} by {team}: ruling"), &RUNS);
    render(&OrganiseRunPage { shell: shell.below("Runs", RUNS.href), view })
}

pub(super) async fn act_on_run(
    organiser: OrganiserRequest,
    Path(id): Path<String>,
    SignedForm { fields, .. }: SignedForm,
) -> Result<Response> {
    let outcome = organiser.act(run_action(&id, &fields)?, fields.reason()?).await?;
    Ok(redirect_after(
        &organiser.management,
        &organiser.by,
        outcome,
        &format!("/organise/runs/{}", url_encode(&id)),
    ))
}

fn run_action(id: &str, fields: &FormFields) -> Result<OrganiserAction> {
    let run = id.to_owned();
    Ok(match fields.get("action")? {
        "verify" => OrganiserAction::Verify { run, verified: true },
        "unverify" => OrganiserAction::Verify { run, verified: false },
        "disqualify" => OrganiserAction::Disqualify(run),
        "reinstate" => OrganiserAction::Reinstate(run),
        other => return Err(unknown_action(other)),
    })
}

#[derive(Template)]
#[template(path = "organise_teams.html")]
struct OrganiseTeamsPage {
    shell: PageShell,
    view: TeamsView,
    phases: Vec<PhaseView>,
    secret: Option<String>,
}

pub(super) async fn teams(organiser: OrganiserRequest) -> Page {
    show_teams(&organiser, ActionOutcome::default()).await
}

pub(super) async fn act_on_team(
    organiser: OrganiserRequest,
    SignedForm { fields, .. }: SignedForm,
) -> Result<Response> {
    let (action, reason) = team_action(&fields)?;
    let outcome = organiser.act(action, reason).await?;
    if outcome.secret.is_none() {
        return Ok(redirect_after(&organiser.management, &organiser.by, outcome, TEAMS.href));
    }
    Ok(show_teams(&organiser, outcome).await?.into_response())
}

fn team_action(fields: &FormFields) -> Result<(OrganiserAction, String)> {
    let team = fields.name("team")?;
    Ok(match fields.get("action")? {
        "admit" => (OrganiserAction::Admit { team }, fields.maybe_reason()?),
        "grant" => {
            let runs = fields.number("runs", 1..=MAX_GRANTED_RUNS)?;
            (OrganiserAction::Grant { team, phase: fields.name("phase")?, runs }, fields.reason()?)
        }
        "approve" => {
            let approved = fields.get("approved")? == "yes";
            let phase = fields.name("phase")?;
            (OrganiserAction::Approve { team, phase, approved }, fields.maybe_reason()?)
        }
        other => return Err(unknown_action(other)),
    })
}

async fn show_teams(organiser: &OrganiserRequest, outcome: ActionOutcome) -> Page {
    let RequestContext { reader, now_unix_ms, .. } = &organiser.context;
    let mut shell = organiser.shell("Teams", &TEAMS);
    if outcome.secret.is_some() {
        shell.form.message = Some(outcome.message);
    }
    render(&OrganiseTeamsPage {
        shell,
        view: reader.teams(&Viewer::Organiser, *now_unix_ms).await?,
        phases: reader.phases(&Viewer::Organiser, *now_unix_ms).await?,
        secret: outcome.secret,
    })
}

#[derive(Template)]
#[template(path = "organise_audit.html")]
struct AuditPage {
    shell: PageShell,
    lines: Vec<AuditLine>,
    older_than: Option<i64>,
    is_newest: bool,
}

/// An audit log page: the lines before this line, or the newest.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AuditQuery {
    before: Option<i64>,
}

pub(super) async fn audit(organiser: OrganiserRequest, StrictQuery(query): StrictQuery<AuditQuery>) -> Page {
    let reader = &organiser.context.reader;
    let mut lines = reader.audit(&Viewer::Organiser, query.before, AUDIT_LINES + 1).await?;
    let has_more = lines.len() > AUDIT_LINES as usize;
    lines.truncate(AUDIT_LINES as usize);
    let older_than = lines.last().map(|line| line.id).filter(|_| has_more);
    let shell = organiser.shell("Audit log", &AUDIT);
    render(&AuditPage { shell, lines, older_than, is_newest: query.before.is_none() })
}

#[derive(Template)]
#[template(path = "organise_health.html")]
struct HealthPage {
    shell: PageShell,
    health: ServerHealth,
    census: Census,
}

pub(super) async fn health(organiser: OrganiserRequest, _: StrictQuery<NoParameters>) -> Page {
    let health = organiser.management.actions.health();
    let census = organiser.context.reader.census().await?;
    render(&HealthPage { shell: organiser.shell("Health", &HEALTH), health, census })
}
