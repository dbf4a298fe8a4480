//! Style of names, comments and documents, and schemas of the workflows.

use avln_tests::machine::{self, files, root, shown, text};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Openers of a description without a subject.
const HEADLESS: [&str; 10] =
    ["What ", "Who ", "Whoever ", "Which ", "Where ", "Whether ", "How ", "By what ", "So many ", "So that "];

/// Indefinite actors and dated words. The actor is the client, agent, server, organiser, team, referee or visitor.
const BANNED: [&str; 6] = ["nobody", "somebody", "anybody", "whoever", "anew", "in vain"];

/// Names that say nothing about their content.
const EMPTY_NAMES: [&str; 11] =
    ["Options", "Command", "Place", "Thing", "Desk", "Board", "View", "Frame", "Plan", "Report", "Item"];

const MOST_LINES: usize = 500;

/// A file with the path shown in messages.
struct Source {
    path: PathBuf,
    text: String,
}

fn sources(ending: &str) -> Vec<Source> {
    let found = files(&root(), ending).into_iter();
    found.map(|path| Source { text: text(&path), path }).collect()
}

/// Rust files without integration tests, benches and modules of tests.
fn product() -> Vec<Source> {
    let is_product = |path: &Path| {
        let path = shown(path);
        !["tests/", "/tests/", "/benches/", "/examples/"].iter().any(|part| path.contains(part))
            && !path.ends_with("tests.rs")
    };
    let mut sources = sources(".rs");
    sources.retain(|source| is_product(&source.path));
    for source in &mut sources {
        if let Some(at) = source.text.find("#[cfg(test)]\nmod ") {
            source.text.truncate(at);
        }
    }
    sources
}

/// The comment on a line of Rust, if any, without its marks.
fn comment(line: &str) -> Option<&str> {
    let line = line.trim_start();
    let marks = ["///", "//!", "//"];
    let rest = marks.iter().find_map(|mark| line.strip_prefix(mark))?;
    Some(rest.trim_start())
}

fn findings(mut found: Vec<String>) -> String {
    found.truncate(30);
    found.join("\n")
}

#[test]
fn comments_start_with_a_noun_or_a_verb() {
    let mut found = Vec::new();
    for source in product() {
        let mut is_inside = false;
        for (number, line) in (1..).zip(source.text.lines()) {
            let comment = comment(line);
            if let Some(text) = comment.filter(|_| !is_inside)
                && HEADLESS.iter().any(|opener| text.starts_with(opener))
            {
                found.push(format!("{}:{number}: {text}", shown(&source.path)));
            }
            is_inside = comment.is_some();
        }
    }
    assert!(found.is_empty(), "start with a noun or a verb:\n{}", findings(found));
}

#[test]
fn comments_and_documents_name_the_actor() {
    let mut found = Vec::new();
    let mut check = |path: &Path, number: usize, text: &str| {
        let lower = text.to_lowercase();
        let words: Vec<_> = lower.split(|c: char| !c.is_alphabetic()).collect();
        for banned in BANNED {
            let is_used = if banned.contains(' ') { lower.contains(banned) } else { words.contains(&banned) };
            if is_used {
                found.push(format!("{}:{number}: '{banned}' in: {}", shown(path), text.trim()));
            }
        }
    };
    for source in product() {
        for (number, line) in (1..).zip(source.text.lines()) {
            if let Some(text) = comment(line) {
                check(&source.path, number, text);
            }
        }
    }
    for source in sources(".md") {
        for (number, line) in (1..).zip(source.text.lines()) {
            check(&source.path, number, line);
        }
    }
    assert!(found.is_empty(), "name the actor:\n{}", findings(found));
}

/// A type definition at the left margin.
struct Definition {
    crate_folder: String,
    name: String,
    is_public: bool,
    path: PathBuf,
}

