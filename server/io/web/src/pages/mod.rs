//! HTML pages and their routes: home, list of leaderboards, errors, instructions and documents here, others in modules. The pages
//! work without their scripts.

mod leaderboard;
mod management;
mod phase;
mod runs;

use crate::{
    documents::{Document, DocumentGroup, Documents, FoundDocument},
    error::{RequestError, Result},
    format,
    leaderboard::LeaderboardParams,
    management::{ActionOutcome, ManagementState, SignedIn},
    replay_renderer,
    request::{DocsQuery, GrpcAddress, NoParameters, PageContext, PathOnly, RequestContext, StrictQuery},
};
use askama::Template;
use avln_scoring::Key;
use avln_store::{LeaderboardView, PhaseState, PhaseView, Reader};
use axum::{
    Extension, Router,
    http::header,
    response::{Html, IntoResponse, Redirect, Response},
    routing::{get, post},
};

const VERSION: &str = env!("CARGO_PKG_VERSION");

pub(crate) fn router() -> Router<Reader> {
    Router::new()
        .route("/", get(home))
        .route("/docs", get(docs))
        .route("/docs/images/{file}", get(chart))
        .route("/docs/{*document}", get(document))
        .route("/leaderboard", get(leaderboards))
        .route("/leaderboard/{phase}", get(leaderboard::page))
        .route("/phases/{phase}", get(phase::page))
        .route("/phases/{phase}/scenes/{file}", get(phase::scene))
        .route("/compare", get(runs::compare))
        .route("/runs", get(runs::list))
        .route("/runs/{run}", get(runs::one))
        .route("/runs/{run}/badge.svg", get(runs::badge))
        .route("/embed/{phase}", get(leaderboard::embedded))
        .route("/runs/{run}/episodes/{ordinal}", get(runs::episode))
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

pub(crate) fn management_router() -> Router<Reader> {
    Router::new()
        .route("/sign-in", get(management::sign_in_page).post(management::sign_in))
        .route("/sign-out", post(management::sign_out).get(async || Redirect::to("/sign-in")))
        .route("/me", get(management::team).post(management::act_as_team))
        .route("/organise", get(management::phases))
        .route("/organise/phases/{phase}", get(management::phase).post(management::act_on_phase))
        .route("/organise/teams", get(management::teams).post(management::act_on_team))
        .route("/organise/runs", get(management::runs))
        .route("/organise/runs/{run}", get(management::run).post(management::act_on_run))
        .route("/organise/audit", get(management::audit))
        .route("/organise/health", get(management::health))
}

fn script(text: &'static str) -> impl IntoResponse {
    asset("text/javascript", text)
}

fn asset(kind: &'static str, text: &'static str) -> impl IntoResponse {
    let kind = format!("{kind}; charset=utf-8");
    ([(header::CONTENT_TYPE, kind), (header::CACHE_CONTROL, "public, max-age=300".to_owned())], text)
}

type Page = Result<Html<String>>;

fn render(page: &impl Template) -> Page {
    Ok(Html(page.render()?))
}

#[derive(Debug)]
struct PageShell {
    /// Page heading and browser tab title.
    title: String,
    /// Pages above this one, the highest first, without the home page.
    trail: Vec<Breadcrumb>,
    section: SiteSection,
    context: PageContext,
    form: FormContext,
    /// The organiser's tab; empty on other pages.
    tab: &'static str,
}

#[derive(Debug, Default)]
struct FormContext {
    key: String,
    message: Option<String>,
}

impl FormContext {
    fn new(management: &ManagementState, by: &SignedIn) -> Self {
        Self { key: by.form_key(), message: management.sessions.take_message(&by.id) }
    }
}

// Stores the confirmation and redirects to a page, so that a reload does not repeat the action.
fn redirect_after(management: &ManagementState, by: &SignedIn, outcome: ActionOutcome, to: &str) -> Response {
    management.sessions.set_message(&by.id, outcome.message);
    Redirect::to(to).into_response()
}

fn unknown_action(action: &str) -> RequestError {
    RequestError::Invalid(format!("unknown action '{action}'"))
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
    Own,
    Elsewhere,
}

impl PageShell {
    fn new(title: impl Into<String>, section: SiteSection) -> Self {
        let (context, form) = (PageContext::current(), FormContext::default());
        Self { title: title.into(), trail: vec![], section, context, form, tab: "" }
    }

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
    is_signing_in: bool,
    request_id: String,
}

pub(crate) fn error_page(error: &RequestError, request_id: &str) -> String {
    let page = ErrorPage {
        shell: PageShell::new(error.class().title, SiteSection::Elsewhere),
        message: format!("Sorry, {error}."),
        is_signing_in: matches!(error, RequestError::WrongToken | RequestError::Attempts),
        request_id: request_id.to_owned(),
    };
    page.render().unwrap_or_else(|_| error.class().title.to_owned())
}

const TOP_ENTRIES: usize = 3;

#[derive(Template)]
#[template(path = "home.html")]
struct HomePage {
    shell: PageShell,
    phases: Vec<PhaseView>,
    grpc_address: GrpcAddress,
    /// Id of an open phase for the commands; `None` if there is nothing to play.
    example: Option<String>,
    leaderboards: Vec<LeaderboardView>,
    columns: [Key; 4],
}

#[derive(Template)]
#[template(path = "leaderboard_index.html")]
struct LeaderboardIndexPage {
    shell: PageShell,
    phases: Vec<PhaseView>,
}

async fn home(context: RequestContext, grpc_address: GrpcAddress, _: StrictQuery<NoParameters>) -> Page {
    let phases = context.reader.phases(&context.viewer, context.now_unix_ms).await?;
    let mut leaderboards = Vec::new();
    for phase in &phases {
        leaderboards.extend(LeaderboardParams::default().read_all(&context, phase).await?);
    }
    leaderboards.retain(|leaderboard| !leaderboard.rows.is_empty());
    leaderboards.iter_mut().for_each(|leaderboard| leaderboard.rows.truncate(TOP_ENTRIES));
    let shell = PageShell::new("LH-AVLN Arena", SiteSection::Home);
    let example = phases.iter().find(|phase| phase.state == PhaseState::Open);
    let example = example.filter(|_| !shell.context.is_frozen()).map(|phase| phase.id.clone());
    render(&HomePage {
        shell,
        phases,
        grpc_address,
        example,
        leaderboards,
        columns: [Key::Sr, Key::Isr, Key::Spl, Key::SoftSpl],
    })
}

async fn leaderboards(context: RequestContext, _: StrictQuery<NoParameters>) -> Page {
    let phases = context.reader.phases(&context.viewer, context.now_unix_ms).await?;
    let shell = PageShell::new("Leaderboards", SiteSection::Leaderboards);
    render(&LeaderboardIndexPage { shell, phases })
}

const DOCS_TITLE: &str = "How to take part";

#[derive(Template)]
#[template(path = "docs.html")]
struct DocsPage<'a> {
    shell: PageShell,
    grpc_address: GrpcAddress,
    keys: [Key; 10],
    query: DocsQuery,
    groups: &'a [DocumentGroup],
}

