//! How to take part, and the documents of the repository.

mod list;
mod markdown;

use super::{Page, Part, Shell, write};
use crate::{
    trouble::Trouble,
    visit::{Asked, Host, Nothing},
    words,
};
use askama::Template;
use avln_scoring::Key;
use axum::extract::Path;
use list::PATHS;
use std::sync::LazyLock;

/// All documents, in the order in which they are listed.
static DOCUMENTS: LazyLock<Vec<Document>> =
    LazyLock::new(|| PATHS.into_iter().map(|(path, text)| Document::new(path, text)).collect());

/// A document of the repository as a page.
struct Document {
    /// What follows `/docs/` in its address.
    slug: String,
    title: String,
    html: String,
}

#[derive(Template)]
#[template(path = "docs.html")]
struct DocsPage {
    shell: Shell,
    host: Host,
    keys: [Key; 10],
    documents: Vec<&'static Document>,
    decisions: Vec<&'static Document>,
}

#[derive(Template)]
#[template(path = "document.html")]
struct DocumentPage {
    shell: Shell,
    document: &'static Document,
}

/// How to take part, what the numbers mean, and a list of all documents.
pub(super) async fn index(host: Host, _: Asked<Nothing>) -> Page {
    let (decisions, documents) = DOCUMENTS.iter().partition(|document| document.is_decision());
    let shell = Shell::new("How to take part", Part::Docs);
    write(&DocsPage { shell, host, keys: Key::ALL, documents, decisions })
}

/// One document.
pub(super) async fn document(Path(slug): Path<String>, _: Asked<Nothing>) -> Page {
    let found = DOCUMENTS.iter().find(|document| document.slug == slug);
    let document = found.ok_or(Trouble::Unknown { what: "document", name: slug })?;
    let shell = Shell::new(document.title.clone(), Part::Docs).below("How to take part", "/docs");
    write(&DocumentPage { shell, document })
}

impl Document {
    fn new(path: &str, text: &str) -> Self {
        let (title, html) = markdown::render(path, text);
        Self { slug: slug(path), title, html }
    }

    /// Whether it tells why something is as it is.
    fn is_decision(&self) -> bool {
        self.slug.starts_with("decisions/")
    }
}

/// What follows `/docs/` in the address of the document at `path` of the repository.
fn slug(path: &str) -> String {
    let inside = path.strip_prefix("docs/").or(path.strip_prefix("proto/")).unwrap_or(path);
    inside.trim_end_matches(".md").to_lowercase()
}

/// The address of the document at `path` of the repository; `None` where that is no document.
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
        let there: BTreeSet<String> =
            ["docs", "docs/decisions", "proto"].into_iter().flat_map(markdown).collect();
        let listed: BTreeSet<String> = PATHS.iter().map(|(path, _)| (*path).to_owned()).collect();
        assert_eq!(there, listed);
    }

    #[test]
    fn addresses_follow_names() {
        assert_eq!(address("docs/GLOSSARY.md").as_deref(), Some("/docs/glossary"));
        assert_eq!(address("proto/PROTOCOL.md").as_deref(), Some("/docs/protocol"));
        assert_eq!(address("docs/challenge.toml"), None);
        let titles: BTreeSet<&str> = DOCUMENTS.iter().map(|document| document.title.as_str()).collect();
        assert!(titles.len() == DOCUMENTS.len() && !titles.contains(""), "{titles:?}");
    }
}