fn definitions() -> Vec<Definition> {
    let mut found = Vec::new();
    for source in product() {
        let path = shown(&source.path);
        let Some((crate_folder, _)) = path.split_once("/src/") else { continue };
        for line in source.text.lines() {
            let is_public = line.starts_with("pub ");
            let rest = line.strip_prefix("pub ").or_else(|| line.strip_prefix("pub(crate) ")).unwrap_or(line);
            let rest = rest.strip_prefix("pub(super) ").unwrap_or(rest);
            let Some(rest) = ["struct ", "enum ", "trait "].iter().find_map(|word| rest.strip_prefix(word))
            else {
                continue;
            };
            let name: String = rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
            let crate_folder = crate_folder.to_owned();
            found.push(Definition { crate_folder, name, is_public, path: source.path.clone() });
        }
    }
    found
}

#[test]
fn type_names_are_unique_in_a_crate() {
    let mut places: BTreeMap<(String, String), Vec<String>> = BTreeMap::new();
    for definition in definitions() {
        let key = (definition.crate_folder, definition.name);
        places.entry(key).or_default().push(shown(&definition.path));
    }
    let repeated = places.into_iter().filter(|(_, paths)| paths.len() > 1);
    let found: Vec<_> = repeated.map(|((_, name), paths)| format!("{name}: {}", paths.join(", "))).collect();
    assert!(found.is_empty(), "type names used twice:\n{}", findings(found));
}

#[test]
fn public_type_names_describe_their_content() {
    let empty = definitions().into_iter().filter(|d| d.is_public && EMPTY_NAMES.contains(&d.name.as_str()));
    let found: Vec<_> = empty.map(|d| format!("{} in {}", d.name, shown(&d.path))).collect();
    assert!(found.is_empty(), "names without content:\n{}", findings(found));
}

/// Terms of the glossary: the bold text of its entries, in lower case.
fn glossary_terms() -> BTreeSet<String> {
    let page = text("docs/GLOSSARY.md");
    let entries = page.lines().filter_map(|line| line.strip_prefix("- **")?.split_once("**:"));
    let terms: BTreeSet<_> =
        entries.flat_map(|(terms, _)| terms.split(", ").map(str::to_lowercase).collect::<Vec<_>>()).collect();
    assert!(terms.len() > 50, "docs/GLOSSARY.md has {} entries of the form '- **term**: …'", terms.len());
    terms
}

#[test]
fn glossary_terms_occur_in_code_or_documents() {
    let mut all = String::new();
    for source in
        sources(".rs").into_iter().chain(sources(".md")).chain(sources(".proto")).chain(sources(".html"))
    {
        if !source.path.ends_with("GLOSSARY.md") {
            all.push_str(&source.text.to_lowercase().replace(['_', '-', '\n'], " "));
            all.push(' ');
        }
    }
    let squeezed: String = all.split_whitespace().collect::<Vec<_>>().join(" ");
    let unused: Vec<_> = glossary_terms()
        .into_iter()
        .filter(|term| {
            let plain = term.replace(['_', '-', '`'], " ");
            !squeezed.contains(&plain) && !squeezed.contains(&plain.replace(' ', ""))
        })
        .collect();
    assert!(unused.is_empty(), "glossary terms without use:\n{}", findings(unused));
}

#[test]
fn files_fit_the_limit() {
    let long = product().into_iter().filter(|source| source.text.lines().count() > MOST_LINES);
    let found: Vec<_> = long.map(|source| shown(&source.path)).collect();
    assert!(found.is_empty(), "more than {MOST_LINES} lines:\n{}", findings(found));
}

#[test]
fn workflows_follow_their_schemas() {
    let files = [
        ("vendor.github-workflows", ".github/workflows/ci.yml"),
        ("vendor.github-workflows", ".github/workflows/release.yml"),
        ("vendor.dependabot", ".github/dependabot.yml"),
    ];
    for (schema, file) in files {
        let what = format!("the schema of {file}");
        let python = machine::python(&what, &["check_jsonschema"], "pip install check-jsonschema");
        let Some(mut check) = python else { return };
        check.args(["-m", "check_jsonschema", "--builtin-schema", schema, file]).current_dir(root());
        machine::succeeds(&what, check);
    }
}
