//! The organiser's pages: phases, runs and teams.

use super::{
    FormContext, OrganiserTab, Page, PageShell, SiteSection, find_phase, redirect_after, render,
    unknown_action,
};
use crate::{
    error::RequestError,
    format::{self, url_encode},
    management::{FormFields, ManagementState, Organiser, OrganiserAction, SignedForm},
    request::{RequestContext, RunsQuery, StrictQuery, now_unix_ms},
};
use askama::Template;
use avln_scoring::Key;
use avln_store::{PhaseState, PhaseView, Reader, RunLine, RunList, RunView, TeamsView, Viewer};
use axum::{
    Extension,
    extract::{Path, State},
    response::{IntoResponse, Response},
};
use std::sync::Arc;

/// Run limit per grant.
const MAX_GRANTED_RUNS: u32 = 1000;

#[derive(Template)]
#[template(path = "organise.html")]
struct OrganisePhasesPage {
    shell: PageShell,
    form_context: FormContext,
    tab: OrganiserTab,
    phases: Vec<PhaseView>,
}

pub(super) async fn phases(
    Organiser(by): Organiser,
    context: RequestContext,
    Extension(management): Extension<Arc<ManagementState>>,
) -> Page {
    let tab = OrganiserTab::Phases;
    render(&OrganisePhasesPage {
        shell: tab.shell("Organise"),
        form_context: FormContext::new(&management, &by),
        tab,
        phases: context.reader.phases(&Viewer::Organiser, context.now_unix_ms).await?,
    })
}

#[derive(Template)]
#[template(path = "organise_phase.html")]
struct OrganisePhasePage {
    shell: PageShell,
    form_context: FormContext,
    tab: OrganiserTab,
    phase: PhaseView,
}

pub(super) async fn phase(
    Organiser(by): Organiser,
    context: RequestContext,
    Extension(management): Extension<Arc<ManagementState>>,
    Path(id): Path<String>,
) -> Page {
    let phase = find_phase(&context, &id).await?;
    let tab = OrganiserTab::Phases;
    let shell = tab.shell(phase.title.clone()).below("Organise", tab.href());
    render(&OrganisePhasePage { shell, form_context: FormContext::new(&management, &by), tab, phase })
}

pub(super) async fn act_on_phase(
    organiser: Organiser,
    Extension(management): Extension<Arc<ManagementState>>,
    Path(id): Path<String>,
    SignedForm { by, fields }: SignedForm,
) -> Result<Response, RequestError> {
    let (action, reason) = phase_action(&id, &fields)?;
    let outcome = management.actions.organiser_action(organiser.origin(reason), action).await?;
    Ok(redirect_after(&management, &by, outcome, &format!("/organise/phases/{}", url_encode(&id))))
}

/// Returns action and reason. Irreversible actions require the typed phase id.
fn phase_action(id: &str, fields: &FormFields) -> Result<(OrganiserAction, String), RequestError> {
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
    form_context: FormContext,
    tab: OrganiserTab,
    runs: Vec<RunLine>,
    next: Option<String>,
    query: RunsQuery,
    limit: u32,
}

pub(super) async fn runs(
    Organiser(by): Organiser,
    context: RequestContext,
    Extension(management): Extension<Arc<ManagementState>>,
    StrictQuery(query): StrictQuery<RunsQuery>,
) -> Page {
    let limit = query.limit()?;
    let RunList { runs, next } = query.list(&context.reader, &Viewer::Organiser).await?;
    let tab = OrganiserTab::Runs;
    render(&OrganiseRunsPage {
        shell: tab.shell("Runs"),
        form_context: FormContext::new(&management, &by),
        tab,
        runs,
        next,
        query,
        limit,
    })
}

#[derive(Template)]
#[template(path = "organise_run.html")]
struct OrganiseRunPage {
    shell: PageShell,
    form_context: FormContext,
    tab: OrganiserTab,
    view: RunView,
}

pub(super) async fn run(
    Organiser(by): Organiser,
    context: RequestContext,
    Extension(management): Extension<Arc<ManagementState>>,
    Path(id): Path<String>,
) -> Page {
    let view = context.reader.run(&Viewer::Organiser, &id).await?;
    let view = view.ok_or(RequestError::Unknown { what: "run", name: id })?;
    let tab = OrganiserTab::Runs;
    let title = format!("{} {} by {}: ruling", view.line.method, view.line.version, view.line.team);
    let shell = tab.shell(title).below("Runs", tab.href());
    render(&OrganiseRunPage { shell, form_context: FormContext::new(&management, &by), tab, view })
}

pub(super) async fn act_on_run(
    organiser: Organiser,
    Extension(management): Extension<Arc<ManagementState>>,
    Path(id): Path<String>,
    SignedForm { by, fields }: SignedForm,
) -> Result<Response, RequestError> {
    let action = run_action(&id, &fields)?;
    let outcome = management.actions.organiser_action(organiser.origin(fields.reason()?), action).await?;
    Ok(redirect_after(&management, &by, outcome, &format!("/organise/runs/{}", url_encode(&id))))
}

fn run_action(id: &str, fields: &FormFields) -> Result<OrganiserAction, RequestError> {
    let run = id.to_owned();
    Ok(match fields.get("action")? {
        "verify" => OrganiserAction::Verify { run, verified: true },
        "unverify" => OrganiserAction::Verify { run, verified: false },
        "disqualify" => OrganiserAction::Disqualify(run),
        "reinstate" => OrganiserAction::Reinstate(run),
        other => return Err(unknown_action(other)),
    })
}

impl OrganiseRunPage {
    fn line(&self) -> &RunLine {
        &self.view.line
    }
}

#[derive(Template)]
#[template(path = "organise_teams.html")]
struct OrganiseTeamsPage {
    shell: PageShell,
    form_context: FormContext,
    tab: OrganiserTab,
    view: TeamsView,
    phases: Vec<PhaseView>,
    /// A new token.
    secret: Option<String>,
}

pub(super) async fn teams(
    organiser: Organiser,
    State(reader): State<Reader>,
    Extension(management): Extension<Arc<ManagementState>>,
) -> Page {
    show_teams(&reader, FormContext::new(&management, &organiser.0), None).await
}

pub(super) async fn act_on_team(
    organiser: Organiser,
    State(reader): State<Reader>,
    Extension(management): Extension<Arc<ManagementState>>,
    SignedForm { by, fields }: SignedForm,
) -> Result<Response, RequestError> {
    let (action, reason) = team_action(&fields)?;
    let outcome = management.actions.organiser_action(organiser.origin(reason), action).await?;
    if outcome.secret.is_none() {
        return Ok(redirect_after(&management, &by, outcome, OrganiserTab::Teams.href()));
    }
    let form_context = FormContext { message: Some(outcome.message), ..FormContext::new(&management, &by) };
    Ok(show_teams(&reader, form_context, outcome.secret).await?.into_response())
}

fn team_action(fields: &FormFields) -> Result<(OrganiserAction, String), RequestError> {
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

async fn show_teams(reader: &Reader, form_context: FormContext, secret: Option<String>) -> Page {
    let now_unix_ms = now_unix_ms();
    let tab = OrganiserTab::Teams;
    render(&OrganiseTeamsPage {
        shell: tab.shell("Teams"),
        form_context,
        tab,
        view: reader.teams(&Viewer::Organiser, now_unix_ms).await?,
        phases: reader.phases(&Viewer::Organiser, now_unix_ms).await?,
        secret,
    })
}
