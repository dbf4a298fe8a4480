//! Links from URLs in plain text.

const SCHEMES: [&str; 2] = ["https://", "http://"];

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
pub(crate) fn start_tag(address: &str) -> Option<String> {
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
