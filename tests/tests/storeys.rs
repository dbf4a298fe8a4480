//! PAG-Nav comes from storey to storey by stairs that nobody showed it.

use avln_tests::server::Server;
use std::{fs, path::Path, process::Command};

const PROGRAM: &str = env!("CARGO_BIN_EXE_avln_under_test");
/// One house with stairs.
const RECIPE: &str = r#"{
    "name": "two", "rules": "lh-avln-v1", "seed": 1,
    "missions": { "goals": [2, 4], "min_start_m": 3.0, "min_separation_m": 2.0, "distractors": [0, 6] },
    "splits": [{
        "name": "two", "missions_per_scene": 2,
        "scenes": { "houses": { "count": 1, "rooms": [14, 16], "storeys": [2, 2], "pool": "train" } }
    }]
}"#;
/// It takes stairs as soon as it knows some.
const WEIGHTS: &str = "storey_steps = 1\n";
/// Nothing but another storey is so high or low, metres.
const STOREY_M: f64 = 2.5;

/// Runs a command of the program in a folder; gives back what it printed.
fn avln(folder: &Path, arguments: &[&str]) -> String {
    let mut command = Command::new(PROGRAM);
    command.env_remove("AVLN_TOKEN").current_dir(folder).args(["--data", "data"]).args(arguments);
    let output = command.output().expect("the program runs");
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// How high the body was at each step of a trace, metres above its start.
fn heights_m(trace: &Path) -> Vec<f64> {
    let text = fs::read_to_string(trace).expect("a trace");
    let lines = text.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).expect("JSON"));
    lines.filter_map(|line| line["pose"]["position_m"][1].as_f64()).collect()
}

#[tokio::test]
async fn it_takes_stairs() {
    let place = tempfile::tempdir().expect("a folder");
    let folder = place.path();
    fs::write(folder.join("recipe.json"), RECIPE).expect("a recipe");
    fs::write(folder.join("weights.toml"), WEIGHTS).expect("weights");
    avln(folder, &["data", "dataset", "build", "recipe.json", "--out", "set"]);
    avln(folder, &["challenge", "phase", "open", "stairs", "--dataset", "set", "--split", "two"]);
    let told = avln(folder, &["challenge", "team", "add", "ada"]);
    let token = told.split_whitespace().find(|word| word.starts_with("avln_")).expect("a token");
    let server = Server::start(PROGRAM, &folder.join("data"));
    let url = format!("http://{}", server.grpc);
    let agent = ["agent", "pag-nav", "--server", &url, "--token", token, "--phase", "stairs"];
    avln(folder, &[&agent[..], &["--weights", "weights.toml", "--trace", "traces"]].concat());
    let traces = fs::read_dir(folder.join("traces")).expect("traces").flatten();
    let heights_m: Vec<f64> = traces.flat_map(|trace| heights_m(&trace.path())).collect();
    let most_m = heights_m.iter().fold(0.0, |most: f64, height_m| most.max(height_m.abs()));
    assert!(heights_m.len() > 100 && most_m > STOREY_M, "it came no farther up or down than {most_m} m");
}
