//! Every SQL statement of the crate is valid for the current schema.

use crate::fixture::{Arena, phase};
use sqlx::{AssertSqlSafe, ConnectOptions, Executor, SqlSafeStr, sqlite::SqliteConnectOptions};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Returns the string literals of Rust source text, unescaped. Comments and raw strings are not special: the crate's contain no
/// SQL.
fn literals(source: &str) -> Vec<String> {
    let mut literals = Vec::new();
    let mut rest = source;
    while let Some(start) = rest.find('"') {
        let mut text = String::new();
        let mut chars = rest[start + 1..].char_indices();
        let mut end = rest.len();
        while let Some((at, char)) = chars.next() {
            match char {
                '"' => {
                    end = start + 1 + at + 1;
                    break;
                }
                // A backslash at the end of a line continues the literal after the indentation.
                '\\' if chars.as_str().starts_with('\n') => {
                    let indentation = chars.as_str().len() - chars.as_str().trim_start().len();
                    for _ in 0..indentation {
                        chars.next();
                    }
                }
                '\\' => text.extend(chars.next().map(|(_, escaped)| escaped)),
                char => text.push(char),
            }
        }
        literals.push(text);
        rest = &rest[end..];
    }
    literals
}

fn sources(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path());
    entries.flat_map(|path| if path.is_dir() { sources(&path) } else { vec![path] }).collect()
}

#[tokio::test]
async fn statements_fit_the_schema() {
    let arena = Arena::new(&phase("practice", 1)).await;
    let mut connection =
        SqliteConnectOptions::new().filename(arena.path()).connect().await.expect("a connection");
    let mut count = 0;
    for path in sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src")) {
        let source = fs::read_to_string(&path).expect("a source file");
        for literal in literals(&source) {
            let is_statement = ["SELECT ", "INSERT ", "UPDATE ", "DELETE ", "VACUUM "]
                .iter()
                .any(|verb| literal.starts_with(verb));
            if is_statement {
                let prepared = connection.prepare(AssertSqlSafe(literal.clone()).into_sql_str()).await;
                prepared.unwrap_or_else(|error| panic!("{}: {literal}: {error}", path.display()));
                count += 1;
            }
        }
    }
    assert!(count > 80, "only {count} statements were found");
    connection
        .prepare(AssertSqlSafe("SELECT wrong FROM runs").into_sql_str())
        .await
        .expect_err("no such column");
}
