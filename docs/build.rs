//! Writes the list of documents from the links in the table of contents.

use std::{env, error::Error, fmt::Write, fs, path::PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=SUMMARY.md");
    let summary = fs::read_to_string("SUMMARY.md")?;
    let mut files = String::from("&[\n");
    for link in summary.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
        let path = link.strip_prefix("../").map_or_else(|| format!("docs/{link}"), str::to_owned);
        let file = format!("/{link}");
        writeln!(files, "({path:?}, include_str!(concat!(env!(\"CARGO_MANIFEST_DIR\"), {file:?}))),")?;
    }
    files.push(']');
    fs::write(PathBuf::from(env::var("OUT_DIR")?).join("files.rs"), files)?;
    Ok(())
}
