//! Dependencies between our crates are limited to this list.

use avln_tests::machine::{files, root, shown, text};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::PathBuf;
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
    ("kit", &["client", "perception", "simd"]),
    ("perception", &["simd"]),
    ("human", &["client", "kit"]),
    ("baselines", &["client", "kit"]),
    ("pag-nav", &["client", "kit"]),
    ("docs", &[]),
    ("training", &["dataset", "episode", "geom", "houses", "referee", "scoring", "truth", "world"]),
    ("native", &["episode", "formats", "referee", "training", "world"]),
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

/// The decoders of compressed scenes take long to compile.
#[test]
fn programs_decode_compressed_scenes_other_crates_do_not() {
    let metadata = metadata();
    let packages = metadata["packages"].as_array().expect("cargo lists packages").iter();
    let decodes = |package: &&Value| {
        let mut dependencies = package["dependencies"].as_array().expect("a list").iter();
        dependencies.any(|dependency| {
            let features = dependency["features"].as_array().expect("a list");
            dependency["name"] == "avln-formats" && features.contains(&"compressed".into())
        })
    };
    let names: BTreeSet<_> =
        packages.filter(decodes).filter_map(|package| package["name"].as_str()).collect();
    assert_eq!(names, BTreeSet::from(["avln-cli", "avln-formats", "avln-native"]));
}

#[test]
fn check_detects_forbidden_import() {
    let sample = serde_json::json!({ "packages": [
        { "name": "avln-grpc", "dependencies": [{ "name": "avln-truth" }, { "name": "tokio" }] }
    ]});
    assert_eq!(edges(&sample, |_| true), BTreeSet::from([("grpc".to_owned(), "truth".to_owned())]));
}

#[test]
fn published_crates_have_example_and_metadata() {
    let metadata = metadata();
    let packages = metadata["packages"].as_array().expect("cargo lists packages").iter();
    let published: Vec<_> = packages.filter(|package| package["publish"].is_null()).collect();
    assert_eq!(published.len(), 5, "the check sees the crates of participants");
    for package in published {
        for field in ["description", "readme", "repository", "license"] {
            assert!(package[field].is_string(), "{}: {field}", package["name"]);
        }
        let lists = ["categories", "keywords"].map(|field| package[field].as_array().expect("a list").len());
        assert!(!lists.contains(&0), "{}: {lists:?}", package["name"]);
        let manifest = PathBuf::from(package["manifest_path"].as_str().expect("a path"));
        let front = std::fs::read_to_string(manifest.with_file_name("src/lib.rs")).expect("a library");
        let opens = front.lines().filter(|line| line.starts_with("//! ```")).step_by(2);
        assert!(opens.into_iter().any(|line| line == "//! ```"), "{}: an example that runs", package["name"]);
        assert!(package["metadata"]["docs"]["rs"].is_object(), "{}: how docs.rs builds it", package["name"]);
    }
}

