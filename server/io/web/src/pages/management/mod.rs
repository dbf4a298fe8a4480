//! Pages for signed-in visitors: a team's page, and the organiser's pages.

mod organiser;
mod team;

use super::{Page, PageShell, SiteSection, find_phase, render};
use crate::{
    error::RequestError,
    format,
    management::{ActionOutcome, ManagementState, Organiser, ServerHealth, SignedIn},
    request::{NoParameters, RequestContext, StrictQuery},
};
use askama::Template;
use avln_store::{AuditLine, Census, Reader, Viewer};
use axum::{
    Extension, Router,
    response::{IntoResponse, Redirect, Response},
    routing::{get, post},
};
use serde::Deserialize;
use std::sync::Arc;

/// Lines per audit log page.
const AUDIT_LINES: u32 = 100;

pub(crate) fn router() -> Router<Reader> {
    Router::new()
        .route("/sign-in", get(team::sign_in_page).post(team::sign_in))
        .route("/sign-out", post(team::sign_out).get(async || Redirect::to("/sign-in")))
        .route("/me", get(team::page).post(team::act))
        .route("/organise", get(organiser::phases))
        .route("/organise/phases/{phase}", get(organiser::phase).post(organiser::act_on_phase))
        .route("/organise/teams", get(organiser::teams).post(organiser::act_on_team))
        .route("/organise/runs", get(organiser::runs))
        .route("/organise/runs/{run}", get(organiser::run).post(organiser::act_on_run))
        .route("/organise/audit", get(audit))
        .route("/organise/health", get(health))
}

/// Form data for all management pages.
struct FormContext {
    /// The session's form key.
    key: String,
    /// Confirmation of the last action.
    message: Option<String>,
}

impl FormContext {
    fn new(management: &ManagementState, by: &SignedIn) -> Self {
        Self { key: by.form_key(), message: management.sessions.take_message(&by.id) }
    }
}

/// An organiser tab.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum OrganiserTab {
    Phases,
    Teams,
    Runs,
    Audit,
    Health,
}

impl OrganiserTab {
    const ALL: [Self; 5] = [Self::Phases, Self::Teams, Self::Runs, Self::Audit, Self::Health];

    fn name(self) -> &'static str {
        match self {
            Self::Phases => "Phases",
            Self::Teams => "Teams",
            Self::Runs => "Runs",
            Self::Audit => "Audit log",
            Self::Health => "Health",
        }
    }

    fn href(self) -> &'static str {
        match self {
            Self::Phases => "/organise",
            Self::Teams => "/organise/teams",
            Self::Runs => "/organise/runs",
            Self::Audit => "/organise/audit",
            Self::Health => "/organise/health",
        }
    }

    fn tabs(self) -> [(&'static str, &'static str, &'static str); 5] {
        Self::ALL.map(|tab| (tab.name(), tab.href(), if tab == self { "page" } else { "false" }))
    }

    fn shell(self, title: impl Into<String>) -> PageShell {
        let shell = PageShell::new(title, SiteSection::Own);
        if self == Self::Phases { shell } else { shell.below("Organise", Self::Phases.href()) }
    }
}

/// Stores the confirmation and redirects to a page, so that a reload does not repeat the action.
fn redirect_after(management: &ManagementState, by: &SignedIn, outcome: ActionOutcome, to: &str) -> Response {
    management.sessions.set_message(&by.id, outcome.message);
    Redirect::to(to).into_response()
}

/// The error for an action that a page does not support.
fn unknown_action(action: &str) -> RequestError {
    RequestError::Invalid(format!("unknown action '{action}'"))
}

#[derive(Template)]
#[template(path = "organise_health.html")]
struct HealthPage {
    shell: PageShell,
    form_context: FormContext,
    tab: OrganiserTab,
    health: ServerHealth,
    census: Census,
}

async fn health(
    Organiser(by): Organiser,
    context: RequestContext,
    Extension(management): Extension<Arc<ManagementState>>,
    _: StrictQuery<NoParameters>,
) -> Page {
    let tab = OrganiserTab::Health;
    render(&HealthPage {
        shell: tab.shell("Health"),
        form_context: FormContext::new(&management, &by),
        tab,
        health: management.actions.health(),
        census: context.reader.census().await?,
    })
}

impl HealthPage {
    fn scene_mib(&self) -> usize {
        self.health.scene_bytes >> 20
    }
}

#[derive(Template)]
#[template(path = "organise_audit.html")]
struct AuditPage {
    shell: PageShell,
    form_context: FormContext,
    tab: OrganiserTab,
    lines: Vec<AuditLine>,
    /// Last line on this page, if older lines exist.
    older_than: Option<i64>,
    is_newest: bool,
}

/// An audit log page: the lines before this line, or the newest.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct AuditQuery {
    before: Option<i64>,
}

async fn audit(
    Organiser(by): Organiser,
    context: RequestContext,
    Extension(management): Extension<Arc<ManagementState>>,
    StrictQuery(query): StrictQuery<AuditQuery>,
) -> Page {
    let mut lines = context.reader.audit(&Viewer::Organiser, query.before, AUDIT_LINES + 1).await?;
    let has_more = lines.len() > AUDIT_LINES as usize;
    lines.truncate(AUDIT_LINES as usize);
    let older_than = lines.last().map(|line| line.id).filter(|_| has_more);
    let tab = OrganiserTab::Audit;
    render(&AuditPage {
        shell: tab.shell("Audit log"),
        form_context: FormContext::new(&management, &by),
        tab,
        lines,
        older_than,
        is_newest: query.before.is_none(),
    })
}

impl AuditPage {
    fn range(&self) -> String {
        let id = |line: Option<&AuditLine>| line.map_or(0, |line| line.id);
        format!("Lines {} to {}", id(self.lines.first()), id(self.lines.last()))
    }
}
