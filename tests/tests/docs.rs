//! The repository reads as it should: links lead somewhere, files and functions stay short, nothing is left half done.

use avln_tests::repository::{files, root, shown};
use std::{fs, path::PathBuf};

const MAX_FILE_LINES: usize = 500;
const MAX_FUNCTION_LINES: usize = 70;

fn sources() -> Vec<(PathBuf, String)> {
    let paths = files(&root(), ".rs");
    assert!(paths.len() > 100, "the sources are found: {}", paths.len());
    paths.into_iter().map(|path| (path.clone(), fs::read_to_string(&path).expect("a text"))).collect()
}

/// Targets of the Markdown links in `text`, without code blocks.
fn links(text: &str) -> Vec<String> {
    let prose: String = text.split("```").step_by(2).collect();
    let target = |rest: &str| rest.split([')', ' ', '#']).next().unwrap_or_default().to_owned();
    prose.split("](").skip(1).map(target).collect()
}

#[test]
fn links_in_the_documentation_lead_to_files() {
    let pages = files(&root(), ".md");
    let mut broken = Vec::new();
    for page in &pages {
        let text = fs::read_to_string(page).expect("a text");
        let folder = page.parent().expect("a page lies in a folder");
        let relative =
            |link: &String| !link.is_empty() && !link.contains("://") && !link.starts_with("mailto:");
        let dead = |link: &String| !folder.join(link).exists();
        let dead = links(&text).into_iter().filter(relative).filter(dead);
        broken.extend(dead.map(|link| format!("{}: {link}", shown(page))));
    }
    assert!(pages.iter().any(|page| page.ends_with("docs/ARCHITECTURE.md")));
    assert_eq!(broken, Vec::<String>::new());
    assert_eq!(links("[a](b.md#c) ```[d](e)``` [f](g)"), ["b.md", "g"]);
}

#[test]
fn no_source_file_is_longer_than_a_reader_can_hold() {
    let long = |(path, text): &(PathBuf, String)| {
        let lines = text.lines().count();
        (lines > MAX_FILE_LINES).then(|| format!("{}: {lines} lines", shown(path)))
    };
    assert_eq!(sources().iter().filter_map(long).collect::<Vec<_>>(), Vec::<String>::new());
}

/// Functions as rustfmt writes them: from the line that names one to the brace at its indentation.
/// Gives the name's line and the number of lines.
fn functions(text: &str) -> Vec<(&str, usize)> {
    let lines: Vec<&str> = text.lines().collect();
    let mut found = Vec::new();
    for (first, line) in lines.iter().enumerate() {
        let code = line.trim_start();
        let words = code.split_whitespace().take_while(|word| *word != "fn");
        let modifiers = ["pub", "pub(crate)", "pub(super)", "async", "const", "extern", "\"C\""];
        let is_function = code.split_whitespace().any(|word| word == "fn")
            && words.into_iter().all(|word| modifiers.contains(&word));
        if !is_function || code.ends_with(';') || code.ends_with('}') {
            continue;
        }
        let opens_body = lines[first..].iter().find(|line| line.ends_with(['{', ';', '}']));
        if opens_body.is_none_or(|line| line.ends_with(';')) {
            continue;
        }
        let end = format!("{}}}", &line[..line.len() - code.len()]);
        let length = lines[first..].iter().position(|line| *line == end);
        found.extend(length.map(|length| (code, length + 1)));
    }
    found
}

#[test]
fn no_function_is_longer_than_a_screen() {
    let mut long = Vec::new();
    let mut count = 0;
    for (path, text) in &sources() {
        let found = functions(text);
        count += found.len();
        let too_long = found.into_iter().filter(|(_, lines)| *lines > MAX_FUNCTION_LINES);
        long.extend(too_long.map(|(name, lines)| format!("{}: {lines} lines: {name}", shown(path))));
    }
    assert!(count > 1000, "functions are found: {count}");
    assert_eq!(long, Vec::<String>::new());
    let example = "impl A {\n    pub async fn b() {\n        if c {\n        }\n    }\n    fn d();\n}";
    assert_eq!(functions(example), [("pub async fn b() {", 4)]);
}

#[test]
fn nothing_is_left_half_done() {
    // Put together here, so that this file does not find itself.
    let marks =
        [["TO", "DO"], ["FIX", "ME"], ["XX", "X"], ["dbg", "!("], ["todo", "!("], ["unimplemented", "!("]];
    let marks = marks.map(|parts| parts.concat());
    let mut left = Vec::new();
    for (path, text) in &sources() {
        for (number, line) in text.lines().enumerate() {
            if marks.iter().any(|mark| line.contains(mark)) {
                left.push(format!("{}:{}: {}", shown(path), number + 1, line.trim()));
            }
        }
    }
    assert_eq!(left, Vec::<String>::new());
}
