//! Markdown as HTML, and as sections for the search; links from URLs in plain text.

use super::{Document, DocumentSection};
use pulldown_cmark::{
    Alignment, CowStr, Event, HeadingLevel, Options, Parser, Tag, TagEnd, TextMergeStream, html,
};
use std::{
    collections::{BTreeMap, BTreeSet},
    iter,
};

const SCHEMES: [&str; 2] = ["https://", "http://"];

/// File name ending of charts.
pub(super) const CHART: &str = ".svg";

/// Renders the document at `path`; its title is the first heading. Links to other `pages`, and their charts, lead to their
/// addresses. Links to other files become plain text, other images their descriptions, and HTML in the text is escaped.
pub(super) fn render(path: &str, text: &str, pages: &BTreeSet<&str>) -> Document {
    let events: Vec<Event> = Parser::new_ext(text, Options::ENABLE_TABLES).collect();
    let (title, rest) = split_title(events);
    let events = anchored(linked(path, pages, rest.into_iter().map(harmless).collect()));
    let sections = sections(&title, &events);
    let mut html = String::new();
    html::push_html(&mut html, framed(events, &title).into_iter());
    // Scrollable blocks must be reachable by keyboard (accessibility).
    let html = html.replace("<pre>", "<pre tabindex=\"0\">");
    Document { slug: slug(path), title, html, sections }
}

/// Renders an organiser's text below a page heading. HTML is removed, images become their descriptions, URLs become links, and
/// links within this site and with other schemes become plain text.
pub(crate) fn brief(text: &str) -> String {
    let events = Parser::new_ext(text, Options::empty()).filter(|event| !is_foreign(event));
    // The parser splits texts inside URLs, such as at underscores.
    let events = TextMergeStream::new(events);
    // Open links: true for those with a tag.
    let mut links = Vec::new();
    let mut is_code = false;
    let kept = events.filter_map(|event| match event {
        Event::Start(Tag::Link { dest_url, .. }) => {
            let tag = start_tag(&dest_url);
            links.push(tag.is_some());
            tag.map(|tag| Event::InlineHtml(tag.into()))
        }
        Event::End(TagEnd::Link) => links.pop().unwrap_or(false).then(|| Event::InlineHtml("</a>".into())),
        Event::Text(words) if links.is_empty() && !is_code => {
            Some(Event::InlineHtml(linked_html(&words).into()))
        }
        other => {
            match &other {
                Event::Start(Tag::CodeBlock(_)) => is_code = true,
                Event::End(TagEnd::CodeBlock) => is_code = false,
                _ => {}
            }
            Some(demoted(other))
        }
    });
    let mut html = String::new();
    html::push_html(&mut html, kept);
    html.replace("<pre>", "<pre tabindex=\"0\">")
}

/// Returns true for HTML and for the frames of images; an image's description is a text of its own.
fn is_foreign(event: &Event) -> bool {
    matches!(
        event,
        Event::Html(_)
            | Event::InlineHtml(_)
            | Event::Start(Tag::HtmlBlock | Tag::Image { .. })
            | Event::End(TagEnd::HtmlBlock | TagEnd::Image)
    )
}

/// Moves a heading two levels down, because the page has levels 1 and 2; returns other events unchanged.
fn demoted(event: Event<'_>) -> Event<'_> {
    let lower = |level| match level {
        HeadingLevel::H1 => HeadingLevel::H3,
        HeadingLevel::H2 => HeadingLevel::H4,
        HeadingLevel::H3 => HeadingLevel::H5,
        HeadingLevel::H4 | HeadingLevel::H5 | HeadingLevel::H6 => HeadingLevel::H6,
    };
    match event {
        Event::Start(Tag::Heading { level, id, classes, attrs }) => {
            Event::Start(Tag::Heading { level: lower(level), id, classes, attrs })
        }
        Event::End(TagEnd::Heading(level)) => Event::End(TagEnd::Heading(lower(level))),
        other => other,
    }
}

/// Returns the document's or chart's address below `/docs/`.
fn slug(path: &str) -> String {
    let inside = path.strip_prefix("docs/").or(path.strip_prefix("proto/")).unwrap_or(path);
    if path.ends_with(CHART) { inside.to_owned() } else { inside.trim_end_matches(".md").to_lowercase() }
}

/// Returns the repository path of a relative link in the file at `path`.
pub(super) fn resolve(path: &str, link: &str) -> String {
    let mut parts: Vec<&str> = path.split('/').collect();
    parts.pop();
    for part in link.split('/') {
        match part {
            ".." => _ = parts.pop(),
            "." => {}
            name => parts.push(name),
        }
    }
    parts.join("/")
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
        Event::Start(Tag::Table(columns)) => Event::Start(Tag::Table(vec![Alignment::None; columns.len()])),
        other => other,
    }
}

