//! Accepted and refused sources.

use crate::{audio, shared_source, small_houses, small_options};
use avln_dataset::Recipe;
use avln_episode::{Order, Rules};
use avln_training::{Curriculum, Env, EnvOptions, EpisodeSource, Goals, SourceChoice, SourceOptions};
use std::fs;
use std::path::Path;

fn error(options: &SourceOptions) -> String {
    EpisodeSource::open(options).err().expect("refused").to_string()
}

#[test]
fn only_training_recipes_are_accepted() {
    let recipe = |name: &str| SourceOptions::new(SourceChoice::Recipe(name.to_owned()), 0);
    assert!(error(&recipe("papers")).contains("use one of: paper"));
    assert!(error(&recipe("mini")).contains("needs houses of the pool 'train'"));
    assert!(EpisodeSource::open(&recipe("paper")).is_ok());
}

#[test]
fn scans_need_a_confirmed_purpose() {
    let scan =
        |is_training| SourceOptions::new(SourceChoice::Scan { path: "scan.glb".into(), is_training }, 0);
    assert!(error(&scan(false)).contains("scan scan.glb may belong to a test split; confirm"));
    assert!(EpisodeSource::open(&scan(true)).is_ok());
}

#[test]
fn scenes_last_at_least_an_episode() {
    let options = SourceOptions::new(SourceChoice::Recipe("paper".to_owned()), 0);
    let error = error(&SourceOptions { episodes_per_scene: 0, ..options });
    assert!(error.contains("`episodes_per_scene` is 0; 1 is the least"), "{error}");
}

/// Writes a data set with one scene of a pool, without missions.
fn dataset(folder: &Path, pool: &str, list: &[u8]) {
    let recipe = Recipe::from_json(Recipe::EMBEDDED[1].1).expect("a recipe");
    let source = format!(
        r#"{{"name":"a","source":{{"procedural":{{"seed":1,"rooms":{{"start":2,"end":2}},"storeys":{{"start":1,"end":1}},"pool":"{pool}"}}}},"digest":"","missions":0,"public":"","sealed":""}}"#
    );
    let list = if list.is_empty() { source.as_bytes() } else { list };
    let split = avln_dataset::SplitLine {
        name: "own".to_owned(),
        scenes: 1,
        missions: 0,
        digest: avln_dataset::format::digest_of(list),
    };
    let manifest = avln_dataset::Manifest {
        format: avln_dataset::Manifest::FORMAT.to_owned(),
        version: avln_dataset::format::DATASET_VERSION,
        name: "own".to_owned(),
        rules: recipe.rules,
        recipe: None,
        seed: None,
        splits: vec![split],
    };
    fs::create_dir_all(folder.join("own")).expect("a folder");
    fs::write(folder.join("own/scenes.jsonl"), list).expect("a file");
    let json = avln_dataset::format::manifest_bytes(&manifest).expect("a manifest");
    fs::write(folder.join("dataset.json"), json).expect("a file");
}

#[test]
fn evaluation_pools_and_sealed_splits_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let choice = |split: &str| SourceChoice::Folder {
        path: folder.path().to_owned(),
        split: split.to_owned(),
        is_training: true,
    };
    let own = SourceOptions::new(choice("own"), 0);
    assert!(error(&own).starts_with("cannot read "));
    for pool in ["validation", "test"] {
        dataset(folder.path(), pool, b"");
        assert!(error(&own).contains(&format!("houses of the pool '{pool}'")), "{}", error(&own));
    }
    dataset(folder.path(), "train", b"");
    assert!(EpisodeSource::open(&own).is_ok());
    assert!(error(&SourceOptions::new(choice("val"), 0)).contains("it has: own"));
    dataset(folder.path(), "train", b"avln sealed");
    assert!(error(&own).contains("is sealed"), "{}", error(&own));
}

#[test]
fn limits_of_the_curriculum_are_checked() {
    let with = |curriculum| SourceOptions { curriculum, ..small_houses(0) };
    let goals = Curriculum { goals: [0, 2], ..Curriculum::default() };
    assert!(error(&with(goals)).contains("`goals` is [0, 2]"));
    let distance = Curriculum { distance_m: [5.0, 5.0], ..Curriculum::default() };
    assert!(error(&with(distance)).contains("`distance_m` is [5, 5]"));
    let rooms = Curriculum { rooms: Some([0, 3]), ..Curriculum::default() };
    assert!(error(&with(rooms)).contains("rooms"));
}

#[test]
fn seed_and_numbers_determine_the_episode() {
    let episode = |seed: u64, env: u64, number: u64| {
        let options = SourceOptions { goals: Goals::Fixed(Order::Ordered), ..small_houses(seed) };
        let source = EpisodeSource::open(&options).expect("a source");
        source.episode(env, number, &Rules::paper()).expect("an episode").truth
    };
    assert_eq!(episode(1, 0, 0), episode(1, 0, 0));
    assert_ne!(episode(1, 0, 0), episode(2, 0, 0));
    let source = shared_source(1, Goals::Fixed(Order::Ordered));
    let drawn = |number| source.episode(0, number, &Rules::paper()).expect("an episode").truth.episode;
    let numbers: Vec<_> = (0..4).map(drawn).collect();
    assert!(numbers.iter().any(|other| *other != numbers[0]), "{numbers:?}");
}

#[test]
fn hard_rules_add_as_many_sources_as_goals() {
    let source = shared_source(1, Goals::Drawn);
    let rules = Rules::named("lh-avln-hard-v1").expect("rules");
    for number in 0..4 {
        let truth = source.episode(0, number, &rules).expect("an episode").truth;
        assert_eq!(truth.distractor_sources.len(), truth.targets.len());
        let is_target = |id| truth.targets.iter().any(|target| target.instance == id);
        assert!(truth.distractor_sources.iter().all(|source| !is_target(source.instance)));
    }
}

#[test]
fn rules_for_other_regions_are_refused() {
    let opened = |name: &str, max_steps: u32| {
        let source = shared_source(1, Goals::Drawn);
        let rules = Rules { max_steps, ..Rules::named(name).expect("rules") };
        Env::new(0, source, EnvOptions { rules, ..small_options() }, audio())
    };
    for name in ["lh-avln-v1", "lh-avln-noisy-v1", "lh-avln-distinct-v1", "lh-avln-hard-v1"] {
        assert!(opened(name, 50).is_ok(), "{name}");
    }
    for name in ["lh-avln-authors-v1", "lh-avln-mesh-v1"] {
        let error = opened(name, 50).err().expect("refused").to_string();
        assert!(error.starts_with(&format!("`rules` is {name}; the missions of this source")), "{error}");
    }
}

#[test]
fn missions_with_single_goals_exist() {
    let small = small_houses(1);
    let curriculum = Curriculum { goals: [1, 1], ..small.curriculum.clone() };
    let source = EpisodeSource::open(&SourceOptions { curriculum, ..small }).expect("a source");
    let rules = Rules::paper();
    for number in 0..4 {
        let episode = source.episode(0, number, &rules).expect("an episode");
        assert_eq!((episode.mission.goals.len(), episode.truth.targets.len()), (1, 1));
    }
}
