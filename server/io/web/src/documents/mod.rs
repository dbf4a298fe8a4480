//! The repository's documents: groups, pages and search.

mod markdown;

pub(crate) use markdown::{brief, linked_html};

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::{Arc, OnceLock},
};

/// Repository path of the table of contents. Its links are relative to this file.
const SUMMARY: &str = "docs/SUMMARY.md";

/// The documents below `/docs`; none by default. Clones share the content, which is rendered at the first request.
#[derive(Clone, Debug, Default)]
pub struct Documents(Arc<DocumentSources>);

#[derive(Debug, Default)]
struct DocumentSources {
    summary: String,
    /// Markdown and charts (SVG) by repository path.
    files: BTreeMap<String, String>,
    groups: OnceLock<Vec<DocumentGroup>>,
}

/// A part of the table of contents.
#[derive(Debug)]
pub(crate) struct DocumentGroup {
    pub(crate) title: String,
    pub(crate) documents: Vec<Document>,
}

#[derive(Debug)]
pub(crate) struct Document {
    /// Address below `/docs/`.
    pub(crate) slug: String,
    pub(crate) title: String,
    pub(crate) html: String,
    sections: Vec<DocumentSection>,
}

/// A heading with the text below it.
#[derive(Debug)]
pub(crate) struct DocumentSection {
    /// Empty above the first heading.
    pub(crate) heading: String,
    pub(crate) anchor: String,
    /// Text with the heading, in lower case.
    words: String,
}

/// A search result: a document with all words, and its section with the most of them.
#[derive(Debug)]
pub(crate) struct FoundDocument<'a> {
    pub(crate) document: &'a Document,
    pub(crate) section: &'a DocumentSection,
}

impl Documents {
    /// Creates documents from `docs/SUMMARY.md`, a table of contents in the format of mdBook, and from files as repository
    /// path and text: Markdown, and charts in SVG. Entries without a file and Markdown without an entry are omitted.
    pub fn new(summary: &str, files: &[(&str, &str)]) -> Self {
        let files = files.iter().map(|(path, text)| ((*path).to_owned(), (*text).to_owned()));
        let (summary, files) = (summary.to_owned(), files.collect());
        Self(Arc::new(DocumentSources { summary, files, groups: OnceLock::new() }))
    }

    pub(crate) fn groups(&self) -> &[DocumentGroup] {
        self.0.groups.get_or_init(|| self.0.render())
    }

    pub(crate) fn find(&self, slug: &str) -> Option<&Document> {
        self.all().find(|document| document.slug == slug)
    }

    /// Returns the chart `docs/images/FILE` as SVG.
    pub(crate) fn chart(&self, file: &str) -> Option<&str> {
        let is_chart = file.ends_with(markdown::CHART);
        self.0.files.get(&format!("docs/images/{file}")).filter(|_| is_chart).map(String::as_str)
    }

    /// Returns the documents with all `words`, which are in lower case.
    pub(crate) fn search(&self, words: &[String]) -> Vec<FoundDocument<'_>> {
        let found = self.all().filter_map(|document| {
            let section = document.best_section(words)?;
            Some(FoundDocument { document, section })
        });
        found.collect()
    }

    fn all(&self) -> impl Iterator<Item = &Document> {
        self.groups().iter().flat_map(|group| &group.documents)
    }
}

impl DocumentSources {
    fn render(&self) -> Vec<DocumentGroup> {
        let parts = parts(&self.summary);
        let paths = parts.iter().flat_map(|(_, paths)| paths).map(String::as_str);
        let charts = self.files.keys().map(String::as_str).filter(|path| path.ends_with(markdown::CHART));
        let present = paths.filter(|path| self.files.contains_key(*path));
        let pages: BTreeSet<&str> = present.chain(charts).collect();
        let mut groups = Vec::new();
        for (title, paths) in &parts {
            let present = paths.iter().filter_map(|path| Some((path, self.files.get(path)?)));
            let documents: Vec<_> =
                present.map(|(path, text)| markdown::render(path, text, &pages)).collect();
            if !documents.is_empty() {
                groups.push(DocumentGroup { title: title.clone(), documents });
            }
        }
        groups
    }
}

impl DocumentGroup {
    /// Returns true for decision records, which few readers need.
    pub(crate) fn is_folded(&self) -> bool {
        self.documents.iter().all(|document| document.slug.starts_with("decisions/"))
    }
}

