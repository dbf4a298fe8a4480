//! Instructions for participants, and the repository's documents.

use super::{Page, PageShell, SiteSection, render};
use crate::{
    error::RequestError,
    format,
    request::{GrpcAddress, NoParameters, PathOnly, StrictQuery},
};
use askama::Template;
use avln_scoring::Key;
use pulldown_cmark::{CowStr, Event, HeadingLevel, Options, Parser, Tag, TagEnd, html};
use std::sync::LazyLock;

macro_rules! texts {
    ($($path:literal,)*) => { [$(($path, include_str!(concat!("../../../../../", $path)))),*] };
}

/// Documents as path and Markdown, those for participants first.
const PATHS: [(&str, &str); 43] = texts![
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
    "docs/decisions/0021-golden-files.md",
];

static DOCUMENTS: LazyLock<Vec<Document>> =
    LazyLock::new(|| PATHS.into_iter().map(|(path, text)| Document::new(path, text)).collect());

struct Document {
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

pub(super) async fn index(grpc_address: GrpcAddress, _: StrictQuery<NoParameters>) -> Page {
    let (decisions, documents) =
        DOCUMENTS.iter().partition(|document| document.slug.starts_with("decisions/"));
    let shell = PageShell::new("How to take part", SiteSection::Docs);
    render(&DocsPage { shell, grpc_address, keys: Key::ALL, documents, decisions })
}

pub(super) async fn document(PathOnly(slug): PathOnly<String>) -> Page {
    let found = DOCUMENTS.iter().find(|document| document.slug == slug);
    let document = found.ok_or(RequestError::unknown("document", slug))?;
    let shell = PageShell::new(document.title.clone(), SiteSection::Docs).below("How to take part", "/docs");
    render(&DocumentPage { shell, document })
}

impl Document {
    fn new(path: &str, text: &str) -> Self {
        let (title, html) = render_markdown(path, text);
        Self { slug: slug(path), title, html }
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

/// Returns a document's title (the first heading) and the HTML below it. Links to other documents lead to their pages,
/// links to other files become plain text, and HTML in the text is escaped.
fn render_markdown(path: &str, text: &str) -> (String, String) {
    let events: Vec<Event> = Parser::new_ext(text, Options::ENABLE_TABLES).collect();
    let (title, rest) = split_title(events);
    let events = framed(anchored(linked(path, rest.into_iter().map(harmless).collect())), &title);
    let mut html = String::new();
    html::push_html(&mut html, events.into_iter());
    // Scrollable blocks must be reachable by keyboard (accessibility).
    let html = html.replace("<pre>", "<pre tabindex=\"0\">");
    (title, html)
}

fn split_title(events: Vec<Event<'_>>) -> (String, Vec<Event<'_>>) {
    let is_end = |event: &Event| matches!(event, Event::End(TagEnd::Heading(HeadingLevel::H1)));
    let Some(end) = events.iter().position(is_end) else { return (String::new(), events) };
    let title = plain(&events[..end]);
    (title, events.into_iter().skip(end + 1).collect())
}

fn plain(events: &[Event]) -> String {
    let texts = events.iter().filter_map(|event| match event {
        Event::Text(text) | Event::Code(text) => Some(text.as_ref()),
        _ => None,
    });
    texts.collect()
}

/// Turns HTML into text, and removes column alignment: the content security policy blocks inline styles.
fn harmless(event: Event<'_>) -> Event<'_> {
    match event {
        Event::Html(text) | Event::InlineHtml(text) => Event::Text(text),
        Event::Start(Tag::Table(columns)) => {
            Event::Start(Tag::Table(vec![pulldown_cmark::Alignment::None; columns.len()]))
        }
        other => other,
    }
}

fn linked<'a>(path: &str, events: Vec<Event<'a>>) -> Vec<Event<'a>> {
    let mut open = Vec::new();
    let mut linked = Vec::with_capacity(events.len());
    for event in events {
        match event {
            Event::Start(Tag::Link { link_type, dest_url, title, id }) => {
                let target = target(path, &dest_url);
                open.push(target.is_some());
                if let Some(target) = target {
                    linked.push(Event::Start(Tag::Link { link_type, dest_url: target.into(), title, id }));
                }
            }
            Event::End(TagEnd::Link) if !open.pop().unwrap_or(false) => {}
            other => linked.push(other),
        }
    }
    linked
}

/// Resolves a link in the document at `path`; `None` for files without a page.
fn target(path: &str, link: &str) -> Option<String> {
    if link.starts_with("https://") || link.starts_with("http://") || link.starts_with('#') {
        return Some(link.to_owned());
    }
    let (file, place) = link.split_once('#').map_or((link, None), |(file, place)| (file, Some(place)));
    let mut parts: Vec<&str> = path.split('/').collect();
    parts.pop();
    for part in file.split('/') {
        match part {
            ".." => _ = parts.pop(),
            "." => {}
            name => parts.push(name),
        }
    }
    let page = address(&parts.join("/"))?;
    Some(place.map_or(page.clone(), |place| format!("{page}#{place}")))
}

fn anchored(mut events: Vec<Event<'_>>) -> Vec<Event<'_>> {
    for at in 0..events.len() {
        let Event::Start(Tag::Heading { level, .. }) = events[at] else { continue };
        let is_end = |event: &Event| matches!(event, Event::End(TagEnd::Heading(_)));
        let words = events[at..].iter().position(is_end).map_or(0, |length| at + length);
        let anchor = anchor(&plain(&events[at..words.max(at)]));
        let id = Some(CowStr::from(anchor));
        events[at] = Event::Start(Tag::Heading { level, id, classes: Vec::new(), attrs: Vec::new() });
    }
    events
}

/// Returns the heading id: lower case with hyphens, as on GitHub.
fn anchor(words: &str) -> String {
    let kept = words.to_lowercase();
    let kept = kept.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.collect::<String>().replace(' ', "-")
}

fn framed<'a>(events: Vec<Event<'a>>, title: &str) -> Vec<Event<'a>> {
    let mut framed = Vec::with_capacity(events.len());
    let mut tables = 0;
    for event in events {
        match event {
            Event::Start(Tag::Table(_)) => {
                tables += 1;
                let name = format!("Table {tables} of {title}").replace(['"', '<', '>', '&'], "");
                let frame =
                    format!("<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"{name}\">\n");
                framed.extend([Event::Html(frame.into()), event]);
            }
            Event::End(TagEnd::Table) => framed.extend([event, Event::Html("</div>\n".into())]),
            other => framed.push(other),
        }
    }
    framed
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
            // A README is the page of a package.
            let is_page = |name: &String| name.ends_with(".md") && name != "README.md";
            let names: Vec<String> = names.filter(is_page).collect();
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