fn linked<'a>(path: &str, pages: &BTreeSet<&str>, events: Vec<Event<'a>>) -> Vec<Event<'a>> {
    let mut open = Vec::new();
    let mut linked = Vec::with_capacity(events.len());
    for event in events {
        match event {
            Event::Start(Tag::Link { link_type, dest_url, title, id }) => {
                let target = target(path, pages, &dest_url);
                open.push(target.is_some());
                if let Some(target) = target {
                    linked.push(Event::Start(Tag::Link { link_type, dest_url: target.into(), title, id }));
                }
            }
            Event::End(TagEnd::Link) if !open.pop().unwrap_or(false) => {}
            Event::Start(Tag::Image { link_type, dest_url, title, id }) => {
                let chart = target(path, pages, &dest_url).filter(|target| target.starts_with("/docs/"));
                open.push(chart.is_some());
                if let Some(chart) = chart {
                    linked.push(Event::Start(Tag::Image { link_type, dest_url: chart.into(), title, id }));
                }
            }
            Event::End(TagEnd::Image) if !open.pop().unwrap_or(false) => {}
            other => linked.push(other),
        }
    }
    linked
}

/// Returns the address for a link in the document at `path`; `None` for files without a page.
fn target(path: &str, pages: &BTreeSet<&str>, link: &str) -> Option<String> {
    if link.starts_with('#') || SCHEMES.into_iter().any(|scheme| link.starts_with(scheme)) {
        return Some(link.to_owned());
    }
    let (file, place) = link.split_once('#').map_or((link, None), |(file, place)| (file, Some(place)));
    let file = resolve(path, file);
    let page = pages.contains(file.as_str()).then(|| format!("/docs/{}", slug(&file)))?;
    Some(place.map_or(page.clone(), |place| format!("{page}#{place}")))
}

/// Adds an id to each heading; the second one of the same name ends in `-1`, as on GitHub.
fn anchored(mut events: Vec<Event<'_>>) -> Vec<Event<'_>> {
    let mut counts: BTreeMap<String, u32> = BTreeMap::new();
    for at in 0..events.len() {
        let Event::Start(Tag::Heading { level, .. }) = events[at] else { continue };
        let anchor = anchor(&plain(heading(&events[at..])));
        let earlier = counts.entry(anchor.clone()).or_default();
        let id = if *earlier == 0 { anchor } else { format!("{anchor}-{earlier}") };
        *earlier += 1;
        let id = Some(CowStr::from(id));
        events[at] = Event::Start(Tag::Heading { level, id, classes: Vec::new(), attrs: Vec::new() });
    }
    events
}

/// Returns the heading at the start of `events`.
fn heading<'a, 'text>(events: &'a [Event<'text>]) -> &'a [Event<'text>] {
    let is_end = |event: &Event| matches!(event, Event::End(TagEnd::Heading(_)));
    &events[..events.iter().position(is_end).unwrap_or(0)]
}

/// Returns the heading id: lower case with hyphens, as on GitHub.
fn anchor(words: &str) -> String {
    let kept = words.to_lowercase();
    let kept = kept.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.collect::<String>().replace(' ', "-")
}

/// Splits a document at its headings. The title is a section too.
fn sections(title: &str, events: &[Event]) -> Vec<DocumentSection> {
    let is_heading = |event: &Event| matches!(event, Event::Start(Tag::Heading { .. }));
    let (heading, anchor) = (String::new(), String::new());
    let top = DocumentSection { heading, anchor, words: title.to_lowercase() };
    let parts = events.chunk_by(|_, next| !is_heading(next));
    iter::once(top).chain(parts.map(section)).collect()
}

fn section(events: &[Event]) -> DocumentSection {
    let anchor = match events.first() {
        Some(Event::Start(Tag::Heading { id: Some(id), .. })) => id.to_string(),
        _ => String::new(),
    };
    DocumentSection { heading: plain(heading(events)), anchor, words: words(events) }
}

