//! Markdown to HTML.

use super::address;
use pulldown_cmark::{CowStr, Event, HeadingLevel, Options, Parser, Tag, TagEnd, html};

/// Renders the document at `path` and returns its title (the first heading) and the HTML below it.
///
/// Links to other documents lead to their pages; links to other files become plain text. Tables scroll. HTML in the
/// text is escaped.
pub(super) fn render(path: &str, text: &str) -> (String, String) {
    let events: Vec<Event> = Parser::new_ext(text, Options::ENABLE_TABLES).collect();
    let (title, rest) = split_title(events);
    let events = framed(anchored(linked(path, rest.into_iter().map(harmless).collect())), &title);
    let mut html = String::new();
    html::push_html(&mut html, events.into_iter());
    // Scrollable blocks must be reachable by keyboard (accessibility).
    let html = html.replace("<pre>", "<pre tabindex=\"0\">");
    (title, html)
}

/// Splits off the first heading.
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
                linked.extend(
                    target.map(|target| {
                        Event::Start(Tag::Link { link_type, dest_url: target.into(), title, id })
                    }),
                );
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

/// Adds ids to headings, for links.
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

/// Wraps tables into scrollable regions with accessible names.
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

    #[test]
    fn the_first_heading_is_the_title() {
        let (title, html) = render("docs/a.md", "# Of `all`\n\nText.\n\n## What it's for, now\n");
        assert_eq!(title, "Of all");
        assert_eq!(html, "<p>Text.</p>\n<h2 id=\"what-its-for-now\">What it's for, now</h2>\n");
    }

    #[test]
    fn links_lead_to_pages_or_become_text() {
        let text = "[a](scoring.md#spl) [b](../proto/PROTOCOL.md) [c](challenge.toml) [d](https://e.org/x) [e](#here)";
        let (_, html) = render("docs/a.md", text);
        let expected = "<a href=\"/docs/scoring#spl\">a</a> <a href=\"/docs/protocol\">b</a> c \
                        <a href=\"https://e.org/x\">d</a> <a href=\"#here\">e</a>";
        assert_eq!(html, format!("<p>{expected}</p>\n"));
        let (_, html) =
            render("docs/decisions/x.md", "[s](../scoring.md) [n](javascript:alert) [o](../../../../etc)");
        assert_eq!(html, "<p><a href=\"/docs/scoring\">s</a> n o</p>\n");
    }

    #[test]
    fn html_is_escaped_and_tables_scroll() {
        let (_, html) =
            render("docs/a.md", "# T\n\n<b onclick=\"x\">hi</b>\n\n| a | b |\n|---|--:|\n| 1 | 2 |\n");
        assert!(!html.contains("<b") && html.contains("&lt;b onclick"), "{html}");
        assert!(html.contains("aria-label=\"Table 1 of T\"") && !html.contains("style="), "{html}");
    }
}
