//! The server's log as JSON.

use avln_tests::server::Server;
use serde_json::Value;
use std::{fs, path::Path, process::Command};

const PROGRAM: &str = env!("CARGO_BIN_EXE_avln_under_test");

/// Runs the program with a data folder and returns the output.
fn avln(data: &Path, arguments: &[&str]) -> String {
    let mut command = Command::new(PROGRAM);
    command.env_remove("AVLN_TOKEN").arg("--data").arg(data).args(arguments);
    let output = command.output().expect("the program runs");
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Returns the field of the span `name` around a log line.
fn around<'a>(line: &'a Value, name: &str, field: &str) -> &'a Value {
    let spans = line["spans"].as_array().expect("spans");
    &spans.iter().find(|span| span["name"] == name).expect(name)[field]
}

#[test]
fn json_log_has_each_step_with_its_durations() {
    let folder = tempfile::tempdir().expect("a folder");
    let data = folder.path();
    avln(data, &["data", "split", "make", "val", "--houses", "1", "--missions", "1", "--seed", "7"]);
    avln(data, &["challenge", "phase", "open", "practice", "--split", "val"]);
    let output = avln(data, &["challenge", "team", "add", "ada"]);
    let token = output.split_whitespace().find(|word| word.starts_with("avln_")).expect("a token");
    // The options of docs/OPERATING.md.
    let options = ["--log", "warn,avln_grpc=debug,avln_arena=debug", "--log-format", "json"];
    let server = Server::start_with(PROGRAM, data, &options);
    let url = format!("http://{}", server.grpc);
    let played = avln(data, &["agent", "random", "--server", &url, "--token", token]);
    let run = played.split(':').next().expect("a run");

    let log = fs::read_to_string(data.join("server.log")).expect("a log");
    let lines: Vec<Value> = log.lines().map(|line| serde_json::from_str(line).expect(line)).collect();
    let steps: Vec<&Value> = lines.iter().filter(|line| line["fields"]["message"] == "step ended").collect();
    for (number, step) in steps.iter().enumerate() {
        assert_eq!(step["span"]["step"], number as u64 + 1, "{step}");
        let parts_ms = ["queue_ms", "simulation_ms", "encoding_ms"].map(|part| step["span"][part].as_f64());
        let sum_ms = parts_ms.iter().map(|part| part.expect("a duration")).sum::<f64>();
        let duration_ms = step["span"]["duration_ms"].as_f64().expect("a duration");
        // Each part is rounded to milliseconds.
        assert!(sum_ms <= duration_ms + 3.0, "{step}");
        assert_eq!(step["spans"][0]["run"], run, "{step}");
        assert!(around(step, "episode", "episode").as_str().is_some_and(|id| !id.is_empty()), "{step}");
    }
    let ended = lines.iter().find(|line| line["fields"]["message"] == "episode ended").expect("an end");
    assert_eq!(ended["span"]["steps"], steps.len() as u64, "{ended}");
    assert!(!log.contains(token), "tokens are never logged");
}
