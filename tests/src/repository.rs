//! Files in this repository.

use std::{
    fs,
    path::{Path, PathBuf},
};

/// Root folder.
pub fn root() -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("this crate lies in the repository");
    root.to_owned()
}

/// Files below `folder` with the given ending, without hidden folders, build outputs and installed packages.
pub fn files(folder: &Path, ending: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    collect(folder, ending, &mut found);
    found.sort();
    found
}

fn collect(folder: &Path, ending: &str, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a readable folder") {
        let path = entry.expect("a readable entry").path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let skipped = name.starts_with('.') || ["target", "node_modules"].contains(&name.as_str());
        if path.is_dir() && !skipped {
            collect(&path, ending, found);
        } else if path.is_file() && name.ends_with(ending) {
            found.push(path);
        }
    }
}

/// File text, by repository path.
pub fn text(path: impl AsRef<Path>) -> String {
    let path = root().join(path);
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// A path as messages show it.
pub fn shown(path: &Path) -> String {
    path.strip_prefix(root()).unwrap_or(path).display().to_string()
}

/// Commands in a document: lines after `$` in `console` blocks.
pub fn typed(document: &str) -> Vec<String> {
    let blocks = document.split("```").skip(1).step_by(2);
    let consoles = blocks.filter_map(|block| block.strip_prefix("console\n"));
    let lines = consoles.map(|code| code.replace("\\\n", " "));
    lines.flat_map(|code| code.lines().filter_map(in_console).collect::<Vec<_>>()).collect()
}

fn in_console(line: &str) -> Option<String> {
    line.strip_prefix("$ ").map(str::to_owned)
}
