//! Writes the list of documents from the links in the table of contents, and of the charts in `images`.

use std::{env, error::Error, fmt::Write, fs, io, path::PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=SUMMARY.md");
    println!("cargo::rerun-if-changed=images");
    let summary = fs::read_to_string("SUMMARY.md")?;
    let links = summary.split("](").skip(1).filter_map(|rest| rest.split(')').next()).map(str::to_owned);
    let mut files = String::from("&[\n");
    for link in links.chain(charts()?) {
        let path = link.strip_prefix("../").map_or_else(|| format!("docs/{link}"), str::to_owned);
        let file = format!("/{link}");
        writeln!(files, "({path:?}, include_str!(concat!(env!(\"CARGO_MANIFEST_DIR\"), {file:?}))),")?;
    }
    files.push(']');
    fs::write(PathBuf::from(env::var("OUT_DIR")?).join("files.rs"), files)?;
    Ok(())
}

/// Returns the charts in the folder `images`, sorted by name.
fn charts() -> Result<Vec<String>, io::Error> {
    let names = fs::read_dir("images")?.map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned()));
    let mut names: Vec<String> = names.collect::<Result<_, io::Error>>()?;
    names.retain(|name| name.ends_with(".svg"));
    names.sort();
    Ok(names.into_iter().map(|name| format!("images/{name}")).collect())
}
