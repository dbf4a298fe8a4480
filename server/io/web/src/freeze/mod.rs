//! What anybody sees of phases, as files that need no server: links lead from file to file, and nothing is loaded from elsewhere.

mod links;

use crate::{Site, router};
use avln_store::{PhaseView, Reader, RunLine, StoreError, Viewer, Visibility};
use axum::{
    Router,
    body::{Body, to_bytes},
    http::{Request, StatusCode, header},
};
use links::{file_of, rewritten};
use std::{
    collections::{BTreeMap, BTreeSet, VecDeque},
    io,
};
use tower::ServiceExt;

/// Why a copy could not be made.
#[derive(Debug, thiserror::Error)]
pub enum FreezeError {
    /// Anybody sees no phase of this name.
    #[error("there is no phase '{0}' that everybody may see")]
    NoPhase(String),
    /// The database failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A page that was linked to could not be had.
    #[error("{address} answered {status}")]
    Page {
        /// Where it is.
        address: String,
        /// What came instead.
        status: StatusCode,
    },
    /// Two addresses would be one file.
    #[error("{first} and {second} would be one file")]
    Clash {
        /// The address that was written.
        first: String,
        /// The other one.
        second: String,
    },
    /// A file could not be written.
    #[error("cannot write {file}: {error}")]
    File {
        /// Its name.
        file: String,
        /// Why.
        error: io::Error,
    },
}

/// What belongs to a copy.
struct Scope {
    phases: BTreeMap<String, PhaseView>,
    runs: BTreeMap<String, RunLine>,
    /// The address of the first page.
    first: String,
    /// The address of the list of runs.
    list: String,
}

/// Hands the files of a copy to `keep`, by their names, and tells how many there are: all that anybody sees of `phase`, or of all
/// phases, at `now_unix_ms`.
///
/// # Errors
/// When there is no such phase, the database fails or a file cannot be kept.
pub async fn freeze(
    reader: &Reader,
    phase: Option<&str>,
    now_unix_ms: i64,
    keep: &mut (dyn FnMut(&str, &[u8]) -> io::Result<()> + Send),
) -> Result<usize, FreezeError> {
    let scope = Scope::read(reader, phase, now_unix_ms).await?;
    let door = router(reader.clone(), Site { agents_port: AGENTS_PORT, ..Site::default() });
    let mut written: BTreeMap<String, String> = BTreeMap::new();
    let mut seen: BTreeSet<String> = scope.roots().collect();
    let mut next: VecDeque<String> = scope.roots().collect();
    while let Some(address) = next.pop_front() {
        let file = scope.file(&address);
        let (is_page, bytes) = ask(&door, &address).await?;
        let bytes = if is_page { page(&scope, &file, &bytes, &mut seen, &mut next) } else { bytes };
        if let Some(first) = written.insert(file.clone(), address.clone()) {
            return Err(FreezeError::Clash { first, second: address });
        }
        keep(&file, &bytes).map_err(|error| FreezeError::File { file, error })?;
    }
    Ok(written.len())
}

/// The port that pages tell people who take part; a copy has no door of its own.
const AGENTS_PORT: u16 = 50051;

/// A page with links to files; what it links to and nobody has seen yet is asked for next.
fn page(
    scope: &Scope,
    file: &str,
    bytes: &[u8],
    seen: &mut BTreeSet<String>,
    next: &mut VecDeque<String>,
) -> Vec<u8> {
    let html = String::from_utf8_lossy(bytes).replacen("<html ", "<html class=\"frozen\" ", 1);
    let mut to_file = |link: &str| {
        let (link, moment) = without_moment(link);
        let address = scope.within(link)?;
        if seen.insert(address.clone()) {
            next.push_back(address.clone());
        }
        Some(links::relative(file, &scope.file(&address)) + moment)
    };
    rewritten(&html, &mut to_file).into_bytes()
}

/// A link to a replay, and which moment of it, which the script of the page finds in the address.
fn without_moment(link: &str) -> (&str, &str) {
    match link.find('?') {
        Some(at) if link.contains("/episodes/") => link.split_at(at),
        _ => (link, ""),
    }
}

async fn ask(door: &Router, address: &str) -> Result<(bool, Vec<u8>), FreezeError> {
    let failed = |status| FreezeError::Page { address: address.to_owned(), status };
    let request = Request::get(address).body(Body::empty());
    let request = request.map_err(|_| failed(StatusCode::BAD_REQUEST))?;
    let answer = match door.clone().oneshot(request).await {
        Ok(answer) => answer,
        Err(never) => match never {},
    };
    if answer.status() != StatusCode::OK {
        return Err(failed(answer.status()));
    }
    let kind = answer.headers().get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok());
    let is_page = kind.is_some_and(|kind| kind.starts_with("text/html"));
    // Every body is in memory already.
    let body = to_bytes(answer.into_body(), usize::MAX).await;
    body.map(|body| (is_page, body.to_vec())).map_err(|_| failed(StatusCode::INTERNAL_SERVER_ERROR))
}

