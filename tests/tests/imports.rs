//! Dependencies between our crates are limited to this list.

use serde_json::Value;
use std::collections::BTreeSet;
use std::process::Command;

/// Permitted imports per crate.
const ALLOWED: &[(&str, &[&str])] = &[
    ("geom", &[]),
    ("scene", &["geom"]),
    ("formats", &["geom", "scene"]),
    ("houses", &["geom", "scene"]),
    ("navmesh", &["geom", "scene"]),
    ("simd", &[]),
    ("render", &["geom", "simd", "scene"]),
    ("acoustics", &["geom", "simd", "scene"]),
    ("world", &["geom", "scene", "navmesh", "render", "acoustics"]),
    ("episode", &["geom"]),
    ("challenge", &["episode"]),
    ("truth", &["geom", "episode"]),
    ("dataset", &["geom", "scene", "formats", "houses", "navmesh", "world", "episode", "truth"]),
    ("interchange", &["geom", "scene", "world", "episode", "truth", "dataset"]),
    ("referee", &["world", "episode", "truth"]),
    ("scoring", &["geom", "episode", "truth"]),
    ("store", &["challenge", "episode", "truth", "scoring"]),
    ("proto", &[]),
    ("sandbox", &[]),
    ("net", &[]),
    ("grpc", &["net", "proto", "challenge", "episode", "referee"]),
    ("web", &["net", "challenge", "episode", "scoring", "store"]),
    ("client", &["proto"]),
    ("conformance", &["proto"]),
    ("kit", &["client", "perception"]),
    ("perception", &["simd"]),
    ("human", &["client", "kit"]),
    ("baselines", &["client", "kit"]),
    ("pag-nav", &["client", "kit"]),
    ("docs", &[]),
    ("training", &["dataset", "episode", "geom", "houses", "referee", "truth", "world"]),
    ("native", &["episode", "referee", "training", "world"]),
    (
        "arena",
        &[
            "formats",
            "houses",
            "acoustics",
            "challenge",
            "dataset",
            "episode",
            "geom",
            "grpc",
            "net",
            "referee",
            "render",
            "scene",
            "scoring",
            "simd",
            "store",
            "truth",
            "web",
            "world",
        ],
    ),
    (
        "lab",
        &[
            "arena",
            "baselines",
            "client",
            "dataset",
            "episode",
            "formats",
            "geom",
            "houses",
            "interchange",
            "kit",
            "pag-nav",
            "perception",
            "proto",
            "referee",
            "render",
            "scene",
            "scoring",
            "store",
            "truth",
            "world",
        ],
    ),
    (
        "cli",
        &[
            "acoustics",
            "arena",
            "baselines",
            "client",
            "conformance",
            "dataset",
            "docs",
            "episode",
            "formats",
            "geom",
            "houses",
            "grpc",
            "human",
            "interchange",
            "kit",
            "lab",
            "navmesh",
            "pag-nav",
            "referee",
            "render",
            "sandbox",
            "scene",
            "scoring",
            "store",
            "web",
            "world",
        ],
    ),
    (
        "tests",
        &["arena", "lab", "cli", "client", "human", "challenge", "store", "truth", "dataset", "perception"],
    ),
];

/// Imports permitted only in tests and benches.
const ALLOWED_IN_TESTS: &[(&str, &[&str])] = &[
    // Itself, with all features.
    ("formats", &["formats", "houses"]),
    ("navmesh", &["formats", "houses"]),
    ("render", &["formats", "houses"]),
    ("acoustics", &["formats", "houses"]),
    ("world", &["houses"]),
    ("interchange", &["houses"]),
    ("training", &["scoring"]),
    // Agents of the simulation, which send arbitrary frames.
    ("arena", &["proto"]),
    // Agents of the soak, which resume the run of a killed process; the Python module, built for its tests.
    ("tests", &["proto", "native"]),
];

fn short(name: &str) -> Option<&str> {
    name.strip_prefix("avln-")
}

