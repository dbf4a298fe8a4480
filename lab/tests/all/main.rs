//! Data sets on disk: building, checks, exports and phases.

mod heads;

use avln_arena::FailureKind;
use avln_arena::cache::CacheFolder;
use avln_arena::data::DataFolder;
use avln_arena::dataset::{DatasetFiles, SplitFolder};
use avln_arena::setup::{NewPhase, open_phase};
use avln_dataset::{CueSpec, EpisodeSpec, PublicGoal, Recipe};
use avln_episode::{Rules, SoundClip, Sounds};
use avln_interchange::{ForeignFile, Importer, read};
use avln_lab::dataset::build::Builder;
use avln_lab::dataset::check::{self, CheckReport, CheckScope};
use avln_lab::dataset::export::{Export, Openness};
use avln_store::{Phase, Visibility};
use avln_world::Cache;
use std::collections::BTreeMap;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock};
use tempfile::TempDir;

const RECIPE: &str = r#"{
  "name": "tiny", "rules": "lh-avln-v1", "seed": 4,
  "missions": { "goals": [2, 3], "min_start_m": 1.0, "min_separation_m": 0.5, "distractors": [0, 255] },
  "splits": [
    { "name": "val", "scenes": { "houses": { "count": 2, "rooms": [5, 5], "storeys": [1, 1], "pool": "validation" } },
      "missions_per_scene": 3 },
    { "name": "train", "scenes": { "houses": { "count": 1, "rooms": [5, 5], "storeys": [1, 1], "pool": "train" } },
      "missions_per_scene": 4 }
  ]
}"#;

fn recipe() -> Recipe {
    Recipe::from_json(RECIPE).expect("a recipe")
}

fn build(folder: &Path, threads: usize) {
    let builder = Builder::open(DatasetFiles::at(folder), recipe()).expect("a free folder");
    let cache = TempDir::new().expect("a folder");
    let cache: Arc<dyn Cache> = Arc::new(CacheFolder::at(cache.path()));
    builder.run(Some(threads), Some(&cache).filter(|_| threads > 1), |_| {}).expect("built");
}

/// A data set that tests only read.
static BUILT: LazyLock<TempDir> = LazyLock::new(|| {
    let folder = TempDir::new().expect("a folder");
    build(folder.path(), 2);
    folder
});

/// Returns all files below a folder, by path.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(folder).expect("below it").to_owned();
                found.insert(name, fs::read(&path).expect("a file"));
            }
        }
    }
    found
}

/// Copies the data set for tests that damage it.
fn copy() -> TempDir {
    let folder = TempDir::new().expect("a folder");
    for (name, bytes) in contents(BUILT.path()) {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().expect("a parent")).expect("writable");
        fs::write(path, bytes).expect("writable");
    }
    folder
}

fn checked(folder: &Path) -> Result<CheckReport, avln_arena::Failure> {
    let scope =
        CheckScope { split: None, scenes: None, every: 1, cues: true, models: None, threads: Some(2) };
    check::run(&DatasetFiles::at(folder), &scope, None, |_, _| {})
}

#[test]
fn bytes_do_not_depend_on_threads() {
    for threads in [1, 8] {
        let folder = TempDir::new().expect("a folder");
        build(folder.path(), threads);
        assert_eq!(contents(folder.path()), contents(BUILT.path()), "{threads} threads");
    }
}

#[test]
fn a_killed_build_resumes_with_equal_bytes() {
    let folder = TempDir::new().expect("a folder");
    let builder = Builder::open(DatasetFiles::at(folder.path()), recipe()).expect("a free folder");
    let killed = catch_unwind(AssertUnwindSafe(|| {
        builder.run(Some(1), None, |progress| assert!(progress.done < 3, "killed after the first scene"))
    }));
    assert!(killed.is_err());
    let half = contents(folder.path());
    assert!(half.contains_key(Path::new("val/missions/tiny-val-0000.jsonl")));
    assert!(!half.contains_key(Path::new("dataset.json")));
    // A truncated file is replaced, a complete one is not.
    let kept = folder.path().join("val/missions/tiny-val-0000.jsonl");
    let before = fs::metadata(&kept).and_then(|data| data.modified()).expect("a time");
    fs::write(folder.path().join("val/missions/tiny-val-0001.jsonl"), "{").expect("writable");
    build(folder.path(), 2);
    assert_eq!(fs::metadata(&kept).and_then(|data| data.modified()).expect("a time"), before);
    assert_eq!(contents(folder.path()), contents(BUILT.path()));
}

