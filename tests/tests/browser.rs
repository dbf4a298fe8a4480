//! The pages are for everybody: a real browser goes through them, light and dark, wide and narrow, and by keyboard alone.

use avln_client::Order;
use avln_human::{HumanArgs, RunArgs, run_with};
use avln_tests::{
    PHASE, TestServer, TestSetup, python,
    repository::root,
    scripted_run::{AUDIO_ONLY, play_script, play_script_with},
    skipped::skipped,
};
use std::{env, path::PathBuf};
use tokio::{sync::oneshot, task::spawn_blocking};

const REMEDY: &str = "pip install playwright axe-playwright-python";
const CHROMIUM: [&str; 3] = ["chromium", "chromium-browser", "google-chrome"];

/// The browser of this system; nothing, with a line on what to do, where it has none.
fn chromium() -> Option<PathBuf> {
    let path = env::var_os("PATH").unwrap_or_default();
    let folders: Vec<_> = env::split_paths(&path).collect();
    let mut programs = CHROMIUM.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name)));
    let found = programs.find(|program| program.is_file());
    if found.is_none() {
        skipped(&format!("pages in a browser, for none of {CHROMIUM:?} is here"), "install Chromium");
    }
    found
}

fn person(house: &TestServer) -> HumanArgs {
    let run = RunArgs {
        server: house.agents_url(),
        ca: None,
        token: house.token.clone(),
        phase: PHASE.to_owned(),
        order: Order::Unordered,
    };
    HumanArgs { run, size: 64, page: "127.0.0.1:0".parse().expect("an address") }
}

#[tokio::test(flavor = "multi_thread")]
async fn every_page_is_for_everybody() {
    let needed = ["playwright", "axe_playwright_python"];
    let Some(mut check) = python::command("pages in a browser", &needed, REMEDY) else { return };
    let Some(chromium) = chromium() else { return };
    let house = TestServer::open(&TestSetup::default()).await;
    for method in ["stroller", "wanderer"] {
        play_script(&house.agents_url(), &house.token, method).await;
    }
    let heard = play_script_with(&house.agents_url(), &house.token, "listener", AUDIO_ONLY, |_, _| ()).await;
    let (found, page) = oneshot::channel();
    let options = person(&house);
    let run = tokio::spawn(async move {
        let on_page = |address| found.send(address).expect("somebody asks");
        run_with(options, on_page, &mut |_| {}).await
    });
    let page = page.await.expect("a page");
    check.arg(root().join("tests/browser/check.py")).arg(chromium);
    check.arg(format!("http://{}", house.doors.web)).arg(format!("http://{page}"));
    check.arg(format!("http://{}/runs/{heard}/episodes/0", house.doors.web));
    check.arg(&house.token).arg(house.organiser().await);
    spawn_blocking(|| python::succeeds("pages in a browser", check)).await.expect("nothing is wrong");
    run.abort();
}

/// Runs a module of Python in the folder of the checks.
fn run(module: &str, arguments: &[&str], needed: &[&str]) {
    let what = format!("{module} of tests/browser");
    let remedy = format!("{REMEDY} {module}");
    let Some(mut command) = python::command(&what, needed, &remedy) else { return };
    command.args(["-m", module]).args(arguments).arg(".").current_dir(root().join("tests/browser"));
    python::succeeds(&what, command);
}

#[test]
fn the_style_of_the_checks_is_kept() {
    let rules = ["--no-cache", "--config", "../../client-sdk/python/pyproject.toml"];
    run("ruff", &[&["check"][..], &rules].concat(), &["ruff"]);
    run("ruff", &[&["format", "--check"][..], &rules].concat(), &["ruff"]);
}

#[test]
fn the_types_of_the_checks_hold() {
    let rules = ["--strict", "--cache-dir", "/dev/null", "--config-file="];
    run("mypy", &rules, &["mypy", "playwright"]);
}