    #[test]
    fn the_first_heading_is_the_title() {
        let (title, html) = render_markdown("docs/a.md", "# Of `all`\n\nText.\n\n## What it's for, now\n");
        assert_eq!(title, "Of all");
        assert_eq!(html, "<p>Text.</p>\n<h2 id=\"what-its-for-now\">What it's for, now</h2>\n");
    }

    #[test]
    fn links_lead_to_pages_or_become_text() {
        let text = "[a](scoring.md#spl) [b](../proto/PROTOCOL.md) [c](challenge.toml) [d](https://e.org/x) [e](#here)";
        let (_, html) = render_markdown("docs/a.md", text);
        let expected = "<a href=\"/docs/scoring#spl\">a</a> <a href=\"/docs/protocol\">b</a> c \
                        <a href=\"https://e.org/x\">d</a> <a href=\"#here\">e</a>";
        assert_eq!(html, format!("<p>{expected}</p>\n"));
        let (_, html) = render_markdown(
            "docs/decisions/x.md",
            "[s](../scoring.md) [n](javascript:alert) [o](../../../../etc)",
        );
        assert_eq!(html, "<p><a href=\"/docs/scoring\">s</a> n o</p>\n");
    }

    #[test]
    fn html_is_escaped_and_tables_scroll() {
        let (_, html) = render_markdown(
            "docs/a.md",
            "# T\n\n<b onclick=\"x\">hi</b>\n\n| a | b |\n|---|--:|\n| 1 | 2 |\n",
        );
        assert!(!html.contains("<b") && html.contains("&lt;b onclick"), "{html}");
        assert!(html.contains("aria-label=\"Table 1 of T\"") && !html.contains("style="), "{html}");
    }
}
