use super::*;
use std::collections::BTreeSet;

fn options(split: &str, purpose: Purpose) -> FrameOptions {
    let recipe = Recipe::from_json(Recipe::EMBEDDED[0].1).expect("a recipe");
    FrameOptions { recipe, split: split.into(), purpose, houses: 1, views: 6, side_px: 32, threads: Some(1) }
}

#[test]
fn evaluation_splits_are_no_training_data_and_the_other_way_round() {
    let folder = tempfile::tempdir().expect("a folder");
    for (split, purpose) in [
        ("val", Purpose::Training),
        ("mini", Purpose::Training),
        ("test", Purpose::Training),
        ("test", Purpose::Measurement),
        ("train", Purpose::Measurement),
        ("nowhere", Purpose::Training),
    ] {
        let refused = take(&options(split, purpose), folder.path(), || ()).expect_err(split);
        assert!(refused.to_string().contains(split), "{refused}");
    }
    let many = FrameOptions { houses: 601, ..options("train", Purpose::Training) };
    assert!(take(&many, folder.path(), || ()).expect_err("601").to_string().contains("600"));
    assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 0);
}

#[test]
fn training_houses_are_none_of_an_evaluation() {
    let seeds = |evaluated: bool| -> BTreeSet<u64> {
        let recipes = Recipe::EMBEDDED.map(|(_, text)| Recipe::from_json(text).expect("a recipe"));
        let mut seeds = BTreeSet::new();
        for recipe in &recipes {
            for (job, attempt) in
                recipe.jobs().flat_map(|job| (0..Recipe::HOUSE_DRAWS).map(move |a| (job, a)))
            {
                let SceneSource::Procedural { seed, pool, .. } = recipe.house(job, attempt).expect("a house")
                else {
                    panic!("recipes of the program draw houses");
                };
                if (pool != Pool::Train) == evaluated {
                    seeds.insert(seed);
                }
            }
        }
        seeds
    };
    let (training, evaluated) = (seeds(false), seeds(true));
    // The two houses of recipe `mini` are the first two of the validation split of `paper`.
    assert_eq!((training.len(), evaluated.len()), (600 * 12, (2 + 11 + 18) * 12));
    assert!(training.is_disjoint(&evaluated));
}

#[test]
fn a_house_is_written_with_what_is_in_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let options = options("train", Purpose::Training);
    take(&options, folder.path(), || ()).expect("pictures");
    let file = std::fs::read(folder.path().join("training-0000.npy")).expect("a file");
    let header_bytes = 10 + usize::from(u16::from_le_bytes([file[8], file[9]]));
    let header = std::str::from_utf8(&file[10..header_bytes]).expect("a text");
    assert!(header.contains("('instance', '<u2', (32, 32))") && header.contains("'shape': (6,)"), "{header}");
    let (pixels, camera_bytes) = (32 * 32, 4 * 7);
    let record_bytes = camera_bytes + pixels * (3 + 2 + 1 + 2);
    assert_eq!(file.len(), header_bytes + 6 * record_bytes);
    let categories: BTreeSet<u8> = file[header_bytes..]
        .chunks(record_bytes)
        .flat_map(|record| record[camera_bytes + 5 * pixels..][..pixels].iter().copied())
        .collect();
    assert!([0, 1, 2].iter().all(|building| categories.contains(building)), "{categories:?}");
    assert!(categories.len() > 6, "{categories:?}");
    let sentences = std::fs::read(folder.path().join("training-0000.json")).expect("a file");
    let sentences: Vec<serde_json::Value> = serde_json::from_slice(&sentences).expect("JSON");
    let instances: BTreeSet<_> = sentences.iter().filter_map(|said| said["instance"].as_u64()).collect();
    assert!(instances.len() > 3 && !instances.contains(&0), "{sentences:?}");
    assert!(sentences.iter().all(|said| CATEGORIES.contains(&said["category"].as_str().unwrap_or_default())));
    let manifest: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.path().join("frames.json")).expect("a file"))
            .expect("JSON");
    assert_eq!((&manifest["purpose"], &manifest["split"]), (&"training".into(), &"train".into()));
    let again = tempfile::tempdir().expect("a folder");
    take(&options, again.path(), || ()).expect("pictures");
    assert_eq!(std::fs::read(again.path().join("training-0000.npy")).expect("a file"), file);
}

#[test]
fn everything_in_houses_has_a_number() {
    for (seed, pool) in [(1, Pool::Train), (2, Pool::Validation), (3, Pool::Test), (4, Pool::Train)] {
        let house = avln_houses::HouseOptions { pool, ..Default::default() };
        for object in avln_houses::house("house", seed, &house).objects {
            assert!(CATEGORIES.contains(&object.category.as_str()), "{}", object.category);
        }
    }
}

#[test]
fn what_is_for_measurement_says_so() {
    let folder = tempfile::tempdir().expect("a folder");
    let options = FrameOptions { views: 1, side_px: 16, ..options("mini", Purpose::Measurement) };
    take(&options, folder.path(), || ()).expect("pictures");
    let file = std::fs::read(folder.path().join("measurement-0000.npy")).expect("a file");
    let header = String::from_utf8_lossy(&file[..600]).into_owned();
    assert!(header.contains("'hidden_instance'") && !header.contains("'instance'"), "{header}");
}
