//! The migrations folder.

use std::{fs, path::PathBuf};

fn migrations() -> Vec<(String, String)> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../migrations");
    let entries =
        fs::read_dir(folder).expect("the migrations folder").map(|entry| entry.expect("an entry").path());
    let read = |path: PathBuf| {
        let name = path.file_name().expect("a name").to_string_lossy().into_owned();
        (name, fs::read_to_string(path).expect("a migration"))
    };
    entries.map(read).collect()
}

#[test]
fn every_migration_of_the_folder_is_built_in() {
    assert_eq!(migrations().len() as i64, avln_store::SCHEMA_VERSION);
}

#[test]
fn every_table_and_column_says_what_it_is() {
    for (name, sql) in migrations() {
        let mut above = "";
        for line in sql.lines() {
            if line.starts_with("CREATE TABLE") {
                assert!(above.starts_with("-- "), "{name}: '{line}' has no comment above");
            }
            let word = line.strip_prefix("  ").and_then(|rest| rest.split_whitespace().next()).unwrap_or("");
            if word.starts_with(|first: char| first.is_ascii_lowercase()) {
                assert!(line.contains(" -- "), "{name}: column {word} has no comment");
            }
            above = line;
        }
    }
}
