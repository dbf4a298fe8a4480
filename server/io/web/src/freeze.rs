//! Static copies of the public pages: links lead from file to file, and nothing is loaded from another site.

use crate::{Documents, Site, router};
use avln_store::{PhaseView, Reader, RunLine, StoreError, Viewer, Visibility};
use axum::{
    Router,
    body::{Body, to_bytes},
    http::{Request, StatusCode, header},
};
use std::{
    collections::{BTreeMap, BTreeSet, VecDeque},
    io,
};
use tower::ServiceExt;

/// Cause of a failed copy.
#[expect(missing_docs, reason = "the messages explain the fields")]
#[derive(Debug, thiserror::Error)]
pub enum FreezeError {
    /// The phase does not exist or is not public.
    #[error("there is no public phase '{0}'")]
    NoPhase(String),
    /// The database failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A linked page is not available.
    #[error("cannot copy {address}: the response has status {status}")]
    Page { address: String, status: StatusCode },
    /// Two addresses have the same file name.
    #[error("{first} and {second} have the same file name")]
    Clash { first: String, second: String },
    /// A file cannot be written.
    #[error("cannot write {file}: {error}")]
    File { file: String, error: io::Error },
}

struct Scope {
    phases: BTreeMap<String, PhaseView>,
    runs: BTreeMap<String, RunLine>,
    first: String,
    list: String,
}

/// Copies the public pages for `phase`, or for all phases, as of `now_unix_ms`, with all `documents`. Passes name and content of
/// each file to `write`, and returns the file count. Fails if the phase does not exist, the database fails or a file cannot be
/// written.
pub async fn freeze(
    reader: &Reader,
    documents: Documents,
    phase: Option<&str>,
    now_unix_ms: i64,
    write: &mut (dyn FnMut(&str, &[u8]) -> io::Result<()> + Send),
) -> Result<usize, FreezeError> {
    let scope = Scope::read(reader, phase, now_unix_ms).await?;
    let site = Site { documents, frozen_unix_ms: Some(now_unix_ms), ..Site::default() };
    let router = router(reader.clone(), site);
    let mut written: BTreeMap<String, String> = BTreeMap::new();
    let mut seen: BTreeSet<String> = scope.roots().collect();
    let mut next: VecDeque<String> = scope.roots().collect();
    while let Some(address) = next.pop_front() {
        let file = scope.file(&address);
        let (is_page, bytes) = fetch(&router, &address).await?;
        let bytes = if is_page { page(&scope, &file, &bytes, &mut seen, &mut next) } else { bytes };
        if let Some(first) = written.insert(file.clone(), address.clone()) {
            return Err(FreezeError::Clash { first, second: address });
        }
        write(&file, &bytes).map_err(|error| FreezeError::File { file, error })?;
    }
    Ok(written.len())
}

/// Rewrites the links in a page, and adds new addresses to `next`.
fn page(
    scope: &Scope,
    file: &str,
    bytes: &[u8],
    seen: &mut BTreeSet<String>,
    next: &mut VecDeque<String>,
) -> Vec<u8> {
    let html = String::from_utf8_lossy(bytes).replacen("<html ", "<html class=\"frozen\" ", 1);
    let mut to_file = |link: &str| {
        let (link, step) = split_step(link);
        let address = scope.within(link)?;
        if seen.insert(address.clone()) {
            next.push_back(address.clone());
        }
        Some(relative(file, &scope.file(&address)) + step)
    };
    rewritten(&html, &mut to_file).into_bytes()
}

/// Splits the step off a link to a replay: all steps are in the same file, and the page script reads the step from the address.
fn split_step(link: &str) -> (&str, &str) {
    match link.find('?') {
        Some(at) if link.contains("/episodes/") => link.split_at(at),
        _ => (link, ""),
    }
}

