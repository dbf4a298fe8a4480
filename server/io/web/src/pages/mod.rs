//! Pages for people: plain HTML, which works without its one script.

mod badge;
mod board;
mod compare;
mod docs;
mod episode;
mod home;
mod missions;
mod office;
mod phase;
mod runs;

pub(crate) use office::router as office_router;

use crate::{office::Menu, trouble::Trouble, visit::Visit};
use askama::Template;
use avln_store::Reader;
use axum::{
    Router,
    http::header,
    response::{Html, IntoResponse},
    routing::get,
};

/// Version that the foot of every page tells.
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Where the pages are.
pub(crate) fn router() -> Router<Reader> {
    Router::new()
        .route("/", get(home::home))
        .route("/docs", get(docs::index))
        .route("/docs/{*document}", get(docs::document))
        .route("/leaderboard", get(home::boards))
        .route("/leaderboard/{phase}", get(board::page))
        .route("/phases/{phase}", get(phase::page))
        .route("/phases/{phase}/scenes/{file}", get(missions::scene))
        .route("/compare", get(compare::page))
        .route("/runs", get(runs::list))
        .route("/runs/{run}", get(runs::one))
        .route("/runs/{run}/badge.svg", get(badge::badge))
        .route("/embed/{phase}", get(board::embedded))
        .route("/runs/{run}/episodes/{ordinal}", get(episode::page))
        .route("/runs/{run}/episodes/{ordinal}/eyes/{file}", get(crate::onlooker::picture))
        .route("/runs/{run}/episodes/{ordinal}/ears/{file}", get(crate::onlooker::sound))
        .route(
            "/assets/app.css",
            get(async || asset("text/css; charset=utf-8", include_str!("../../assets/app.css"))),
        )
        .route(
            "/assets/replay.js",
            get(async || asset("text/javascript; charset=utf-8", include_str!("../../assets/replay.js"))),
        )
        .route(
            "/assets/ears.js",
            get(async || asset("text/javascript; charset=utf-8", include_str!("../../assets/ears.js"))),
        )
        .route(
            "/assets/live.js",
            get(async || asset("text/javascript; charset=utf-8", include_str!("../../assets/live.js"))),
        )
        .route(
            "/assets/icon.svg",
            get(async || asset("image/svg+xml", include_str!("../../assets/icon.svg"))),
        )
}

fn asset(kind: &'static str, text: &'static str) -> impl IntoResponse {
    ([(header::CONTENT_TYPE, kind), (header::CACHE_CONTROL, "public, max-age=300")], text)
}

/// A page, or why there is none.
type Page = Result<Html<String>, Trouble>;

fn write(page: &impl Template) -> Page {
    Ok(Html(page.render()?))
}

/// What stands around the content of every page.
#[derive(Debug)]
struct Shell {
    /// Heading of the page and of its tab.
    title: String,
    /// The pages above this one, the highest first, without the first page.
    trail: Vec<Crumb>,
    /// Which part of the site this is.
    part: Part,
    /// What the organiser announces; empty: nothing.
    notice: String,
    /// What the menu offers this visitor.
    menu: Menu,
}

#[derive(Debug)]
struct Crumb {
    name: String,
    href: String,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Home,
    Boards,
    Runs,
    Docs,
    /// What visitors see of themselves when they sign in.
    Own,
    Elsewhere,
}

impl Shell {
    fn new(title: impl Into<String>, part: Part) -> Self {
        Self {
            title: title.into(),
            trail: vec![],
            part,
            notice: crate::notice::notice(),
            menu: Menu::current(),
        }
    }

    /// Adds the next page above this one.
    fn below(mut self, name: impl Into<String>, href: impl Into<String>) -> Self {
        self.trail.push(Crumb { name: name.into(), href: href.into() });
        self
    }

    /// `page` where `part` is shown; the value of `aria-current` in the menu.
    fn current(&self, part: &Part) -> &'static str {
        if self.part == *part { "page" } else { "false" }
    }
}

#[derive(Template)]
#[template(path = "trouble.html")]
struct TroublePage {
    shell: Shell,
    words: String,
    /// Whether the visitor was about to sign in.
    is_signing_in: bool,
}

/// A page for what went wrong.
pub(crate) fn trouble(trouble: &Trouble) -> String {
    let words = format!("Sorry, {trouble}.");
    let is_signing_in = matches!(trouble, Trouble::WrongToken | Trouble::Attempts);
    let shell = Shell::new(trouble.title(), Part::Elsewhere);
    let page = TroublePage { shell, words, is_signing_in };
    page.render().unwrap_or_else(|_| trouble.title().to_owned())
}

/// A segment of an address.
pub(crate) fn segment(text: &str) -> String {
    askama::filters::urlencode_strict(text).map(|encoded| encoded.to_string()).unwrap_or_default()
}

/// The phase called `id`.
async fn phase(visit: &Visit, id: &str) -> Result<avln_store::PhaseView, Trouble> {
    let found = visit.reader.phase(&visit.viewer, id, visit.now_unix_ms).await?;
    found.ok_or_else(|| Trouble::Unknown { what: "phase", name: id.to_owned() })
}
