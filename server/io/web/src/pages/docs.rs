//! Instructions for participants, and the repository's documents.

mod markdown;

use super::{Page, PageShell, SiteSection, render};
use crate::{
    error::RequestError,
    format,
    request::{GrpcAddress, NoParameters, StrictQuery},
};
use askama::Template;
use avln_scoring::Key;
use axum::extract::Path;
use std::sync::LazyLock;

/// Pairs paths with file texts.
macro_rules! texts {
    ($($path:literal,)*) => { [$(($path, include_str!(concat!("../../../../../", $path)))),*] };
}

/// Documents as path and Markdown, those for participants first.
const PATHS: [(&str, &str); 42] = texts![
    "docs/QUICKSTART.md",
    "docs/FAQ.md",
    "docs/results.md",
    "docs/scoring.md",
    "docs/GLOSSARY.md",
    "docs/python.md",
    "proto/PROTOCOL.md",
    "docs/VERIFYING.md",
    "docs/CLI.md",
    "docs/DATASET.md",
    "docs/SCENES.md",
    "docs/HABITAT.md",
    "docs/acoustics.md",
    "docs/checking-sound.md",
    "docs/perception.md",
    "docs/models.md",
    "docs/traces.md",
    "docs/ORGANISING.md",
    "docs/OPERATING.md",
    "docs/deploying.md",
    "docs/performance.md",
    "docs/ARCHITECTURE.md",
    "docs/decisions/0001-stop-with-goals-left.md",
    "docs/decisions/0002-both-orders-from-one-episode.md",
    "docs/decisions/0003-rays-on-parrys-tree.md",
    "docs/decisions/0004-own-voxel-regions.md",
    "docs/decisions/0005-agents-as-processes-of-the-same-binary.md",
    "docs/decisions/0006-houses-are-arms-of-rooms.md",
    "docs/decisions/0007-noise-is-drawn-by-pixel.md",
    "docs/decisions/0008-light-is-baked.md",
    "docs/decisions/0009-one-crate-is-unsafe.md",
    "docs/decisions/0010-clips-tell-nothing.md",
    "docs/decisions/0011-runs-are-written-down.md",
    "docs/decisions/0012-time-that-is-nobodys.md",
    "docs/decisions/0013-backups-cut-logs.md",
    "docs/decisions/0014-traces-are-lines.md",
    "docs/decisions/0015-models-run-by-a-library-of-the-user.md",
    "docs/decisions/0016-parquet-crate.md",
    "docs/decisions/0017-people-play-as-agents-do.md",
    "docs/decisions/0018-pages-without-a-library.md",
    "docs/decisions/0019-own-inference-engine.md",
    "docs/decisions/0020-scene-readers.md",
];

/// All documents, ordered as [`PATHS`].
static DOCUMENTS: LazyLock<Vec<Document>> =
    LazyLock::new(|| PATHS.into_iter().map(|(path, text)| Document::new(path, text)).collect());

/// A rendered document.
struct Document {
    /// Address below `/docs/`.
    slug: String,
    title: String,
    html: String,
}

#[derive(Template)]
#[template(path = "docs.html")]
struct DocsPage {
    shell: PageShell,
    grpc_address: GrpcAddress,
    keys: [Key; 10],
    documents: Vec<&'static Document>,
    decisions: Vec<&'static Document>,
}

#[derive(Template)]
#[template(path = "document.html")]
struct DocumentPage {
    shell: PageShell,
    document: &'static Document,
}

/// Serves instructions, metric definitions and the list of documents.
pub(super) async fn index(grpc_address: GrpcAddress, _: StrictQuery<NoParameters>) -> Page {
    let (decisions, documents) = DOCUMENTS.iter().partition(|document| document.is_decision());
    let shell = PageShell::new("How to take part", SiteSection::Docs);
    render(&DocsPage { shell, grpc_address, keys: Key::ALL, documents, decisions })
}

pub(super) async fn document(Path(slug): Path<String>, _: StrictQuery<NoParameters>) -> Page {
    let found = DOCUMENTS.iter().find(|document| document.slug == slug);
    let document = found.ok_or(RequestError::Unknown { what: "document", name: slug })?;
    let shell = PageShell::new(document.title.clone(), SiteSection::Docs).below("How to take part", "/docs");
    render(&DocumentPage { shell, document })
}

impl Document {
    fn new(path: &str, text: &str) -> Self {
        let (title, html) = markdown::render(path, text);
        Self { slug: slug(path), title, html }
    }

    fn is_decision(&self) -> bool {
        self.slug.starts_with("decisions/")
    }
}

/// Returns the document's address below `/docs/`.
fn slug(path: &str) -> String {
    let inside = path.strip_prefix("docs/").or(path.strip_prefix("proto/")).unwrap_or(path);
    inside.trim_end_matches(".md").to_lowercase()
}

/// Returns the document's address; `None` for other files.
fn address(path: &str) -> Option<String> {
    PATHS.iter().any(|(listed, _)| *listed == path).then(|| format!("/docs/{}", slug(path)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::{collections::BTreeSet, fs, path};

    fn root() -> path::PathBuf {
        path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../..")
    }

    #[test]
    fn every_document_of_the_repository_is_listed() {
        let markdown = |folder: &str| {
            let entries = fs::read_dir(root().join(folder)).expect(folder);
            let names =
                entries.map(|entry| entry.expect("an entry").file_name().into_string().expect("UTF-8"));
            let names: Vec<String> = names.filter(|name| name.ends_with(".md")).collect();
            names.into_iter().map(|name| format!("{folder}/{name}")).collect::<Vec<_>>()
        };
        let present: BTreeSet<String> =
            ["docs", "docs/decisions", "proto"].into_iter().flat_map(markdown).collect();
        let listed: BTreeSet<String> = PATHS.iter().map(|(path, _)| (*path).to_owned()).collect();
        assert_eq!(present, listed);
    }

    #[test]
    fn addresses_follow_file_names() {
        assert_eq!(address("docs/GLOSSARY.md").as_deref(), Some("/docs/glossary"));
        assert_eq!(address("proto/PROTOCOL.md").as_deref(), Some("/docs/protocol"));
        assert_eq!(address("docs/challenge.toml"), None);
        let titles: BTreeSet<&str> = DOCUMENTS.iter().map(|document| document.title.as_str()).collect();
        assert!(titles.len() == DOCUMENTS.len() && !titles.contains(""), "{titles:?}");
    }
}
