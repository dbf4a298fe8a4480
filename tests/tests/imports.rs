//! Who may import whom: the edges between our crates are this list and no others.

use serde_json::Value;
use std::collections::BTreeSet;
use std::process::Command;

/// Each crate and the crates of ours that it may import.
const ALLOWED: &[(&str, &[&str])] = &[
    ("geom", &[]),
    ("scene", &["geom"]),
    ("navmesh", &["geom", "scene"]),
    ("simd", &[]),
    ("render", &["geom", "simd", "scene"]),
    ("acoustics", &["geom", "simd", "scene"]),
    ("world", &["geom", "scene", "navmesh", "render", "acoustics"]),
    ("episode", &["geom"]),
    ("challenge", &["episode"]),
    ("truth", &["geom", "episode"]),
    ("dataset", &["geom", "scene", "navmesh", "world", "episode", "truth"]),
    ("referee", &["world", "episode", "truth"]),
    ("scoring", &["geom", "episode", "truth"]),
    ("store", &["challenge", "episode", "truth", "scoring"]),
    ("proto", &[]),
    ("codec", &["proto"]),
    ("sandbox", &[]),
    ("net", &[]),
    ("grpc", &["codec", "net", "proto", "challenge", "episode", "referee"]),
    ("web", &["net", "challenge", "episode", "scoring", "store"]),
    ("client", &["codec", "proto"]),
    ("conformance", &["proto"]),
    ("kit", &["client", "perception"]),
    ("perception", &["simd"]),
    ("human", &["client"]),
    ("random", &["client"]),
    ("baselines", &["client", "kit"]),
    ("onnx", &["client", "kit"]),
    ("pag-nav", &["client", "kit", "onnx"]),
    (
        "server",
        &[
            "geom",
            "scene",
            "simd",
            "navmesh",
            "render",
            "acoustics",
            "world",
            "episode",
            "challenge",
            "truth",
            "dataset",
            "referee",
            "scoring",
            "store",
            "proto",
            "codec",
            "net",
            "sandbox",
            "grpc",
            "web",
            "client",
            "conformance",
            "kit",
            "human",
            "random",
            "baselines",
            "pag-nav",
        ],
    ),
    ("tests", &["server", "client", "human", "challenge", "store", "truth", "dataset", "perception"]),
];

fn short(name: &str) -> Option<&str> {
    name.strip_prefix("avln-")
}

/// (importer, imported) of all kinds of dependencies, as cargo sees them.
fn edges(metadata: &Value) -> BTreeSet<(String, String)> {
    let packages = metadata["packages"].as_array().expect("cargo lists packages");
    let edges_of = |package: &Value| {
        let from = short(package["name"].as_str()?)?.to_owned();
        let imported = package["dependencies"].as_array()?.iter().filter_map(|d| short(d["name"].as_str()?));
        Some(imported.map(|to| (from.clone(), to.to_owned())).collect::<Vec<_>>())
    };
    packages.iter().filter_map(edges_of).flatten().collect()
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
fn crates_import_only_what_the_table_allows() {
    let allowed: BTreeSet<_> = ALLOWED
        .iter()
        .flat_map(|(from, to)| to.iter().map(|to| ((*from).to_owned(), (*to).to_owned())))
        .collect();
    let forbidden: Vec<_> = edges(&metadata()).difference(&allowed).cloned().collect();
    assert!(forbidden.is_empty(), "edges outside of the table: {forbidden:?}");
}

#[test]
fn every_crate_is_in_the_table_and_on_the_architecture_page() {
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
fn the_check_sees_a_forbidden_edge() {
    let sample = serde_json::json!({ "packages": [
        { "name": "avln-grpc", "dependencies": [{ "name": "avln-truth" }, { "name": "tokio" }] }
    ]});
    assert_eq!(edges(&sample), BTreeSet::from([("grpc".to_owned(), "truth".to_owned())]));
}

#[test]
fn the_clients_tree_holds_no_crate_of_the_server() {
    let metadata = metadata();
    let packages = metadata["packages"].as_array().expect("cargo lists packages");
    let root = metadata["workspace_root"].as_str().expect("a path");
    let lies_in_server = |name: &str| {
        let is_meant = |package: &&Value| package["name"].as_str().and_then(short) == Some(name);
        let package = packages.iter().find(is_meant).expect("a package of ours");
        let path = package["manifest_path"].as_str().and_then(|path| path.strip_prefix(root));
        path.expect("it lies in the workspace").replace('\\', "/").starts_with("/server/")
    };
    let edges = edges(&metadata);
    let (mut tree, mut open) = (BTreeSet::new(), vec!["client"]);
    while let Some(next) = open.pop() {
        if tree.insert(next) {
            open.extend(edges.iter().filter(|(from, _)| from == next).map(|(_, to)| to.as_str()));
        }
    }
    assert!(lies_in_server("grpc"), "the check sees what lies there");
    assert_eq!(tree, BTreeSet::from(["client", "codec", "proto"]));
    assert!(!tree.iter().any(|name| lies_in_server(name)));
}
