//! Phases with a measured head.

#[path = "../../../server/sim/acoustics/tests/all/sofa_file.rs"]
mod sofa_file;

use avln_arena::data::DataFolder;
use avln_arena::dataset::{DatasetFiles, SplitFolder};
use avln_arena::setup::{NewPhase, open_phase};
use avln_arena::{Arena, FailureKind, SCENE_MEMORY_MIB};
use avln_dataset::{Recipe, SceneSpec};
use avln_episode::{HeadRule, Order, Rules, Sensors};
use avln_lab::dataset::build::Builder;
use avln_referee::{Audio, Referee};
use avln_store::Store;
use sofa_file::{Table, file};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tempfile::TempDir;

const RECIPE: &str = r#"{
  "name": "heads", "rules": "lh-avln-v1", "seed": 4,
  "missions": { "goals": [2, 2], "min_start_m": 1.0, "min_separation_m": 0.5, "distractors": [0, 255] },
  "splits": [
    { "name": "val", "scenes": { "houses": { "count": 1, "rooms": [5, 5], "storeys": [1, 1], "pool": "validation" } },
      "missions_per_scene": 1 }
  ]
}"#;

/// Writes a head with the given gain per ear, equal for all directions.
fn write_head(path: &Path, gains: [f64; 2]) {
    let places: Vec<[f64; 3]> = (0..12).map(|step| [30.0 * f64::from(step), 0.0, 1.5]).collect();
    let pulse = |tap: usize, gain: f64| if tap == 20 { gain } else { 0.0 };
    let ears = |_: &[f64; 3]| gains.into_iter().flat_map(|gain| (0..64).map(move |tap| pulse(tap, gain)));
    let count = places.len() as u64;
    let table = |name, sizes: &[u64], values| Table { name, sizes: sizes.to_vec(), values, kind: None };
    let directions = table("SourcePosition", &[count, 3], places.concat());
    let tables = [
        Table { kind: Some("spherical"), ..directions },
        table("ReceiverPosition", &[2, 3], vec![0.0, 0.09, 0.0, 0.0, -0.09, 0.0]),
        table("Data.SamplingRate", &[1], vec![16_000.0]),
        table("Data.IR", &[count, 2, 64], places.iter().flat_map(ears).collect()),
    ];
    fs::write(path, file("SOFA", &tables)).expect("a file");
}

fn options(dataset: &Path, head: Option<PathBuf>) -> NewPhase {
    NewPhase {
        dataset: Some(dataset.to_owned()),
        head,
        max_slots: 4,
        max_side: 256,
        ..NewPhase::public("heads", "val")
    }
}

/// Returns the energy per ear over the first steps.
fn energies(split: &SplitFolder, rules: &Rules, audio: &Audio) -> [f32; 2] {
    let scene = split.scenes()[0].clone();
    let spec = split.episodes(&scene).expect("readable").remove(0);
    let scene: SceneSpec = scene.spec();
    let assets = Arc::new(scene.open(rules).expect("a house"));
    let sensors = Sensors { rgb: false, depth: false, ..Sensors::all(64, 64) };
    let (mission, truth) = (spec.mission(&assets, rules, Order::Unordered), spec.truth(Order::Unordered));
    let mut referee =
        Referee::new(assets, mission, truth, rules.clone(), sensors, audio).expect("an episode");
    let mut sums = [0.0; 2];
    let first = referee.start().audio.expect("sound");
    let second =
        referee.step(avln_episode::Action::TurnLeft).expect("a step").observation.audio.expect("sound");
    for heard in [first, second] {
        for (sum, ear) in sums.iter_mut().zip(heard.chunks(heard.len() / 2)) {
            *sum += ear.iter().map(|sample| sample * sample).sum::<f32>();
        }
    }
    sums
}

async fn reopened(data: &DataFolder, store: &Store) -> Result<(), String> {
    Arena::open(data, store.clone(), SCENE_MEMORY_MIB).await.map(drop).map_err(|failure| failure.to_string())
}

/// Returns an empty data folder with its database, and writes the data set of the recipe.
async fn with_dataset(home: &TempDir, dataset: &TempDir) -> (DataFolder, Store) {
    let recipe = Recipe::from_json(RECIPE).expect("a recipe");
    let builder = Builder::open(DatasetFiles::at(dataset.path()), recipe).expect("a free folder");
    builder.run(Some(1), None, |_| {}).expect("built");
    let data = DataFolder::open(home.path()).expect("writable");
    let store = data.store().await.expect("a database");
    (data, store)
}

#[tokio::test]
async fn a_phase_keeps_its_head() {
    let (home, dataset) = (TempDir::new().expect("a folder"), TempDir::new().expect("a folder"));
    let (data, store) = with_dataset(&home, &dataset).await;
    let given = home.path().join("left.sofa");
    write_head(&given, [1.0, 0.01]);

    let plain = open_phase(&data, &store, &options(dataset.path(), None)).await.expect("opens");
    assert_eq!(plain.rules.head, HeadRule::Sphere);
    let told = serde_json::to_string(&plain.rules).expect("plain data");
    assert!(!told.contains("head"), "a configuration without a head keeps its digest: {told}");
    let with = options(dataset.path(), Some(given.clone()));
    let measured = open_phase(&data, &store, &with).await.expect("opens");
    fs::remove_file(&given).expect("the file was copied");
    let HeadRule::Measured(digest) = &measured.rules.head else { panic!("{:?}", measured.rules.head) };
    assert!(serde_json::to_string(&measured.rules).expect("plain data").contains(digest));

    let kept = home.path().join("heads").join(format!("{digest}.sofa"));
    let missions = data.missions(&plain.split).expect("known");
    let heard = |rules: &Rules| energies(&missions, rules, &data.audio(rules).expect("kept"));
    write_head(&given, [0.01, 1.0]);
    let other = open_phase(&data, &store, &with).await.expect("opens");
    let ([left, right], [other_left, other_right]) = (heard(&measured.rules), heard(&other.rules));
    // Late reverberation is equally loud at both ears; direct sound is not.
    assert!(left > 1.05 * right, "{left} and {right}");
    assert!(other_right > 1.05 * other_left, "{other_left} and {other_right}");
    assert_ne!(heard(&plain.rules), [left, right]);
    open_phase(&data, &store, &NewPhase { head: Some(kept.clone()), ..with })
        .await
        .expect("a stored head is accepted");
    reopened(&data, &store).await.expect("all is there");
    let mut bytes = fs::read(&kept).expect("kept");
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    fs::write(&kept, &bytes).expect("writable");
    let refused = reopened(&data, &store).await.expect_err("changed");
    assert!(refused.contains(digest) && refused.contains("was changed"), "{refused}");
    fs::remove_file(&kept).expect("there");
    let refused = reopened(&data, &store).await.expect_err("gone");
    assert!(refused.contains(digest), "{refused}");
    store.close().await;
}

#[tokio::test]
async fn invalid_heads_are_refused() {
    let (home, dataset) = (TempDir::new().expect("a folder"), TempDir::new().expect("a folder"));
    let (data, store) = with_dataset(&home, &dataset).await;
    let text = home.path().join("notes.txt");
    fs::write(&text, "no head").expect("a file");
    for (path, named) in [(text, "SOFA"), (home.path().join("nowhere.sofa"), "nowhere.sofa")] {
        let refused =
            open_phase(&data, &store, &options(dataset.path(), Some(path))).await.expect_err("no head");
        assert_eq!(refused.kind(), FailureKind::Data);
        assert!(refused.to_string().contains(named), "{refused}");
    }
    assert!(!home.path().join("heads").exists());
    store.close().await;
}
