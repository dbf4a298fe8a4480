//! The same facts for programs: JSON and CSV below `/api/v1`, described by `/api/v1/openapi.json`.

mod answers;
mod csv;
mod openapi;

pub(crate) use answers::name_moments;

use crate::{live, logs};
use avln_store::Reader;
use axum::{
    Router,
    http::header,
    response::IntoResponse,
    routing::{MethodRouter, get},
};

/// Where the API begins.
const BASE: &str = "/api/v1";
/// Changes when a field loses its meaning or leaves.
const SCHEMA_VERSION: u32 = 1;

/// A way into the API, with what its description says of it.
struct Endpoint {
    /// Path below [`BASE`].
    path: &'static str,
    /// One sentence.
    summary: &'static str,
    /// Names of the parameters in the query.
    query: &'static [&'static str],
    answer: Answer,
    route: MethodRouter<Reader>,
}

/// What comes back.
#[derive(Clone, Copy)]
enum Answer {
    /// A JSON object: the name of its schema.
    Json(&'static str),
    /// A table.
    Csv,
    /// Lines of text.
    Text,
    /// Server-Sent Events: the name of the schema of their data.
    Events(&'static str),
}

const BOARD_QUERY: &[&str] = &["order", "sort", "pick", "q", "team", "rgb", "depth", "audio", "as_of"];
/// The same for boards in all orders.
const BOARDS_QUERY: &[&str] = &["sort", "pick", "q", "team", "rgb", "depth", "audio", "as_of"];
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

/// Ways to the server, phases and what stands on their boards.
fn of_phases() -> Vec<Endpoint> {
    use Answer::{Csv, Json};
    vec![
        endpoint(
            "/status",
            "Whether the server answers, and what it is.",
            &[],
            Json("Status"),
            get(answers::status),
        ),
        endpoint("/phases", "All phases.", &[], Json("Phases"), get(answers::phases)),
        endpoint("/phases/{phase}", "A phase with its rules.", &[], Json("PhaseAnswer"), get(answers::phase)),
        endpoint(
            "/phases/{phase}/missions",
            "What the missions of a phase are like, all together, where everybody may see its replays.",
            &[],
            Json("MissionsAnswer"),
            get(answers::missions),
        ),
        endpoint("/phases/{phase}/missions.csv", "The same counts as a table.", &[], Csv, get(csv::missions)),
        endpoint(
            "/phases/{phase}/leaderboard",
            "A leaderboard, best first. Entries of one tie_group cannot be told apart from its first; references have no rank.",
            BOARD_QUERY,
            Json("Leaderboard"),
            get(answers::leaderboard),
        ),
        endpoint(
            "/phases/{phase}/leaderboard.json",
            "The same leaderboard under the name of a file.",
            BOARD_QUERY,
            Json("Leaderboard"),
            get(answers::leaderboard),
        ),
        endpoint(
            "/phases/{phase}/leaderboard.csv",
            "The same leaderboard as a table.",
            BOARD_QUERY,
            Csv,
            get(csv::leaderboard),
        ),
        endpoint(
            "/phases/{phase}/leaderboards",
            "The leaderboards of a phase for goals in each order.",
            BOARDS_QUERY,
            Json("Leaderboards"),
            get(answers::leaderboards),
        ),
        endpoint(
            "/phases/{phase}/leaderboards.csv",
            "The same leaderboards as one table.",
            BOARDS_QUERY,
            Csv,
            get(csv::leaderboards),
        ),
        endpoint(
            "/quota",
            "What the team of the token has left in each phase, and what was charged.",
            &[],
            Json("Quotas"),
            get(answers::quota),
        ),
    ]
}

/// Ways to runs.
fn of_runs() -> Vec<Endpoint> {
    use Answer::{Csv, Events, Json, Text};
    vec![
        endpoint(
            "/compare",
            "Two runs of one phase and order, over the episodes that both played: the first less the second.",
            &["first", "second"],
            Json("Compared"),
            get(answers::compare),
        ),
        endpoint(
            "/compare.csv",
            "The episodes that both played as a table.",
            &["first", "second"],
            Csv,
            get(csv::compare),
        ),
        endpoint(
            "/runs",
            "Runs, the newest first; next, as before, asks for those that follow.",
            RUNS_QUERY,
            Json("Runs"),
            get(answers::runs),
        ),
        endpoint(
            "/runs.csv",
            "The same runs as a table; its last run, as before, asks for those that follow.",
            RUNS_QUERY,
            Csv,
            get(csv::runs),
        ),
        endpoint(
            "/runs/events",
            "How the runs go on that are under way: an event runs with all of them whenever one changes, once a second at most.",
            &[],
            Events("LiveRuns"),
            get(live::runs),
        ),
        endpoint(
            "/runs/{run}/events",
            "How a run goes on: an event run with all of it whenever it changes, once a second at most, and a last one at its end.",
            &[],
            Events("LiveRun"),
            get(live::run),
        ),
        endpoint("/runs/{run}", "A run with its episodes.", &[], Json("Run"), get(answers::run)),
        endpoint(
            "/runs/{run}/log",
            "The signed log of a run that is over, where the phase shows its replay: avln run verify checks it.",
            &[],
            Text,
            get(logs::log),
        ),
    ]
}

/// Ways to the episodes of runs.
fn of_episodes() -> Vec<Endpoint> {
    use Answer::{Csv, Json};
    vec![
        endpoint(
            "/runs/{run}/episodes",
            "The episodes of a run in playing order.",
            &[],
            Json("Episodes"),
            get(answers::episodes),
        ),
        endpoint("/runs/{run}/episodes.csv", "The same episodes as a table.", &[], Csv, get(csv::episodes)),
        endpoint(
            "/runs/{run}/episodes/{ordinal}",
            "One episode; with its replay where the phase shows it.",
            &[],
            Json("Episode"),
            get(answers::episode),
        ),
        endpoint(
            "/runs/{run}/episodes/{ordinal}/steps.csv",
            "The steps of an episode as a table, where the phase shows its replay; row 0 is before the first action.",
            &[],
            Csv,
            get(csv::steps),
        ),
        endpoint(
            "/runs/{run}/episodes/{ordinal}/levels.csv",
            "How loud each step was at both ears, where the phase shows the replay of an agent that asked for sound.",
            &[],
            Csv,
            get(csv::levels),
        ),
    ]
}

/// Where the answers are.
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
