//! Calibration: this build's observations, scores and data set equal the published values, locally and on a server; different
//! phases with the same names and missing phases are detected. `AVLN_BLESS=1` publishes new values.

use avln_arena::{
    Arena, SCENE_MEMORY_MIB,
    data::DataFolder,
    servers::{Addresses, RunningServers, Servers},
    setup::{NewPhase, NewSplit, admit, make_split, open_phase},
};
use avln_dataset::Seed;
use avln_lab::calibration::{CalibrationPhase, PHASES};
use avln_tests::share_cache;
use std::{path::Path, process::Command, sync::Arc};

/// Exit code and output of the calibration.
fn calibrate(data: &Path, more: &[&str]) -> (Option<i32>, String) {
    let mut avln = Command::new(env!("CARGO_BIN_EXE_avln_under_test"));
    avln.env_remove("AVLN_TOKEN").arg("--data").arg(data).args(["lab", "calibrate"]).args(more);
    let output = avln.output().expect("the program runs");
    let text =
        String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    (output.status.code(), text)
}

/// Hosts a folder; returns the servers and a team token.
async fn host(data: &DataFolder) -> (RunningServers, String) {
    let store = data.store().await.expect("a database");
    let token = admit(&store, "ada", None).await.expect("a team");
    let arena = Arena::open(data, store.clone(), SCENE_MEMORY_MIB).await.expect("phases");
    let free = "127.0.0.1:0".parse().expect("an address");
    let servers = Servers::bind(&Addresses { grpc: free, web: free }).await.expect("free ports");
    (servers.open(Arc::new(arena), store.reader()).expect("both servers"), token)
}

#[tokio::test(flavor = "multi_thread")]
async fn this_build_is_calibrated_and_leaves_nothing_behind() {
    let place = tempfile::tempdir().expect("a folder");
    let data = place.path().join("data");
    if std::env::var_os("AVLN_BLESS").is_some() {
        let published = concat!(env!("CARGO_MANIFEST_DIR"), "/../lab/src/calibration/published.json");
        let (code, text) = calibrate(&data, &["--write", published]);
        assert_eq!(code, Some(0), "{text}");
        return;
    }
    let (code, text) = calibrate(&data, &[]);
    assert!(code == Some(0) && text.contains("All 42 episodes are as published"), "{text}");
    assert!(text.contains("The data set mini is as published"), "{text}");
    assert!(!data.exists());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_that_hosts_the_phase_is_calibrated() {
    let place = tempfile::tempdir().expect("a folder");
    share_cache(place.path());
    for _ in 0..2 {
        let (code, text) = calibrate(place.path(), &["--open"]);
        assert!(
            code == Some(0) && text.contains("phases calibration and calibration-hard are open"),
            "{text}"
        );
    }
    let (servers, token) = host(&DataFolder::open(place.path()).expect("the folder")).await;
    let url = format!("http://{}", servers.grpc);
    let (code, text) = calibrate(place.path(), &["--agent", "random", "--server", &url, "--token", &token]);
    assert!(code == Some(0) && text.contains("All 14 episodes are as published"), "{text}");
    assert!(!text.contains("data set"), "{text}");
}

/// Opens other missions under the names of calibration phases; returns a server and a team token.
async fn host_others(place: &Path, phases: &[CalibrationPhase]) -> (RunningServers, String) {
    share_cache(place);
    let data = DataFolder::open(place).expect("the folder");
    let store = data.store().await.expect("a database");
    for name in phases.iter().map(|phase| phase.id.to_owned()) {
        let (rules, seed) = ("lh-avln-v1".to_owned(), Seed::Number(5));
        let make = NewSplit { name: name.clone(), houses: 1, scenes: vec![], missions: 2, seed, rules };
        make_split(&data, &store, make, |_| ()).await.expect("a split");
        let open = NewPhase { max_slots: 4, max_side: 256, ..NewPhase::public(&name, &name) };
        open_phase(&data, &store, &open).await.expect("a phase");
    }
    host(&data).await
}

#[tokio::test(flavor = "multi_thread")]
async fn other_phases_of_those_names_are_found_out() {
    let place = tempfile::tempdir().expect("a folder");
    let (servers, token) = host_others(place.path(), &PHASES).await;
    let url = format!("http://{}", servers.grpc);
    let (code, text) = calibrate(place.path(), &["--agent", "random", "--server", &url, "--token", &token]);
    assert_eq!(code, Some(6), "{text}");
    assert!(text.contains("2 episodes, published are 12") && text.contains("not calibrated"), "{text}");
    assert!(text.contains("random ordered, phase calibration-hard, episode 1:"), "{text}");
    let (code, text) = calibrate(place.path(), &["--open"]);
    assert!(code == Some(5) && text.contains("exists with other missions"), "{text}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_missing_phase_is_named_before_the_first_episode() {
    let place = tempfile::tempdir().expect("a folder");
    let (servers, token) = host_others(place.path(), &PHASES[..1]).await;
    let url = format!("http://{}", servers.grpc);
    let (code, text) = calibrate(place.path(), &["--server", &url, "--token", &token]);
    assert!(code == Some(6) && !text.contains("episode 1"), "{text}");
    assert!(text.contains("does not host the phase calibration-hard") && text.contains("--open"), "{text}");
}