async fn fetch(router: &Router, address: &str) -> Result<(bool, Vec<u8>), FreezeError> {
    let failed = |status| FreezeError::Page { address: address.to_owned(), status };
    let request = Request::get(address).body(Body::empty());
    let request = request.map_err(|_| failed(StatusCode::BAD_REQUEST))?;
    let Ok(answer) = router.clone().oneshot(request).await;
    if answer.status() != StatusCode::OK {
        return Err(failed(answer.status()));
    }
    let kind = answer.headers().get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok());
    let is_page = kind.is_some_and(|kind| kind.starts_with("text/html"));
    // These bodies are in memory already, so this needs no limit.
    let body = to_bytes(answer.into_body(), usize::MAX).await;
    body.map(|body| (is_page, body.to_vec())).map_err(|_| failed(StatusCode::INTERNAL_SERVER_ERROR))
}

impl Scope {
    async fn read(reader: &Reader, phase: Option<&str>, now_unix_ms: i64) -> Result<Self, FreezeError> {
        let public = Viewer::Anonymous;
        let views = reader.phases(&public, now_unix_ms).await?;
        let mut phases: BTreeMap<_, _> = views.into_iter().map(|view| (view.id.clone(), view)).collect();
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
            let lines = reader.runs(&public, Some(id), u32::MAX).await?;
            runs.extend(lines.into_iter().map(|line| (line.run.clone(), line)));
        }
        Ok(Self { phases, runs, first, list })
    }

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

    /// Returns a link's canonical address; `None` for targets outside the copy.
    fn within(&self, link: &str) -> Option<String> {
        let (path, query) = link.split_once('?').unwrap_or((link, ""));
        let known = |id: &str| self.phases.contains_key(id);
        let parts: Vec<&str> = path.split('/').skip(1).collect();
        let inside = match parts[..] {
            [""] | ["leaderboard"] => return Some(self.first.clone()),
            ["runs"] => return Some(self.list.clone()),
            ["api", "v1", table @ ("runs" | "runs.csv")] => {
                return Some(self.list.replacen("/runs", &format!("/api/v1/{table}"), 1));
            }
            ["assets", _] | ["docs"] | ["docs", _] | ["docs", _, _] => query.is_empty(),
            ["api", "v1", "openapi.json"] => query.is_empty(),
            ["leaderboard", phase] => known(phase) && is_plain_selection(query),
            ["phases", phase] | ["phases", phase, "scenes", _] => known(phase) && query.is_empty(),
            ["api", "v1", "phases", phase, ..] => known(phase) && is_plain_selection(query),
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

    fn shows_replays(&self, run: &str) -> bool {
        let phase = self.runs.get(run).and_then(|line| self.phases.get(&line.phase));
        phase.is_some_and(|phase| phase.replays == Visibility::Public)
    }

    fn is_pair(&self, query: &str) -> bool {
        let runs = query.split('&').filter_map(|part| part.split_once('='));
        runs.clone().count() == 2 && runs.into_iter().all(|(_, run)| self.shows_replays(run))
    }
}

// Returns true for a leaderboard selected only by order, sort key and run. Other selections would be too many to copy.
fn is_plain_selection(query: &str) -> bool {
    let names = query.split('&').filter(|part| !part.is_empty()).map(|part| part.split('=').next());
    names.into_iter().all(|name| matches!(name, Some("order" | "sort" | "pick")))
}

const ATTRIBUTES: [&str; 3] = [" href=\"", " src=\"", " action=\""];

fn file_of(address: &str) -> String {
    let (path, query) = address.split_once('?').unwrap_or((address, ""));
    let path = path.trim_start_matches('/');
    let is_plain = |letter: char| letter.is_ascii_alphanumeric() || matches!(letter, '-' | '_' | '.');
    let query = query.replace(|letter| !is_plain(letter), "-");
    let mark = if query.is_empty() { "" } else { "-by-" };
    let data = path.strip_prefix("api/v1/");
    let (folder, path) = data.map_or(("", path), |path| ("data/", path));
    let ending =
        ["css", "js", "svg", "csv", "json"].into_iter().find(|end| path.ends_with(&format!(".{end}")));
    let usual = if data.is_some() { "json" } else { "html" };
    let (stem, ending) = ending.map_or((path, usual), |end| (&path[..path.len() - end.len() - 1], end));
    format!("{folder}{stem}{mark}{query}.{ending}")
}

fn relative(from: &str, to: &str) -> String {
    let mut from: Vec<&str> = from.split('/').collect();
    let mut to: Vec<&str> = to.split('/').collect();
    from.pop();
    let common = from.iter().zip(&to[..to.len() - 1]).take_while(|(a, b)| a == b).count();
    let mut path = vec![".."; from.len() - common];
    path.extend(to.drain(common..));
    path.join("/")
}

/// Replaces local links by the results from `to_file`, and removes links without result. Links to other sites remain.
fn rewritten(html: &str, to_file: &mut dyn FnMut(&str) -> Option<String>) -> String {
    let mut out = String::with_capacity(html.len());
    let mut rest = html;
    while let Some((start, attribute)) = first_attribute(rest) {
        let value_at = start + attribute.len();
        let Some(length) = rest[value_at..].find('"') else { break };
        let value = &rest[value_at..value_at + length];
        out += &rest[..start];
        if let Some(new) = new_value(value, to_file) {
            out += attribute;
            out += &new;
            out.push('"');
        }
        rest = &rest[value_at + length + 1..];
    }
    out + rest
}

fn first_attribute(html: &str) -> Option<(usize, &'static str)> {
    ATTRIBUTES.iter().filter_map(|name| Some((html.find(name)?, *name))).min()
}

/// Returns the new attribute value; `None` removes the attribute.
fn new_value(value: &str, to_file: &mut dyn FnMut(&str) -> Option<String>) -> Option<String> {
    let is_elsewhere = !value.starts_with('/') || value.starts_with("//");
    if is_elsewhere {
        return Some(value.to_owned());
    }
    let address = value.replace("&#38;", "&").replace("&amp;", "&");
    let (address, anchor) = address.split_once('#').map_or((address.as_str(), ""), |(a, anchor)| (a, anchor));
    let mark = if anchor.is_empty() { "" } else { "#" };
    to_file(address).map(|file| format!("{file}{mark}{anchor}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_map_to_file_names() {
        for (address, file) in [
            ("/leaderboard/p", "leaderboard/p.html"),
            ("/leaderboard/p?order=both&sort=spl", "leaderboard/p-by-order-both-sort-spl.html"),
            ("/runs/r/badge.svg", "runs/r/badge.svg"),
            ("/assets/app.css", "assets/app.css"),
            ("/api/v1/runs/r", "data/runs/r.json"),
            ("/api/v1/phases/p/leaderboard.csv?sort=spl", "data/phases/p/leaderboard-by-sort-spl.csv"),
        ] {
            assert_eq!(file_of(address), file);
        }
    }

    #[test]
    fn paths_between_files_are_relative() {
        assert_eq!(relative("index.html", "runs/r.html"), "runs/r.html");
        assert_eq!(relative("runs/r/episodes/0.html", "assets/app.css"), "../../../assets/app.css");
        assert_eq!(relative("runs/r/episodes/0.html", "runs/r.html"), "../../r.html");
        assert_eq!(relative("runs/r/episodes/0.html", "runs/r/episodes/1.html"), "1.html");
    }

    #[test]
    fn links_are_rewritten_or_removed() {
        let mut asked = Vec::new();
        let page = "<a class=\"x\" href=\"/a?b=1&#38;c=2#d\">/a</a><a href=\"/gone\" rel=\"next\">b</a>\
                    <a href=\"https://x.org\">c</a><a href=\"#e\">e</a><p>say href=/a</p>";
        let new = rewritten(page, &mut |address| {
            asked.push(address.to_owned());
            address.starts_with("/a").then(|| "a.html".to_owned())
        });
        assert_eq!(asked, ["/a?b=1&c=2", "/gone"]);
        assert_eq!(
            new,
            "<a class=\"x\" href=\"a.html#d\">/a</a><a rel=\"next\">b</a>\
             <a href=\"https://x.org\">c</a><a href=\"#e\">e</a><p>say href=/a</p>"
        );
    }
}