/// (importer, imported) for dependencies of the selected kinds: `None`, `dev` or `build`.
fn edges(metadata: &Value, is_meant: fn(Option<&str>) -> bool) -> BTreeSet<(String, String)> {
    let packages = metadata["packages"].as_array().expect("cargo lists packages");
    let edges_of = |package: &Value| {
        let from = short(package["name"].as_str()?)?.to_owned();
        let dependencies = package["dependencies"].as_array()?.iter();
        let meant = dependencies.filter(|dependency| is_meant(dependency["kind"].as_str()));
        let imported = meant.filter_map(|dependency| short(dependency["name"].as_str()?));
        Some(imported.map(|to| (from.clone(), to.to_owned())).collect::<Vec<_>>())
    };
    packages.iter().filter_map(edges_of).flatten().collect()
}

fn table(rows: &[(&str, &[&str])]) -> BTreeSet<(String, String)> {
    rows.iter().flat_map(|(from, to)| to.iter().map(|to| ((*from).to_owned(), (*to).to_owned()))).collect()
}

fn metadata() -> Value {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--no-deps", "--format-version", "1", "--offline"])
        .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
        .output()
        .expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("cargo writes JSON")
}

#[test]
fn crates_import_only_permitted_crates() {
    let metadata = metadata();
    let mut allowed = table(ALLOWED);
    let forbidden: Vec<_> =
        edges(&metadata, |kind| kind != Some("dev")).difference(&allowed).cloned().collect();
    assert!(forbidden.is_empty(), "edges outside of the table: {forbidden:?}");
    allowed.extend(table(ALLOWED_IN_TESTS));
    let forbidden: Vec<_> = edges(&metadata, |_| true).difference(&allowed).cloned().collect();
    assert!(forbidden.is_empty(), "edges of tests outside of the tables: {forbidden:?}");
}

#[test]
fn every_crate_is_in_table_and_architecture_page() {
    let metadata = metadata();
    let names: BTreeSet<_> = metadata["packages"]
        .as_array()
        .expect("cargo lists packages")
        .iter()
        .filter_map(|package| short(package["name"].as_str()?))
        .collect();
    let table: BTreeSet<_> = ALLOWED.iter().map(|(name, _)| *name).collect();
    assert_eq!(names, table);
    let page = include_str!("../../docs/ARCHITECTURE.md");
    for name in names {
        assert!(
            page.contains(&format!("`avln-{name}`")),
            "docs/ARCHITECTURE.md does not mention avln-{name}"
        );
    }
}

#[test]
fn check_detects_forbidden_import() {
    let sample = serde_json::json!({ "packages": [
        { "name": "avln-grpc", "dependencies": [{ "name": "avln-truth" }, { "name": "tokio" }] }
    ]});
    assert_eq!(edges(&sample, |_| true), BTreeSet::from([("grpc".to_owned(), "truth".to_owned())]));
}

#[test]
fn client_depends_on_no_server_crate() {
    let metadata = metadata();
    let packages = metadata["packages"].as_array().expect("cargo lists packages");
    let root = metadata["workspace_root"].as_str().expect("a path");
    let lies_in_server = |name: &str| {
        let is_meant = |package: &&Value| package["name"].as_str().and_then(short) == Some(name);
        let package = packages.iter().find(is_meant).expect("a package of ours");
        let path = package["manifest_path"].as_str().and_then(|path| path.strip_prefix(root));
        path.expect("it lies in the workspace").replace('\\', "/").starts_with("/server/")
    };
    let edges = edges(&metadata, |_| true);
    let (mut tree, mut open) = (BTreeSet::new(), vec!["client"]);
    while let Some(next) = open.pop() {
        if tree.insert(next) {
            open.extend(edges.iter().filter(|(from, _)| from == next).map(|(_, to)| to.as_str()));
        }
    }
    assert!(lies_in_server("grpc"), "the check sees what lies there");
    assert_eq!(tree, BTreeSet::from(["client", "proto"]));
    assert!(!tree.iter().any(|name| lies_in_server(name)));
}
