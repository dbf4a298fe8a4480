/// Attributes whose values are addresses.
const ATTRIBUTES: [&str; 3] = [" href=\"", " src=\"", " action=\""];

/// The name of the file that an address becomes.
pub(super) fn file_of(address: &str) -> String {
    let (path, query) = address.split_once('?').unwrap_or((address, ""));
    let path = path.trim_start_matches('/');
    let query: String =
        query
            .chars()
            .map(|letter| {
                if letter.is_ascii_alphanumeric() || matches!(letter, '-' | '_' | '.') { letter } else { '-' }
            })
            .collect();
    let mark = if query.is_empty() { "" } else { "-by-" };
    let data = path.strip_prefix("api/v1/");
    let (folder, path) = data.map_or(("", path), |path| ("data/", path));
    let ending =
        ["css", "js", "svg", "csv", "json"].into_iter().find(|end| path.ends_with(&format!(".{end}")));
    let usual = if data.is_some() { "json" } else { "html" };
    let (stem, ending) = ending.map_or((path, usual), |end| (&path[..path.len() - end.len() - 1], end));
    format!("{folder}{stem}{mark}{query}.{ending}")
}

/// The way from one file to another.
pub(super) fn relative(from: &str, to: &str) -> String {
    let mut from: Vec<&str> = from.split('/').collect();
    let mut to: Vec<&str> = to.split('/').collect();
    from.pop();
    let common = from.iter().zip(&to[..to.len() - 1]).take_while(|(a, b)| a == b).count();
    let mut way = vec![".."; from.len() - common];
    way.extend(to.drain(common..));
    way.join("/")
}

/// A page whose links lead where `to_file` says. Links of which it knows nothing lead nowhere any more, but for those to other sites.
pub(super) fn rewritten(html: &str, to_file: &mut dyn FnMut(&str) -> Option<String>) -> String {
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

/// What an address becomes; `None` for nothing.
fn new_value(value: &str, to_file: &mut dyn FnMut(&str) -> Option<String>) -> Option<String> {
    let is_elsewhere = !value.starts_with('/') || value.starts_with("//");
    if is_elsewhere {
        return Some(value.to_owned());
    }
    let address = value.replace("&#38;", "&").replace("&amp;", "&");
    let (address, place) = address.split_once('#').map_or((address.as_str(), ""), |(a, place)| (a, place));
    let mark = if place.is_empty() { "" } else { "#" };
    to_file(address).map(|file| format!("{file}{mark}{place}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_become_names_of_files() {
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
    fn ways_between_files_are_relative() {
        assert_eq!(relative("index.html", "runs/r.html"), "runs/r.html");
        assert_eq!(relative("runs/r/episodes/0.html", "assets/app.css"), "../../../assets/app.css");
        assert_eq!(relative("runs/r/episodes/0.html", "runs/r.html"), "../../r.html");
        assert_eq!(relative("runs/r/episodes/0.html", "runs/r/episodes/1.html"), "1.html");
    }

    #[test]
    fn links_lead_to_files_or_nowhere_and_text_stays() {
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