impl Document {
    /// Returns the first of the sections with the most words; `None` unless every word is in some section.
    fn best_section(&self, words: &[String]) -> Option<&DocumentSection> {
        let has_all = words.iter().all(|word| self.sections.iter().any(|section| section.has(word)));
        let count = |section: &&DocumentSection| words.iter().filter(|word| section.has(word)).count();
        // From the end, because `max_by_key` returns the last maximum.
        let best = self.sections.iter().rev().max_by_key(count);
        best.filter(|_| has_all)
    }
}

impl DocumentSection {
    fn has(&self, word: &str) -> bool {
        self.words.contains(word)
    }
}

/// Returns the title and the repository paths of each part of a table of contents.
fn parts(summary: &str) -> Vec<(String, Vec<String>)> {
    let mut parts = vec![(String::new(), Vec::new())];
    for line in summary.lines() {
        if let Some(title) = line.strip_prefix("# ") {
            parts.push((title.trim().to_owned(), Vec::new()));
        } else if let Some(link) = link(line)
            && let Some((_, paths)) = parts.last_mut()
        {
            paths.push(markdown::resolve(SUMMARY, link));
        }
    }
    parts
}

fn link(line: &str) -> Option<&str> {
    let (_, rest) = line.split_once("](")?;
    let (link, _) = rest.split_once(')')?;
    Some(link)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONTENTS: &str = "# Summary\n\n# Use\n\n- [A](A.md)\n- [Lost](lost.md)\n  - [B](../proto/B.md)\n\n\
                            # Nothing\n\n# Decisions\n\n- [C](decisions/c.md)\n";

    fn documents() -> Documents {
        let files = [
            ("docs/A.md", "# First\n\nA *red* lamp.\n\n## Blue `lamps`\n\nNew\nlamps shine.\n"),
            ("proto/B.md", "# Second\n\n## Lamps\n\nRed.\n\n## Lamps\n\nGreen, red, ÉTÉ.\n"),
            ("docs/decisions/c.md", "# Third\n\nNothing.\n"),
            ("docs/hidden.md", "# Hidden\n\nA red lamp.\n"),
            ("docs/images/c.svg", "<svg/>"),
        ];
        Documents::new(CONTENTS, &files)
    }

    /// Searches for words; returns the addresses and headings of the results.
    fn found(words: &str) -> Vec<(String, String)> {
        let words: Vec<String> = words.split_whitespace().map(str::to_owned).collect();
        let documents = documents();
        let found = documents.search(&words).into_iter().map(|found| {
            (format!("{}#{}", found.document.slug, found.section.anchor), found.section.heading.clone())
        });
        found.collect()
    }

    fn result(address: &str, heading: &str) -> (String, String) {
        (address.to_owned(), heading.to_owned())
    }

    #[test]
    fn groups_follow_the_table_of_contents() {
        let documents = documents();
        let [used, decided] = documents.groups() else { panic!("two groups: {documents:?}") };
        let slugs = |group: &DocumentGroup| {
            group.documents.iter().map(|document| document.slug.clone()).collect::<Vec<_>>()
        };
        assert_eq!((used.title.as_str(), slugs(used)), ("Use", vec!["a".to_owned(), "b".to_owned()]));
        assert_eq!((decided.title.as_str(), slugs(decided)), ("Decisions", vec!["decisions/c".to_owned()]));
        assert!(!used.is_folded() && decided.is_folded());
        assert_eq!(documents.find("b").map(|document| document.title.as_str()), Some("Second"));
        assert!(documents.find("hidden").is_none() && documents.find("lost").is_none());
        assert!(Documents::default().groups().is_empty());
    }

    #[test]
    fn charts_are_the_only_images() {
        assert_eq!(documents().chart("c.svg"), Some("<svg/>"));
        assert_eq!((documents().chart("d.svg"), documents().chart("../A.md")), (None, None));
    }

    #[test]
    fn results_name_the_best_section() {
        assert_eq!(found("red lamp"), [result("a#", ""), result("b#lamps", "Lamps")]);
        assert_eq!(found("lamps shine"), [result("a#blue-lamps", "Blue lamps")]);
        assert_eq!(found("red green"), [result("b#lamps-1", "Lamps")]);
        assert_eq!(found("été second"), [result("b#", "")]);
    }

    #[test]
    fn results_have_all_words() {
        assert!(found("red absent").is_empty());
        assert_eq!(found("first shine"), [result("a#", "")]);
        assert!(found("newlamps").is_empty());
    }
}
