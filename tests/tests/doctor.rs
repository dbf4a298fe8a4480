//! `avln lab doctor` finds what would stop a run, plays where that costs nothing, and leaves nothing open behind it.

use avln_arena::{challenge::notes, data::DataFolder, now_unix_ms};
use avln_store::{QuotaLimits, RunState, Viewer};
use avln_tests::{PHASE, TestServer, TestSetup};
use serde_json::Value;
use std::process::Command;

/// Exit code, report and standard error of the doctor's look at `url`.
fn doctor(url: &str, token: &str, phase: &str) -> (Option<i32>, Value, String) {
    let mut avln = Command::new(env!("CARGO_BIN_EXE_avln_under_test"));
    let arguments = ["lab", "doctor", "--server", url, "--token", token, "--phase", phase, "--json"];
    let output = avln.args(arguments).args(["--steps", "20", "--episodes", "2", "--size", "64"]).output();
    let output = output.expect("the program runs");
    let report = serde_json::from_slice(&output.stdout).expect("JSON");
    (output.status.code(), report, String::from_utf8_lossy(&output.stderr).into_owned())
}

fn verdict<'a>(report: &'a Value, name: &str) -> &'a str {
    let checks = report["checks"].as_array().expect("checks");
    let check = checks.iter().find(|check| check["name"] == name);
    check.and_then(|check| check["verdict"].as_str()).unwrap_or("none")
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_that_is_well_is_measured_and_left_as_it_was() {
    let house = TestServer::open(&TestSetup { missions: 3, ..TestSetup::default() }).await;
    let (code, report, said) = doctor(&house.agents_url(), &house.token, PHASE);
    assert_eq!((code, said.as_str()), (Some(0), ""), "{report}");
    for name in
        ["server", "versions", "state", "round trip", "clock", "token", "phase", "quota", "practice", "speed"]
    {
        assert_eq!(verdict(&report, name), "ok", "{name}: {report}");
    }
    let measured = &report["measured"];
    assert_eq!((&measured["step_s"]["count"], &measured["begin_s"]["count"]), (&40.into(), &2.into()));
    assert_eq!(measured["observation_bytes"], 64 * 64 * 7 + 2 * 4 * 4000);
    let (per_s, longest_s) = (measured["steps_per_s"].as_f64(), measured["longest_run_s"].as_f64());
    assert!(longest_s > per_s.map(|per_s| 3.0 * 1000.0 / per_s) && per_s > Some(1.0), "{measured}");
    assert!(measured["clock_ahead_s"].as_f64().is_some_and(|ahead| ahead.abs() < 1.0), "{measured}");

    let store = DataFolder::open(house.folder.path()).unwrap().store().await.unwrap();
    let runs = store.reader().runs(&Viewer::Organiser, None, 10).await.unwrap();
    assert_eq!(
        runs.iter().map(|run| (run.method.as_str(), run.state)).collect::<Vec<_>>(),
        [("doctor", RunState::Cancelled)]
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn what_would_stop_a_run_is_told_and_no_quota_is_spent() {
    let house = TestServer::open(&TestSetup::default()).await;
    let (code, report, said) = doctor(&house.agents_url(), "wrong", PHASE);
    assert_eq!((code, verdict(&report, "token")), (Some(6), "failed"), "{report}");
    assert!(said.contains("a run would fail: token") && verdict(&report, "round trip") == "ok", "{said}");
    let (code, report, _) = doctor(&house.agents_url(), &house.token, "finals");
    assert_eq!((code, verdict(&report, "phase")), (Some(6), "failed"), "{report}");
    let (code, report, _) = doctor("http://127.0.0.1:1", &house.token, PHASE);
    assert_eq!((code, verdict(&report, "server")), (Some(6), "failed"), "{report}");

    let store = DataFolder::open(house.folder.path()).unwrap().store().await.unwrap();
    let before = store.phase(PHASE).await.unwrap();
    let mut after = before.clone();
    after.quotas = QuotaLimits { total: Some(1), ..QuotaLimits::default() };
    store
        .change_phases(&[after.clone()], &notes("test", Some(&before), &after, ""), now_unix_ms())
        .await
        .unwrap();
    let (code, report, _) = doctor(&house.agents_url(), &house.token, PHASE);
    assert_eq!(
        (code, verdict(&report, "quota"), verdict(&report, "practice")),
        (Some(0), "ok", "skipped"),
        "{report}"
    );
    let (code, report, _) = doctor(&house.agents_url(), &house.token, "");
    assert_eq!((code, verdict(&report, "phase")), (Some(6), "failed"), "{report}");
    let told = report.to_string();
    assert!(told.contains(&format!("which are {PHASE}; name one with --phase")), "{told}");
    assert_eq!(store.reader().runs(&Viewer::Organiser, None, 10).await.unwrap(), []);
}
