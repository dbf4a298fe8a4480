//! Instructions for participants, and pages of documents with a search.

use super::{Page, PageShell, SiteSection, render};
use crate::{
    documents::{Document, DocumentGroup, Documents, FoundDocument},
    error::{RequestError, Result},
    format,
    request::{DocsQuery, GrpcAddress, PathOnly, StrictQuery},
};
use askama::Template;
use avln_scoring::Key;
use axum::{
    Extension,
    http::header,
    response::{IntoResponse, Response},
};

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

pub(super) async fn index(
    grpc_address: GrpcAddress,
    Extension(documents): Extension<Documents>,
    StrictQuery(query): StrictQuery<DocsQuery>,
) -> Page {
    let words = query.words()?;
    if !words.is_empty() {
        let shell = below_index("Search in the documents");
        return render(&DocsSearchPage { shell, query, results: documents.search(&words) });
    }
    let shell = PageShell::new(TITLE, SiteSection::Docs);
    render(&DocsPage { shell, grpc_address, keys: Key::ALL, query, groups: documents.groups() })
}

pub(super) async fn document(
    PathOnly(slug): PathOnly<String>,
    Extension(documents): Extension<Documents>,
) -> Page {
    let document = documents.find(&slug).ok_or_else(|| RequestError::unknown("document", slug))?;
    render(&DocumentPage { shell: below_index(&document.title), document })
}

pub(super) async fn chart(
    PathOnly(file): PathOnly<String>,
    Extension(documents): Extension<Documents>,
) -> Result<Response> {
    let svg = documents.chart(&file).ok_or_else(|| RequestError::unknown("chart", &file))?;
    Ok(([(header::CONTENT_TYPE, "image/svg+xml; charset=utf-8")], svg.to_owned()).into_response())
}

const TITLE: &str = "How to take part";

fn below_index(title: &str) -> PageShell {
    PageShell::new(title, SiteSection::Docs).below(TITLE, "/docs")
}