#[test]
fn a_complete_data_set_rejects_another_recipe() {
    build(BUILT.path(), 1);
    let other = Recipe { seed: Some(5), ..recipe() };
    let refused = Builder::open(DatasetFiles::at(BUILT.path()), other).err().expect("another recipe");
    assert_eq!(refused.kind(), FailureKind::Data);
    assert!(refused.to_string().contains("another recipe"), "{refused}");
}

#[test]
fn a_new_data_set_passes_the_check() {
    let report = checked(BUILT.path()).expect("readable");
    assert_eq!((report.scenes, report.missions), (3, 10));
    assert_eq!(report.faults, Vec::<String>::new());
}

#[test]
fn changed_files_are_named() {
    let folder = copy();
    let path = folder.path().join("val/sealed/tiny-val-0001.jsonl");
    let text = fs::read_to_string(&path).expect("text");
    fs::write(&path, text.replacen("\"category\":\"", "\"category\":\"x", 1)).expect("writable");
    let failure = checked(folder.path()).expect_err("changed").to_string();
    assert!(failure.contains("tiny-val-0001.jsonl") && failure.contains("digest"), "{failure}");
    fs::remove_file(&path).expect("removable");
    let failure = checked(folder.path()).expect_err("gone").to_string();
    assert!(failure.contains("cannot read") && failure.contains("tiny-val-0001.jsonl"), "{failure}");
    fs::write(folder.path().join("dataset.json"), "{\n\"format\": 3").expect("writable");
    let failure = checked(folder.path()).expect_err("broken").to_string();
    assert!(failure.contains("dataset.json, line 2"), "{failure}");
}

#[tokio::test]
async fn a_phase_opens_on_a_split() {
    let home = TempDir::new().expect("a folder");
    let data = DataFolder::open(home.path()).expect("writable");
    let store = data.store().await.expect("a database");
    let options = NewPhase {
        dataset: Some(BUILT.path().to_owned()),
        max_slots: 4,
        max_side: 256,
        ..NewPhase::public("val", "val")
    };
    let phase = open_phase(&data, &store, &options).await.expect("opens");
    assert_eq!((phase.split.as_str(), phase.episodes.len()), ("tiny-val", 6));
    let by =
        |rules: &str| NewPhase { id: "noisy".to_owned(), rules: Some(rules.to_owned()), ..options.clone() };
    let noisy = open_phase(&data, &store, &by("lh-avln-noisy-v1")).await.expect("differs in noise alone");
    let by_noisy = Rules { sounds: Sounds::Validation, ..Rules::noisy() };
    assert_eq!((&noisy.rules, &noisy.episodes), (&by_noisy, &phase.episodes));
    let distinct =
        open_phase(&data, &store, &by("lh-avln-distinct-v1")).await.expect("differs in clips alone");
    assert_eq!(distinct.rules.sound_clip, SoundClip::Distinct);
    check_sounds(&data, &store, &options).await;
    for (rules, named) in [("lh-avln-authors-v1", "lh-avln-v1"), ("habitat", "lh-avln-noisy-v1")] {
        let refused = open_phase(&data, &store, &by(rules)).await.expect_err("other rules").to_string();
        assert!(refused.contains(rules) && refused.contains(named), "{refused}");
    }
    let missions = data.missions("tiny-val").expect("known by its name");
    let id = &phase.episodes[4].episode;
    let episode = missions.episode(id).expect("readable").expect("there");
    assert_eq!((&episode.id, &episode.scene), (id, &phase.episodes[4].scene));
    assert_eq!(missions.episode("tiny-val-0000-9999").expect("readable"), None);
    assert_eq!(missions.episode("elsewhere").expect("readable"), None);
    // A second link of the split changes nothing; an unknown split is refused with the known names.
    assert_eq!(data.link_split(BUILT.path(), "val").expect("the same"), "tiny-val");
    let failure = SplitFolder::open(BUILT.path(), "test").err().expect("no such split").to_string();
    assert!(failure.contains("val, train"), "{failure}");
    store.close().await;
}

