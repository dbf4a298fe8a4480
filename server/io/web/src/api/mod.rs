//! REST API: JSON and CSV below `/api/v1`, described by `/api/v1/openapi.json`.

mod csv;
mod json;
mod openapi;

pub use json::SignedLogs;

use crate::live;
use avln_store::{CompareView, EpisodeView, LeaderboardView, Reader, RunList, RunView};
use axum::{
    Router,
    http::header,
    response::IntoResponse,
    routing::{MethodRouter, get},
};
use openapi::Body;
use utoipa::ToSchema;

const BASE: &str = "/api/v1";
/// Schema version; it changes if a field is removed or gets another meaning.
const SCHEMA_VERSION: u32 = 1;

const LEADERBOARD_QUERY: &[&str] =
    &["order", "sort", "pick", "q", "team", "type", "rgb", "depth", "audio", "as_of"];
const ALL_ORDERS_QUERY: &[&str] = &["sort", "pick", "q", "team", "type", "rgb", "depth", "audio", "as_of"];
const RUNS_QUERY: &[&str] = &["phase", "before", "limit"];
const COMPARE_QUERY: &[&str] = &["first", "second"];

struct Endpoint {
    /// Path below [`BASE`].
    path: &'static str,
    route: MethodRouter<Reader>,
    body: Body,
    summary: &'static str,
    query: &'static [&'static str],
}

impl Endpoint {
    fn new(path: &'static str, route: MethodRouter<Reader>, body: Body) -> Self {
        Self { path, route, body, summary: "", query: &[] }
    }

    fn json<T: ToSchema>(path: &'static str, route: MethodRouter<Reader>) -> Self {
        Self::new(path, route, Body::versioned::<T>())
    }

    fn csv(path: &'static str, route: MethodRouter<Reader>) -> Self {
        Self::new(path, route, Body::text("text/csv"))
    }

    /// Server-Sent Events. OpenAPI 3.1 describes the data of an event.
    fn events<T: ToSchema>(path: &'static str, route: MethodRouter<Reader>) -> Self {
        Self::new(path, route, Body::of::<T>("text/event-stream"))
    }

    fn about(self, summary: &'static str) -> Self {
        Self { summary, ..self }
    }

    fn query(self, query: &'static [&'static str]) -> Self {
        Self { query, ..self }
    }
}

fn phase_endpoints() -> Vec<Endpoint> {
    let leaderboard =
        |path| Endpoint::json::<LeaderboardView>(path, get(json::leaderboard)).query(LEADERBOARD_QUERY);
    vec![
        Endpoint::json::<json::Status>("/status", get(json::status))
            .about("Name, version and state of the server."),
        Endpoint::json::<json::Phases>("/phases", get(json::phases)).about("All phases."),
        Endpoint::json::<json::Phase>("/phases/{phase}", get(json::phase)).about("A phase with its rules."),
        Endpoint::json::<json::Missions>("/phases/{phase}/missions", get(json::missions))
            .about("Statistics of a phase's missions, if its replays are public."),
        Endpoint::csv("/phases/{phase}/missions.csv", get(csv::missions))
            .about("The same statistics as a table."),
        leaderboard("/phases/{phase}/leaderboard").about(
            "A leaderboard, best entry first. Entries of a tie_group do not differ significantly from its first entry; references have no rank.",
        ),
        leaderboard("/phases/{phase}/leaderboard.json")
            .about("The same leaderboard with a file extension in its address."),
        Endpoint::csv("/phases/{phase}/leaderboard.csv", get(csv::leaderboard))
            .query(LEADERBOARD_QUERY)
            .about("The same leaderboard as a table."),
        Endpoint::json::<json::Leaderboards>("/phases/{phase}/leaderboards", get(json::leaderboards))
            .query(ALL_ORDERS_QUERY)
            .about("The leaderboards of all orders of a phase."),
        Endpoint::csv("/phases/{phase}/leaderboards.csv", get(csv::leaderboards))
            .query(ALL_ORDERS_QUERY)
            .about("The same leaderboards as one table."),
        Endpoint::json::<json::Quotas>("/quota", get(json::quota))
            .about("Remaining quota and charges of the token's team in each phase."),
    ]
}

fn run_endpoints() -> Vec<Endpoint> {
    vec![
        Endpoint::json::<CompareView>("/compare", get(json::compare)).query(COMPARE_QUERY).about(
            "Comparison of two runs of the same phase and order over their common episodes: first minus second.",
        ),
        Endpoint::csv("/compare.csv", get(csv::compare))
            .query(COMPARE_QUERY)
            .about("The common episodes as a table."),
        Endpoint::json::<RunList>("/runs", get(json::runs))
            .query(RUNS_QUERY)
            .about(
                "Runs, newest first; cancelled runs only for their team and the organiser. Pass next as before to get the next page.",
            ),
        Endpoint::csv("/runs.csv", get(csv::runs))
            .query(RUNS_QUERY)
            .about("The same runs as a table. Pass the last run as before to get the next page."),
        Endpoint::events::<live::LiveRunsJson>("/runs/events", get(live::runs)).about(
            "Progress of all open runs: an event runs with all of them after each change, at most once per second.",
        ),
        Endpoint::events::<live::LiveRunJson>("/runs/{run}/events", get(live::run)).about(
            "Progress of a run: an event run with its state after each change, at most once per second, and a final one when it ends.",
        ),
        Endpoint::json::<RunView>("/runs/{run}", get(json::run)).about("A run with its episodes."),
        Endpoint::new("/runs/{run}/log", get(json::log), Body::text("text/plain")).about(
            "The signed log of a finished run, if the phase shows its replay. Check it with avln run verify.",
        ),
        Endpoint::json::<json::Episodes>("/runs/{run}/episodes", get(json::episodes))
            .about("The episodes of a run in playing order."),
        Endpoint::csv("/runs/{run}/episodes.csv", get(csv::episodes)).about("The same episodes as a table."),
        Endpoint::json::<EpisodeView>("/runs/{run}/episodes/{ordinal}", get(json::episode))
            .about("An episode, with its replay if the phase shows it."),
        Endpoint::csv("/runs/{run}/episodes/{ordinal}/steps.csv", get(csv::steps)).about(
            "The steps of an episode as a table, if the phase shows its replay. Row 0 is before the first action.",
        ),
        Endpoint::csv("/runs/{run}/episodes/{ordinal}/levels.csv", get(csv::levels)).about(
            "Sound levels of each step at both ears, if the phase shows the replay and the agent requested sound.",
        ),
    ]
}

pub(crate) fn router() -> Router<Reader> {
    let endpoints: Vec<Endpoint> = phase_endpoints().into_iter().chain(run_endpoints()).collect();
    let document = openapi::document(&endpoints).to_string();
    let router = Router::new().route(
        &format!("{BASE}/openapi.json"),
        get(async move || ([(header::CONTENT_TYPE, "application/json")], document).into_response()),
    );
    let add = |router: Router<Reader>, endpoint: Endpoint| {
        router.route(&format!("{BASE}{}", endpoint.path), endpoint.route)
    };
    endpoints.into_iter().fold(router, add)
}