#[derive(Template)]
#[template(path = "docs_search.html")]
struct DocsSearchPage<'a> {
    shell: PageShell,
    query: DocsQuery,
    results: Vec<FoundDocument<'a>>,
}

#[derive(Template)]
#[template(path = "document.html")]
struct DocumentPage<'a> {
    shell: PageShell,
    document: &'a Document,
}

async fn docs(
    grpc_address: GrpcAddress,
    Extension(documents): Extension<Documents>,
    StrictQuery(query): StrictQuery<DocsQuery>,
) -> Page {
    let words = query.words()?;
    if !words.is_empty() {
        let shell = below_docs("Search in the documents");
        return render(&DocsSearchPage { shell, query, results: documents.search(&words) });
    }
    let shell = PageShell::new(DOCS_TITLE, SiteSection::Docs);
    render(&DocsPage { shell, grpc_address, keys: Key::ALL, query, groups: documents.groups() })
}

async fn document(PathOnly(slug): PathOnly<String>, Extension(documents): Extension<Documents>) -> Page {
    let document = documents.find(&slug).ok_or_else(|| RequestError::unknown("document", slug))?;
    render(&DocumentPage { shell: below_docs(&document.title), document })
}

async fn chart(
    PathOnly(file): PathOnly<String>,
    Extension(documents): Extension<Documents>,
) -> Result<Response> {
    let svg = documents.chart(&file).ok_or_else(|| RequestError::unknown("chart", &file))?;
    Ok(([(header::CONTENT_TYPE, "image/svg+xml; charset=utf-8")], svg.to_owned()).into_response())
}

fn below_docs(title: &str) -> PageShell {
    PageShell::new(title, SiteSection::Docs).below(DOCS_TITLE, "/docs")
}