/// Targets play clips from the share of the split's pool, or from the organiser's choice.
async fn check_sounds(data: &DataFolder, store: &avln_store::Store, options: &NewPhase) {
    let by = |sounds: &str, rules: &str| NewPhase {
        id: "sounds".to_owned(),
        sounds: (!sounds.is_empty()).then(|| sounds.to_owned()),
        rules: Some(rules.to_owned()),
        ..options.clone()
    };
    for (sounds, chosen) in [("", Sounds::Validation), ("all", Sounds::All), ("test", Sounds::Test)] {
        let phase = open_phase(data, store, &by(sounds, "lh-avln-v1")).await.expect("made by rule");
        assert_eq!(phase.rules.sounds, chosen);
    }
    let folder = tempfile::tempdir().expect("a folder for temporary files");
    let (place, spec) = (
        folder.path().join("knock.wav"),
        hound::WavSpec {
            channels: 1,
            sample_rate: 16_000,
            bits_per_sample: 16,
            sample_format: hound::SampleFormat::Int,
        },
    );
    let mut writer = hound::WavWriter::create(&place, spec).expect("a file");
    (0..20_000).for_each(|n| writer.write_sample(if n % 999 < 9 { 9000_i16 } else { 0 }).expect("written"));
    writer.finalize().expect("written");
    let path = folder.path().display().to_string();
    let refused =
        open_phase(data, store, &by(&path, "lh-avln-distinct-v1")).await.expect_err("one clip").to_string();
    assert!(refused.contains("need") && refused.contains("the bank has 1"), "{refused}");
    let phase = open_phase(data, store, &by(&path, "lh-avln-v1")).await.expect("one clip is enough");
    drop(folder);
    assert_eq!(data.bank(&phase.rules.sounds).expect("kept").len(), 1);
    let nowhere = open_phase(data, store, &by("nowhere", "lh-avln-v1")).await.expect_err("no such folder");
    assert_eq!(nowhere.kind(), FailureKind::Data);
}

/// Exports a split; returns the files by path.
fn exported(split: &str, openness: Openness) -> BTreeMap<PathBuf, Vec<u8>> {
    let (split, out) =
        (SplitFolder::open(BUILT.path(), split).expect("a split"), TempDir::new().expect("a folder"));
    let export = Export { split: &split, openness, authors: true, parquet: true };
    let missions = export.run(out.path(), || ()).expect("written");
    assert_eq!(missions, split.mission_count());
    contents(out.path())
}

/// Reads an exported file in the authors' format.
fn read_back(files: &BTreeMap<PathBuf, Vec<u8>>, path: &str) -> ForeignFile {
    let bytes = files.get(Path::new(path)).expect("a file");
    read(path, bytes, None).expect("it is read").1
}