impl Scope {
    async fn read(reader: &Reader, phase: Option<&str>, now_unix_ms: i64) -> Result<Self, FreezeError> {
        let anybody = Viewer::Anonymous;
        let mut phases: BTreeMap<String, PhaseView> = BTreeMap::new();
        for view in reader.phases(&anybody, now_unix_ms).await? {
            phases.insert(view.id.clone(), view);
        }
        let (mut first, mut list) = ("/leaderboard".to_owned(), "/runs?limit=200".to_owned());
        if let Some(id) = phase {
            phases.retain(|known, _| known == id);
            first = format!("/leaderboard/{id}");
            list = format!("/runs?phase={id}&limit=200");
            if phases.is_empty() {
                return Err(FreezeError::NoPhase(id.to_owned()));
            }
        }
        let mut runs = BTreeMap::new();
        for id in phases.keys() {
            let lines = reader.runs(&anybody, Some(id), u32::MAX).await?;
            runs.extend(lines.into_iter().map(|line| (line.run.clone(), line)));
        }
        Ok(Self { phases, runs, first, list })
    }

    /// Addresses that are asked for although nothing may link to them.
    fn roots(&self) -> impl Iterator<Item = String> {
        let runs = self.runs.keys().map(|run| format!("/runs/{run}"));
        let tables = self.phases.keys().flat_map(|phase| {
            let kinds = ["leaderboards", "leaderboards.csv"];
            kinds.map(|kind| format!("/api/v1/phases/{phase}/{kind}"))
        });
        [self.first.clone()]
            .into_iter()
            .chain(self.phases.keys().map(|phase| format!("/phases/{phase}")))
            .chain(runs)
            .chain(tables)
    }

    fn file(&self, address: &str) -> String {
        if address == self.first { "index.html".to_owned() } else { file_of(address) }
    }

    /// The address under which a link is part of the copy; `None` when it is not.
    fn within(&self, link: &str) -> Option<String> {
        let (path, query) = link.split_once('?').unwrap_or((link, ""));
        let known = |id: &str| self.phases.contains_key(id);
        let parts: Vec<&str> = path.split('/').skip(1).collect();
        let inside = match parts[..] {
            [""] | ["leaderboard"] => return Some(self.first.clone()),
            ["runs"] => return Some(self.list.clone()),
            ["api", "v1", table @ ("runs" | "runs.csv")] => return Some(self.table_of_runs(table)),
            ["assets", _] | ["docs"] | ["docs", _] | ["docs", _, _] => query.is_empty(),
            ["api", "v1", "openapi.json"] => query.is_empty(),
            ["leaderboard", phase] => known(phase) && is_view(query),
            ["phases", phase] | ["phases", phase, "scenes", _] => known(phase) && query.is_empty(),
            ["api", "v1", "phases", phase, ..] => known(phase) && is_view(query),
            ["compare"] | ["api", "v1", "compare" | "compare.csv"] => self.is_pair(query),
            ["runs", run, "episodes", _] | ["api", "v1", "runs", run, "episodes", ..] => {
                self.shows_replays(run) && query.is_empty()
            }
            ["runs", run] | ["runs", run, "badge.svg"] | ["api", "v1", "runs", run, ..] => {
                self.runs.contains_key(run) && query.is_empty()
            }
            _ => false,
        };
        inside.then(|| link.to_owned())
    }

    /// The address of the list of runs for programs.
    fn table_of_runs(&self, table: &str) -> String {
        self.list.replacen("/runs", &format!("/api/v1/{table}"), 1)
    }

    fn shows_replays(&self, run: &str) -> bool {
        let phase = self.runs.get(run).and_then(|line| self.phases.get(&line.phase));
        phase.is_some_and(|phase| phase.replays == Visibility::Public)
    }

    /// Whether a comparison is of runs of the copy.
    fn is_pair(&self, query: &str) -> bool {
        let runs = query.split('&').filter_map(|part| part.split_once('='));
        runs.clone().count() == 2 && runs.into_iter().all(|(_, run)| self.shows_replays(run))
    }
}

/// Whether a query asks for a board by its order and what it is sorted by alone. There are few of these.
fn is_view(query: &str) -> bool {
    let names = query.split('&').filter(|part| !part.is_empty()).map(|part| part.split('=').next());
    names.into_iter().all(|name| matches!(name, Some("order" | "sort" | "pick")))
}