/// Returns the text in lower case, with a space between blocks.
fn words(events: &[Event]) -> String {
    let pieces = events.iter().map(|event| match event {
        Event::Text(text) | Event::Code(text) => text.as_ref(),
        Event::SoftBreak | Event::HardBreak => " ",
        Event::End(TagEnd::Emphasis | TagEnd::Strong | TagEnd::Link | TagEnd::Image) => "",
        Event::End(_) => " ",
        _ => "",
    });
    pieces.collect::<String>().to_lowercase()
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

/// Escapes a text and links its `http` and `https` URLs.
pub(crate) fn linked_html(text: &str) -> String {
    let mut html = String::with_capacity(text.len());
    let mut rest = text;
    while let Some((start, end)) = find_url(rest) {
        html += &escaped(&rest[..start]);
        let url = escaped(&rest[start..end]);
        html += &format!("<a rel=\"nofollow noopener\" href=\"{url}\">{url}</a>");
        rest = &rest[end..];
    }
    html + &escaped(rest)
}

/// Returns the start tag of a link to another site or within the page; `None` for other addresses.
fn start_tag(address: &str) -> Option<String> {
    let url = escaped(address);
    if SCHEMES.into_iter().any(|scheme| address.starts_with(scheme)) {
        return Some(format!("<a rel=\"nofollow noopener\" href=\"{url}\">"));
    }
    address.starts_with('#').then(|| format!("<a href=\"{url}\">"))
}

/// Returns start and end of the first URL.
fn find_url(text: &str) -> Option<(usize, usize)> {
    text.match_indices("http")
        .map(|(at, _)| at)
        .filter(|&at| !text[..at].ends_with(char::is_alphanumeric))
        .find_map(|at| Some((at, at + url_length(&text[at..])?)))
}

/// Returns the length of the URL at the start of `text`, without the punctuation after it; `None` without a URL.
fn url_length(text: &str) -> Option<usize> {
    let scheme = SCHEMES.into_iter().find(|scheme| text.starts_with(scheme))?;
    let is_outside = |letter: char| {
        letter.is_whitespace() || letter.is_control() || matches!(letter, '<' | '>' | '"' | '`')
    };
    let mut url = &text[..text.find(is_outside).unwrap_or(text.len())];
    while ends_with_punctuation(url) {
        url = &url[..url.len() - 1];
    }
    (url.len() > scheme.len()).then_some(url.len())
}

fn ends_with_punctuation(url: &str) -> bool {
    match url.chars().next_back() {
        Some('.' | ',' | ';' | ':' | '!' | '?' | '\'') => true,
        Some(')') => url.matches(')').count() > url.matches('(').count(),
        _ => false,
    }
}

/// Escapes a text for HTML and quoted attributes, with the references of the templates.
fn escaped(text: &str) -> String {
    let mut html = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '"' => html += "&#34;",
            '&' => html += "&#38;",
            '\'' => html += "&#39;",
            '<' => html += "&#60;",
            '>' => html += "&#62;",
            other => html.push(other),
        }
    }
    html
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAGES: [&str; 3] = ["docs/a.md", "docs/scoring.md", "proto/PROTOCOL.md"];

    fn html(path: &str, text: &str) -> String {
        render(path, text, &BTreeSet::from(PAGES)).html
    }

    #[test]
    fn addresses_follow_file_names() {
        assert_eq!(slug("docs/GLOSSARY.md"), "glossary");
        assert_eq!(slug("proto/PROTOCOL.md"), "protocol");
        assert_eq!(slug("docs/decisions/0001-a.md"), "decisions/0001-a");
    }

    #[test]
    fn the_first_heading_is_the_title() {
        let page =
            render("docs/a.md", "# Of `all`\n\nText.\n\n## What it's for, now\n", &BTreeSet::from(PAGES));
        assert_eq!(page.title, "Of all");
        assert_eq!(page.html, "<p>Text.</p>\n<h2 id=\"what-its-for-now\">What it's for, now</h2>\n");
    }

    #[test]
    fn anchors_are_unique() {
        let ids = html("docs/a.md", "# T\n\n## Same\n\n## Same\n\n## Other\n\n### Same\n");
        for id in ["same", "same-1", "same-2", "other"] {
            assert_eq!(ids.matches(&format!("id=\"{id}\"")).count(), 1, "{ids}");
        }
    }

    #[test]
    fn links_lead_to_pages_or_become_text() {
        let text = "[a](scoring.md#spl) [b](../proto/PROTOCOL.md) [c](challenge.toml) [d](https://e.org/x) [e](#here)";
        let expected = "<a href=\"/docs/scoring#spl\">a</a> <a href=\"/docs/protocol\">b</a> c \
                        <a href=\"https://e.org/x\">d</a> <a href=\"#here\">e</a>";
        assert_eq!(html("docs/a.md", text), format!("<p>{expected}</p>\n"));
        let text = "[s](../scoring.md) [n](javascript:alert) [o](../../../../etc)";
        let html = html("docs/decisions/x.md", text);
        assert_eq!(html, "<p><a href=\"/docs/scoring\">s</a> n o</p>\n");
    }

    #[test]
    fn brief_texts_keep_only_safe_links() {
        let text = "**Read** [a](https://e.org/x?b=1&c=2) [b](javascript:alert(1)) [c](/me) [d](#scenes)";
        let expected = "<strong>Read</strong> <a rel=\"nofollow noopener\" href=\"https://e.org/x?b=1&#38;c=2\">a</a> \
                        b c <a href=\"#scenes\">d</a>";
        assert_eq!(brief(text), format!("<p>{expected}</p>\n"));
    }

    #[test]
    fn brief_texts_lose_html_and_images() {
        let text = "<script>alert(1)</script>\n\nA <b onclick=\"x\">bold</b> ![floor *plan*](https://e.org/p.png) & 1 < 2";
        assert_eq!(brief(text), "<p>A bold floor <em>plan</em> &#38; 1 &#60; 2</p>\n");
        assert_eq!(brief("a &lt;i> b"), "<p>a &#60;i&#62; b</p>\n");
        assert_eq!(brief("# Dates\n\n## May\n"), "<h3>Dates</h3>\n<h4>May</h4>\n");
    }

    #[test]
    fn brief_texts_link_bare_urls() {
        let url = "https://e.org/a_b_c";
        let link = format!("<a rel=\"nofollow noopener\" href=\"{url}\">{url}</a>");
        assert_eq!(brief(&format!("See {url}.")), format!("<p>See {link}.</p>\n"));
        assert_eq!(brief(&format!("<{url}>")), format!("<p>{link}</p>\n"), "no link in a link");
        assert_eq!(brief(&format!("`{url}`")), format!("<p><code>{url}</code></p>\n"));
        let block = brief(&format!("    {url}\n"));
        assert_eq!(block, format!("<pre tabindex=\"0\"><code>{url}\n</code></pre>\n"));
    }

    #[test]
    fn charts_are_shown_and_other_images_described() {
        let pages = BTreeSet::from(["docs/images/sr.svg"]);
        let html = |text: &str| render("docs/a.md", text, &pages).html;
        let chart = "<p><img src=\"/docs/images/sr.svg\" alt=\"SR\" /></p>\n";
        assert_eq!(html("![SR](images/sr.svg)"), chart);
        for other in ["images/spl.svg", "images/sr.png", "https://e.org/sr.svg"] {
            assert_eq!(html(&format!("![SR]({other})")), "<p>SR</p>\n", "{other}");
        }
    }

    #[test]
    fn html_is_escaped_and_tables_scroll() {
        let text = "# T\n\n<b onclick=\"x\">hi</b>\n\n| a | b |\n|---|--:|\n| 1 | 2 |\n";
        let html = html("docs/a.md", text);
        assert!(!html.contains("<b") && html.contains("&lt;b onclick"), "{html}");
        assert!(html.contains("aria-label=\"Table 1 of T\"") && !html.contains("style="), "{html}");
    }

    #[test]
    fn urls_become_links_and_markup_text() {
        let link = |url: &str| format!("<a rel=\"nofollow noopener\" href=\"{url}\">{url}</a>");
        for (text, html) in [
            ("a <b> & \"c\"", "a &#60;b&#62; &#38; &#34;c&#34;".to_owned()),
            ("see https://e.org/a?b=1&c=2.", format!("see {}.", link("https://e.org/a?b=1&#38;c=2"))),
            ("(http://e.org), then", format!("({}), then", link("http://e.org"))),
            ("https://e.org/w_(x)", link("https://e.org/w_(x)")),
            ("https://e.org\"onclick=\"x", format!("{}&#34;onclick=&#34;x", link("https://e.org"))),
            ("https://a.org https://b.org", format!("{} {}", link("https://a.org"), link("https://b.org"))),
        ] {
            assert_eq!(linked_html(text), html);
        }
        for plain in ["https://", "https:// e.org", "javascript:alert(1)", "xhttp://e.org", "http"] {
            assert_eq!(linked_html(plain), plain);
        }
    }

    #[test]
    fn only_web_and_page_links_have_tags() {
        let tag = "<a rel=\"nofollow noopener\" href=\"https://e.org/&#34;\">";
        assert_eq!(start_tag("https://e.org/\"").as_deref(), Some(tag));
        assert_eq!(start_tag("#scenes").as_deref(), Some("<a href=\"#scenes\">"));
        for other in ["javascript:alert(1)", "/runs", "data:text/html,x", "mailto:a@e.org", ""] {
            assert_eq!(start_tag(other), None, "{other}");
        }
    }
}