#[test]
fn exported_training_splits_round_trip() {
    let files = exported("train", Openness::Training);
    let names: Vec<_> = files.keys().map(|path| path.to_string_lossy().replace("train/", "")).collect();
    let tables = ["goals", "missions", "places", "targets", "tours"].map(|name| format!("{name}.parquet"));
    let scene = "content/tiny-train-0000.json.gz".to_owned();
    assert_eq!(names, [vec![scene], tables.to_vec(), vec!["train.json.gz".to_owned()]].concat());
    let foreign = read_back(&files, "train/content/tiny-train-0000.json.gz");
    assert_eq!(foreign.losses, vec![]);
    let (split, rules) = (SplitFolder::open(BUILT.path(), "train").expect("a split"), Rules::paper());
    let scene = &split.scenes()[0];
    let assets = scene.spec().open(&rules).expect("a scene");
    let mut importer = Importer::new(&assets, &rules, 1);
    let back: Vec<EpisodeSpec> =
        foreign.episodes.iter().map(|episode| importer.import(episode).episode.expect("kept")).collect();
    let ours = split.episodes(scene).expect("missions");
    assert_eq!(back.len(), ours.len());
    for (back, ours) in back.iter().zip(&ours) {
        let number = |id: &str| id.rsplit('-').next().and_then(|number| number.parse::<u32>().ok());
        assert_eq!(number(&back.id), number(&ours.id));
        assert!((back.start.position - ours.start.position).norm() < 1e-3);
        assert!((back.start.heading_rad - ours.start.heading_rad).abs() < 1e-5);
        assert_eq!(back.goals.len(), ours.goals.len());
        for (back, ours) in back.goals.iter().zip(&ours.goals) {
            assert_eq!(
                (back.target.instance, back.target.bounds),
                (ours.target.instance, ours.target.bounds)
            );
            assert_eq!(back.cue.modality(), ours.cue.modality());
            if let (CueSpec::Description(back), CueSpec::Description(ours)) = (&back.cue, &ours.cue) {
                assert_eq!(back.text, ours.text);
            }
        }
        assert!((back.unordered.length_m - ours.unordered.length_m).abs() < 1e-3);
    }
}

#[test]
fn public_exports_contain_no_ground_truth() {
    let split = SplitFolder::open(BUILT.path(), "val").expect("a split");
    assert_eq!(Openness::of(&split, &[], true).expect("it is known"), Openness::Public);
    let refused = Openness::Public.check_training(&split).expect_err("not for training").to_string();
    assert!(refused.contains("'val' is not for training"), "{refused}");
    let files = exported("val", Openness::Public);
    assert_eq!(files.len(), 2 + 1 + 2, "two scenes, an index and two tables");
    for scene in split.scenes() {
        let foreign = read_back(&files, &format!("val/content/{}.json.gz", scene.name));
        let public = split.public(scene).expect("missions");
        let pictures = public.iter().flat_map(|mission| &mission.goals);
        let pictures = pictures.filter(|goal| **goal == PublicGoal::Image).count();
        assert_eq!((foreign.episodes.len(), foreign.losses.len()), (public.len(), pictures));
        for (told, ours) in foreign.episodes.iter().zip(&public) {
            assert_eq!((told.stated_m, told.start.position), ([None, None], ours.start.position));
            let known = told.goals.iter().flat_map(|goal| &goal.instances);
            assert!(known.clone().all(|target| target.id == Some(0) && target.bounds.is_none()));
        }
    }
}

#[test]
fn hidden_splits_are_not_exported() {
    let train = SplitFolder::open(BUILT.path(), "train").expect("a split");
    assert_eq!(Openness::of(&train, &[], false).expect("it is known"), Openness::Training);
    let mut phase = Phase::new("finals", "train", Rules::paper(), Vec::new());
    assert!(Openness::of(&train, std::slice::from_ref(&phase), false).is_ok(), "its targets are public");
    phase.replays = Visibility::Organiser;
    let refused = Openness::of(&train, &[phase], true).expect_err("hidden").to_string();
    assert!(refused.contains("hidden: phase 'finals'"), "{refused}");

    let recipe = RECIPE.replace("\"validation\"", "\"test\"");
    let folder = TempDir::new().expect("a folder");
    let recipe = Recipe::from_json(&recipe).expect("a recipe");
    let builder = Builder::open(DatasetFiles::at(folder.path()), recipe).expect("a free folder");
    builder.run(Some(2), None, |_| {}).expect("built");
    let test = SplitFolder::open(folder.path(), "val").expect("a split");
    let refused = Openness::of(&test, &[], true).expect_err("hidden").to_string();
    assert!(refused.contains("furniture of the test pool"), "{refused}");
}