#[test]
fn servers_use_no_additions_for_training() {
    let additions = ["with_added_submits", "with_detail", "with_instances", "render_at"];
    let users = |folder: &str| {
        let found = files(&root().join(folder), ".rs").into_iter();
        let uses = |path: &PathBuf| additions.iter().any(|name| text(path).contains(name));
        found.filter(uses).map(|path| shown(&path)).collect::<Vec<_>>()
    };
    assert!(!users("server/training").is_empty(), "the check sees the additions");
    for folder in ["server/arena", "server/io", "cli", "lab", "agents"] {
        assert_eq!(users(folder), Vec::<String>::new());
    }
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

/// Imports between the files of a crate.
mod circles {
    use avln_tests::machine::{files, root, shown, text};
    use std::collections::{BTreeMap, BTreeSet};

    /// A module's path in its crate.
    type Module = Vec<String>;

    /// Imported files by file.
    type Imports = BTreeMap<Module, BTreeSet<Module>>;

    /// Code by crate folder and module. Crate roots are left out: they declare modules and repeat public names.
    fn crates() -> BTreeMap<String, BTreeMap<Module, String>> {
        let mut crates: BTreeMap<String, BTreeMap<Module, String>> = BTreeMap::new();
        for path in files(&root(), ".rs") {
            let shown = shown(&path);
            let Some((folder, file)) = shown.split_once("/src/") else { continue };
            let module = file.trim_end_matches(".rs").trim_end_matches("/mod");
            if !["lib", "main"].contains(&module) {
                let module = module.split('/').map(str::to_owned).collect();
                crates.entry(folder.to_owned()).or_default().insert(module, product(&text(&path)));
            }
        }
        crates
    }

    /// Returns code without comments and unit tests.
    fn product(text: &str) -> String {
        let code = text.split("#[cfg(test)]\nmod ").next().unwrap_or_default();
        code.lines().map(|line| line.split("//").next().unwrap_or_default()).collect::<Vec<_>>().join("\n")
    }

    /// Adds the paths of an import such as `a::{b, c::d}`, each after `start`.
    fn expand(start: &[&str], tree: &str, found: &mut Vec<Module>) {
        let (mut depth, mut part) = (0, String::new());
        let mut parts = Vec::new();
        for letter in tree.chars().chain([',']) {
            depth += i32::from(letter == '{') - i32::from(letter == '}');
            if letter == ',' && depth == 0 {
                parts.push(std::mem::take(&mut part))
            } else {
                part.push(letter)
            }
        }
        for part in parts {
            let (path, group) = part.split_once('{').unwrap_or((&part, ""));
            let name = |step: &'_ str| step.split_whitespace().next().map(str::to_owned);
            let steps: Vec<String> = path.split("::").filter_map(name).collect();
            let whole: Vec<&str> = start.iter().copied().chain(steps.iter().map(String::as_str)).collect();
            match group.rsplit_once('}') {
                Some((group, _)) => expand(&whole, group, found),
                None => found.push(whole.into_iter().map(str::to_owned).collect()),
            }
        }
    }

    /// Returns the path in the crate that `path` means in `module`, if it begins with `crate`, `self` or `super`.
    fn absolute(module: &[String], path: &[String]) -> Option<Module> {
        let above = path.iter().take_while(|step| *step == "super").count();
        let start = match path.first()?.as_str() {
            "crate" => &[][..],
            "self" => module,
            "super" => &module[..module.len().checked_sub(above)?],
            _ => return None,
        };
        Some([start, &path[above.max(1)..]].concat())
    }

    /// Returns the files of the crate that each file imports.
    fn imports(files: &BTreeMap<Module, String>) -> Imports {
        let imported = |(module, code): (&Module, &String)| {
            let mut paths = Vec::new();
            let uses = code.split("use ").skip(1).filter_map(|rest| rest.split_once(';'));
            uses.for_each(|(tree, _)| expand(&[], tree, &mut paths));
            // Without visibilities such as `pub(in crate::a)`.
            for (at, _) in code.match_indices("crate::").filter(|(at, _)| !code[..*at].ends_with("in ")) {
                let end = code[at..].find(|c: char| !c.is_alphanumeric() && c != '_' && c != ':');
                expand(&[], &code[at..][..end.unwrap_or(0)], &mut paths);
            }
            let file = |path: &Module| {
                let absolute = absolute(module, path)?;
                (1..=absolute.len())
                    .rev()
                    .map(|end| absolute[..end].to_vec())
                    .find(|to| files.contains_key(to))
            };
            (module.clone(), paths.iter().filter_map(file).filter(|to| to != module).collect())
        };
        files.iter().map(imported).collect()
    }

    /// Returns the imports that are part of a circle.
    fn circular(mut imports: Imports) -> Imports {
        loop {
            let count = imports.len();
            let known: BTreeSet<Module> = imports.keys().cloned().collect();
            let imported: BTreeSet<Module> = imports.values().flatten().cloned().collect();
            imports.retain(|module, to| {
                to.retain(|to| known.contains(to));
                !to.is_empty() && imported.contains(module)
            });
            if imports.len() == count {
                return imports;
            }
        }
    }

    #[test]
    fn files_do_not_import_each_other() {
        let mut count = 0;
        for (folder, files) in crates() {
            let imports = imports(&files);
            count += imports.values().map(BTreeSet::len).sum::<usize>();
            let circular = circular(imports);
            assert!(circular.is_empty(), "files of {folder} import each other: {circular:#?}");
        }
        assert!(count > 500, "the check sees {count} imports");
    }

    #[test]
    fn circle_of_imports_is_found() {
        let file = |name: &str, code: &str| (vec![name.to_owned()], code.to_owned());
        let files = [
            file("a", "use crate::{b::{self, B}, d};"),
            file("b", "use super::c::C;"),
            file("c", "fn f() { crate::a::g() }"),
            file("d", "use std::io;"),
        ];
        let found = circular(imports(&BTreeMap::from(files)));
        let names: Vec<String> = found.into_keys().map(|module| module.join("/")).collect();
        assert_eq!(names, ["a", "b", "c"]);
    }
}
