//! REST API: JSON and CSV below `/api/v1`, described by `/api/v1/openapi.json`.

mod csv;
mod json;
mod openapi;

pub use json::SignedLogs;

use crate::live;
use avln_store::Reader;
use axum::{
    Router,
    http::header,
    response::IntoResponse,
    routing::{MethodRouter, get},
};

/// Address prefix.
const BASE: &str = "/api/v1";
/// Schema version; it changes if a field is removed or changes its meaning.
const SCHEMA_VERSION: u32 = 1;

/// A route with its description.
struct Endpoint {
    /// Path below [`BASE`].
    path: &'static str,
    summary: &'static str,
    /// Query parameter names.
    query: &'static [&'static str],
    answer: Answer,
    route: MethodRouter<Reader>,
}

/// Response format.
#[derive(Clone, Copy)]
enum Answer {
    /// A JSON object with this schema.
    Json(&'static str),
    /// A table.
    Csv,
    /// Plain text.
    Text,
    /// Server-Sent Events with this data schema.
    Events(&'static str),
}

const LEADERBOARD_QUERY: &[&str] = &["order", "sort", "pick", "q", "team", "rgb", "depth", "audio", "as_of"];
/// As [`LEADERBOARD_QUERY`], for all orders.
const ALL_ORDERS_QUERY: &[&str] = &["sort", "pick", "q", "team", "rgb", "depth", "audio", "as_of"];
const RUNS_QUERY: &[&str] = &["phase", "before", "limit"];

fn endpoint(
    path: &'static str,
    summary: &'static str,
    query: &'static [&'static str],
    answer: Answer,
    route: MethodRouter<Reader>,
) -> Endpoint {
    Endpoint { path, summary, query, answer, route }
}

fn endpoints() -> Vec<Endpoint> {
    of_phases().into_iter().chain(of_runs()).chain(of_episodes()).collect()
}

fn of_phases() -> Vec<Endpoint> {
    use Answer::{Csv, Json};
    vec![
        endpoint("/status", "Name, version and state of the server.", &[], Json("Status"), get(json::status)),
        endpoint("/phases", "All phases.", &[], Json("Phases"), get(json::phases)),
        endpoint("/phases/{phase}", "A phase with its rules.", &[], Json("PhaseAnswer"), get(json::phase)),
        endpoint(
            "/phases/{phase}/missions",
            "Statistics of a phase's missions, if its replays are public.",
            &[],
            Json("MissionsAnswer"),
            get(json::missions),
        ),
        endpoint(
            "/phases/{phase}/missions.csv",
            "The same statistics as a table.",
            &[],
            Csv,
            get(csv::missions),
        ),
        endpoint(
            "/phases/{phase}/leaderboard",
            "A leaderboard, best entry first. Entries of a tie_group do not differ significantly from its first entry; references have no rank.",
            LEADERBOARD_QUERY,
            Json("Leaderboard"),
            get(json::leaderboard),
        ),
        endpoint(
            "/phases/{phase}/leaderboard.json",
            "The same leaderboard with a file extension in its address.",
            LEADERBOARD_QUERY,
            Json("Leaderboard"),
            get(json::leaderboard),
        ),
        endpoint(
            "/phases/{phase}/leaderboard.csv",
            "The same leaderboard as a table.",
            LEADERBOARD_QUERY,
            Csv,
            get(csv::leaderboard),
        ),
        endpoint(
            "/phases/{phase}/leaderboards",
            "The leaderboards of all orders of a phase.",
            ALL_ORDERS_QUERY,
            Json("Leaderboards"),
            get(json::leaderboards),
        ),
        endpoint(
            "/phases/{phase}/leaderboards.csv",
            "The same leaderboards as one table.",
            ALL_ORDERS_QUERY,
            Csv,
            get(csv::leaderboards),
        ),
        endpoint(
            "/quota",
            "Remaining quota and charges of the token's team in each phase.",
            &[],
            Json("Quotas"),
            get(json::quota),
        ),
    ]
}

fn of_runs() -> Vec<Endpoint> {
    use Answer::{Csv, Events, Json, Text};
    vec![
        endpoint(
            "/compare",
            "Comparison of two runs of the same phase and order over their common episodes: first minus second.",
            &["first", "second"],
            Json("Compared"),
            get(json::compare),
        ),
        endpoint(
            "/compare.csv",
            "The common episodes as a table.",
            &["first", "second"],
            Csv,
            get(csv::compare),
        ),
        endpoint(
            "/runs",
            "Runs, newest first. Pass next as before to get the next page.",
            RUNS_QUERY,
            Json("Runs"),
            get(json::runs),
        ),
        endpoint(
            "/runs.csv",
            "The same runs as a table. Pass the last run as before to get the next page.",
            RUNS_QUERY,
            Csv,
            get(csv::runs),
        ),
        endpoint(
            "/runs/events",
            "Progress of all open runs: an event runs with all of them after each change, at most once per second.",
            &[],
            Events("LiveRuns"),
            get(live::runs),
        ),
        endpoint(
            "/runs/{run}/events",
            "Progress of a run: an event run with its state after each change, at most once per second, and a final one when it ends.",
            &[],
            Events("LiveRun"),
            get(live::run),
        ),
        endpoint("/runs/{run}", "A run with its episodes.", &[], Json("Run"), get(json::run)),
        endpoint(
            "/runs/{run}/log",
            "The signed log of a finished run, if the phase shows its replay. Check it with avln run verify.",
            &[],
            Text,
            get(json::log),
        ),
    ]
}

fn of_episodes() -> Vec<Endpoint> {
    use Answer::{Csv, Json};
    vec![
        endpoint(
            "/runs/{run}/episodes",
            "The episodes of a run in playing order.",
            &[],
            Json("Episodes"),
            get(json::episodes),
        ),
        endpoint("/runs/{run}/episodes.csv", "The same episodes as a table.", &[], Csv, get(csv::episodes)),
        endpoint(
            "/runs/{run}/episodes/{ordinal}",
            "An episode, with its replay if the phase shows it.",
            &[],
            Json("Episode"),
            get(json::episode),
        ),
        endpoint(
            "/runs/{run}/episodes/{ordinal}/steps.csv",
            "The steps of an episode as a table, if the phase shows its replay. Row 0 is before the first action.",
            &[],
            Csv,
            get(csv::steps),
        ),
        endpoint(
            "/runs/{run}/episodes/{ordinal}/levels.csv",
            "Sound levels of each step at both ears, if the phase shows the replay and the agent requested sound.",
            &[],
            Csv,
            get(csv::levels),
        ),
    ]
}

pub(crate) fn router() -> Router<Reader> {
    let endpoints = endpoints();
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
