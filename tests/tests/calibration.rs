//! The calibration phase: this build's observations and scores equal the published values, locally and on a
//! server; a different phase with the same name is detected. `AVLN_BLESS=1` publishes new values.

use avln_arena::{
    Arena, SCENE_MEMORY_MIB,
    data::DataFolder,
    servers::{Addresses, RunningServers, Servers},
    setup::{NewPhase, NewSplit, admit, make_split, open_phase},
};
use avln_dataset::Seed;
use avln_lab::calibration;
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
    assert!(code == Some(0) && text.contains("All 38 episodes and the data set are as published"), "{text}");
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
    assert!(code == Some(0) && text.contains("All 12 episodes are as published"), "{text}");
}

#[tokio::test(flavor = "multi_thread")]
async fn another_phase_of_that_name_is_found_out() {
    let place = tempfile::tempdir().expect("a folder");
    share_cache(place.path());
    let data = DataFolder::open(place.path()).expect("the folder");
    let store = data.store().await.expect("a database");
    let name = calibration::PHASES[0].id.to_owned();
    let rules = "lh-avln-v1".to_owned();
    let make =
        NewSplit { name: name.clone(), houses: 1, scenes: vec![], missions: 2, seed: Seed::Number(5), rules };
    make_split(&data, &store, make, |_| ()).await.expect("a split");
    let open = NewPhase { max_slots: 4, max_side: 256, ..NewPhase::public(&name, &name) };
    open_phase(&data, &store, &open).await.expect("a phase");
    let (servers, token) = host(&data).await;
    let url = format!("http://{}", servers.grpc);
    let (code, text) = calibrate(place.path(), &["--agent", "random", "--server", &url, "--token", &token]);
    assert_eq!(code, Some(6), "{text}");
    assert!(text.contains("2 episodes, published are 12") && text.contains("not calibrated"), "{text}");
    let (code, text) = calibrate(place.path(), &["--open"]);
    assert!(code == Some(5) && text.contains("exists with other missions"), "{text}");
}
