//! HTML pages. They work without their scripts.

mod docs;
mod episode;
mod home;
mod leaderboard;
mod management;
mod phase;
mod runs;

pub(crate) use management::router as management_router;

use crate::{error::RequestError, replay_renderer, request::RequestContext};
use askama::Template;
use avln_store::Reader;
use axum::{
    Router,
    http::header,
    response::{Html, IntoResponse},
    routing::get,
};
use std::future::Future;

/// Version in the footer.
const VERSION: &str = env!("CARGO_PKG_VERSION");

pub(crate) fn router() -> Router<Reader> {
    Router::new()
        .route("/", get(home::home))
        .route("/docs", get(docs::index))
        .route("/docs/{*document}", get(docs::document))
        .route("/leaderboard", get(home::leaderboards))
        .route("/leaderboard/{phase}", get(leaderboard::page))
        .route("/phases/{phase}", get(phase::page))
        .route("/phases/{phase}/scenes/{file}", get(phase::scene))
        .route("/compare", get(runs::compare))
        .route("/runs", get(runs::list))
        .route("/runs/{run}", get(runs::one))
        .route("/runs/{run}/badge.svg", get(runs::badge))
        .route("/embed/{phase}", get(leaderboard::embedded))
        .route("/runs/{run}/episodes/{ordinal}", get(episode::page))
        .route("/runs/{run}/episodes/{ordinal}/eyes/{file}", get(replay_renderer::picture))
        .route("/runs/{run}/episodes/{ordinal}/ears/{file}", get(replay_renderer::sound))
        .route("/assets/app.css", get(async || asset("text/css", include_str!("../../assets/app.css"))))
        .route("/assets/replay.js", get(async || script(include_str!("../../assets/replay.js"))))
        .route("/assets/sound.js", get(async || script(include_str!("../../assets/sound.js"))))
        .route("/assets/live.js", get(async || script(include_str!("../../assets/live.js"))))
        .route(
            "/assets/icon.svg",
            get(async || asset("image/svg+xml", include_str!("../../assets/icon.svg"))),
        )
}

fn script(text: &'static str) -> impl IntoResponse {
    asset("text/javascript", text)
}

fn asset(kind: &'static str, text: &'static str) -> impl IntoResponse {
    let kind = format!("{kind}; charset=utf-8");
    ([(header::CONTENT_TYPE, kind), (header::CACHE_CONTROL, "public, max-age=300".to_owned())], text)
}

/// A rendered page.
type Page = Result<Html<String>, RequestError>;

fn render(page: &impl Template) -> Page {
    Ok(Html(page.render()?))
}

tokio::task_local! {
    // A task-local, because every page needs it and handlers have nothing else to do with it.
    static CONTEXT: PageContext;
}

/// Parts of the page frame that depend on the visitor and the running arena.
#[derive(Clone, Debug, Default)]
pub(crate) struct PageContext {
    pub(crate) menu: Menu,
    /// The organiser's announcement; may be empty.
    pub(crate) announcement: String,
}

impl PageContext {
    pub(crate) fn current() -> Self {
        CONTEXT.try_with(Self::clone).unwrap_or_default()
    }

    pub(crate) async fn scope<T>(self, handler: impl Future<Output = T>) -> T {
        CONTEXT.scope(self, handler).await
    }

    pub(crate) fn sync_scope<T>(self, render: impl FnOnce() -> T) -> T {
        CONTEXT.sync_scope(self, render)
    }
}

/// The menu entry that depends on the visitor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Menu {
    /// No entry: this server has no sign-in.
    #[default]
    Plain,
    /// Sign-in.
    Stranger,
    /// The visitor's team page.
    Team,
    /// The organiser's pages.
    Organiser,
}

impl Menu {
    pub(crate) fn link(self) -> Option<(&'static str, &'static str)> {
        match self {
            Self::Plain => None,
            Self::Stranger => Some(("/sign-in", "Sign in")),
            Self::Team => Some(("/me", "My page")),
            Self::Organiser => Some(("/organise", "Organise")),
        }
    }
}

#[derive(Debug)]
struct PageShell {
    /// Page heading and browser tab title.
    title: String,
    /// Pages above this one, the highest first, without the home page.
    trail: Vec<Breadcrumb>,
    section: SiteSection,
    context: PageContext,
}

#[derive(Debug)]
struct Breadcrumb {
    name: String,
    href: String,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SiteSection {
    Home,
    Leaderboards,
    Runs,
    Docs,
    /// Pages for visitors who sign in.
    Own,
    Elsewhere,
}

impl PageShell {
    fn new(title: impl Into<String>, section: SiteSection) -> Self {
        Self { title: title.into(), trail: vec![], section, context: PageContext::current() }
    }

    /// Appends a page to the trail.
    fn below(mut self, name: impl Into<String>, href: impl Into<String>) -> Self {
        self.trail.push(Breadcrumb { name: name.into(), href: href.into() });
        self
    }

    fn current(&self, section: &SiteSection) -> &'static str {
        if self.section == *section { "page" } else { "false" }
    }
}

#[derive(Template)]
#[template(path = "error.html")]
struct ErrorPage {
    shell: PageShell,
    message: String,
    /// True if the visitor tried to sign in.
    is_signing_in: bool,
}

pub(crate) fn error_page(error: &RequestError) -> String {
    let page = ErrorPage {
        shell: PageShell::new(error.title(), SiteSection::Elsewhere),
        message: format!("Sorry, {error}."),
        is_signing_in: matches!(error, RequestError::WrongToken | RequestError::Attempts),
    };
    page.render().unwrap_or_else(|_| error.title().to_owned())
}

/// Reads a phase.
async fn find_phase(context: &RequestContext, id: &str) -> Result<avln_store::PhaseView, RequestError> {
    let found = context.reader.phase(&context.viewer, id, context.now_unix_ms).await?;
    found.ok_or_else(|| RequestError::Unknown { what: "phase", name: id.to_owned() })
}
