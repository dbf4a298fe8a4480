//! Labelled images from a split's houses, to train or measure perception.
//!
//! A folder contains `frames.json` with purpose, categories and houses; and per house, a `.npy` file with records and a `.json` file
//! with sentences about instances. Equal options result in equal bytes.

mod record;

pub use record::CATEGORIES;

use crate::{internal, parallel};
use avln_arena::dataset::write_whole;
use avln_arena::{Failure, FailureKind};
use avln_dataset::{Instance, Job, Recipe, SceneChoice, SceneSource, SceneSpec, survey};
use avln_episode::Rules;
use avln_geom::Rng;
use avln_houses::Pool;
use avln_world::{Body, SceneAssets};
use serde::Serialize;
use std::path::Path;

/// Purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Purpose {
    /// Training, with houses from the training pool only.
    Training,
    /// Measurement, with houses from the validation pool only.
    Measurement,
}

/// Settings for labelled images.
#[derive(Clone, Debug)]
pub struct FrameOptions {
    /// House recipe.
    pub recipe: Recipe,
    /// Recipe split.
    pub split: String,
    /// Purpose.
    pub purpose: Purpose,
    /// House count, from the split's start.
    pub houses: usize,
    /// Images per house.
    pub views: usize,
    /// Image side, pixels.
    pub side_px: u32,
    /// Thread count; `None` for one per processor.
    pub threads: Option<usize>,
}

/// `frames.json`.
#[derive(Debug, Serialize)]
struct FramesManifest<'a> {
    /// `avln-frames`.
    format: &'static str,
    version: u32,
    purpose: Purpose,
    recipe: &'a str,
    split: &'a str,
    side_px: u32,
    views: usize,
    categories: &'static [&'static str],
    /// Number for other content.
    unknown: u8,
    houses: Vec<LabelledHouse>,
}

#[derive(Debug, Serialize)]
struct LabelledHouse {
    file: String,
    sentences: String,
    #[serde(flatten)]
    source: SceneSource,
}

/// A sentence about exactly one instance in a house.
#[derive(Debug, Serialize)]
struct Sentence {
    instance: u32,
    category: String,
    text: String,
}

impl Purpose {
    /// Returns the required pool. Test houses are never labelled.
    fn pool(self) -> Pool {
        if self == Self::Training { Pool::Train } else { Pool::Validation }
    }

    /// Returns the record field for instances. The names differ, so that training code cannot read measurement files.
    fn instance_field(self) -> &'static str {
        if self == Self::Training { "instance" } else { "hidden_instance" }
    }

    fn word(self) -> &'static str {
        if self == Self::Training { "training" } else { "measurement" }
    }
}

/// Writes the missing houses to `folder`; calls `on_house` after every house.
///
/// # Errors
/// If the split does not fit the purpose or has fewer houses, or the folder cannot be written.
pub fn take(options: &FrameOptions, folder: &Path, mut on_house: impl FnMut()) -> Result<(), Failure> {
    let split = allowed_split(options)?;
    std::fs::create_dir_all(folder).map_err(|error| Failure::file("make", folder, error))?;
    let houses: Vec<LabelledHouse> =
        (0..options.houses).map(|scene| house(options, Job { split, scene })).collect::<Result<_, _>>()?;
    let rules = options.recipe.rules()?;
    let visit = |house: &LabelledHouse| -> Result<(), Failure> {
        let (path, sentences_path) = (folder.join(&house.file), folder.join(&house.sentences));
        if path.exists() && sentences_path.exists() {
            return Ok(());
        }
        let assets = assets(house, &rules)?;
        write_whole(&sentences_path, &sentences(&assets, &rules)?)?;
        write_whole(&path, &records(house, &assets, options)?)
    };
    let manifest = FramesManifest {
        format: "avln-frames",
        version: 1,
        purpose: options.purpose,
        recipe: &options.recipe.name,
        split: &options.split,
        side_px: options.side_px,
        views: options.views,
        categories: &CATEGORIES,
        unknown: record::UNKNOWN,
        houses,
    };
    let text = serde_json::to_vec_pretty(&manifest).map_err(internal)?;
    write_whole(&folder.join("frames.json"), &text)?;
    parallel::share(&manifest.houses, options.threads, visit, |_, ()| on_house())
}

/// Returns the split's index in the recipe.
fn allowed_split(options: &FrameOptions) -> Result<usize, Failure> {
    let (name, recipe, purpose) = (&options.split, &options.recipe, options.purpose);
    let refused = |message: String| Failure::new(FailureKind::Scene, message);
    let found = recipe.splits.iter().position(|split| split.name == *name).ok_or_else(|| {
        let names: Vec<_> = recipe.splits.iter().map(|split| split.name.as_str()).collect();
        refused(format!("recipe {} has no split '{name}'", recipe.name))
            .hinted(format!("its splits are {}", names.join(", ")))
    })?;
    let split = &recipe.splits[found];
    let pool = match &split.scenes {
        SceneChoice::Houses { pool, .. } => Pool::from_name(pool),
        SceneChoice::Files(_) => None,
    };
    if pool != Some(purpose.pool()) {
        let hint =
            "training needs houses of the training pool; --measure needs houses of the validation pool";
        return Err(refused(format!("split '{name}' is not for {}", purpose.word())).hinted(hint));
    }
    let (count, wanted) = (split.scene_count(), options.houses);
    if count < wanted {
        return Err(refused(format!("split '{name}' has {count} houses, not {wanted}")));
    }
    Ok(found)
}

fn house(options: &FrameOptions, job: Job) -> Result<LabelledHouse, Failure> {
    let name = format!("{}-{:04}", options.purpose.word(), job.scene);
    let source = options.recipe.house(job, 0)?;
    Ok(LabelledHouse { file: format!("{name}.npy"), sentences: format!("{name}.json"), source })
}

fn assets(house: &LabelledHouse, rules: &Rules) -> Result<SceneAssets, Failure> {
    let (_, scene) = SceneSpec::new("house", house.source.clone())?;
    let body = Body { radius_m: rules.body_radius_m, height_m: rules.body_height_m, ..Body::default() };
    SceneAssets::prepare(scene, &body).map_err(|error| Failure::new(FailureKind::Scene, error))
}

/// Encodes the sentences about all possible targets in a house.
fn sentences(assets: &SceneAssets, rules: &Rules) -> Result<Vec<u8>, Failure> {
    let instances = survey(assets, rules);
    let sentences = instances.iter().flat_map(|Instance { target, sentences, .. }| {
        sentences.iter().map(|sentence| Sentence {
            instance: target.instance,
            category: target.category.clone(),
            text: sentence.text.clone(),
        })
    });
    serde_json::to_vec_pretty(&sentences.collect::<Vec<_>>()).map_err(internal)
}

/// Encodes a house's images.
fn records(house: &LabelledHouse, assets: &SceneAssets, options: &FrameOptions) -> Result<Vec<u8>, Failure> {
    let mut rng = Rng::new(options.recipe.seed.unwrap_or_default()).fork(&house.file).fork("frames");
    let shots = record::shots(assets, &mut rng, options.views, options.side_px);
    let labels = record::Labels::of(&assets.scene);
    let mut file = Vec::new();
    record::write_header(&mut file, options.purpose.instance_field(), options.side_px, shots.len())
        .map_err(internal)?;
    for shot in &shots {
        record::append(&mut file, shot, &assets.render(&shot.camera), &labels);
    }
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    fn options(split: &str, purpose: Purpose) -> FrameOptions {
        let recipe = Recipe::from_json(Recipe::EMBEDDED[0].1).expect("a recipe");
        FrameOptions {
            recipe,
            split: split.into(),
            purpose,
            houses: 1,
            views: 6,
            side_px: 32,
            threads: Some(1),
        }
    }

    #[test]
    fn training_and_evaluation_splits_are_exclusive() {
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
    fn training_houses_are_not_in_evaluations() {
        let seeds = |evaluated: bool| -> BTreeSet<u64> {
            let recipes = Recipe::EMBEDDED.map(|(_, text)| Recipe::from_json(text).expect("a recipe"));
            let mut seeds = BTreeSet::new();
            for recipe in &recipes {
                for (job, attempt) in
                    recipe.jobs().flat_map(|job| (0..Recipe::HOUSE_DRAWS).map(move |a| (job, a)))
                {
                    let SceneSource::Procedural { seed, pool, .. } =
                        recipe.house(job, attempt).expect("a house")
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
        // The two houses of recipe `mini` are the first two in the validation split of `paper`.
        assert_eq!((training.len(), evaluated.len()), (600 * 12, (2 + 11 + 18) * 12));
        assert!(training.is_disjoint(&evaluated));
    }

    #[test]
    fn house_files_contain_labels_and_sentences() {
        let folder = tempfile::tempdir().expect("a folder");
        let options = options("train", Purpose::Training);
        take(&options, folder.path(), || ()).expect("pictures");
        let file = std::fs::read(folder.path().join("training-0000.npy")).expect("a file");
        let header_bytes = 10 + usize::from(u16::from_le_bytes([file[8], file[9]]));
        let header = std::str::from_utf8(&file[10..header_bytes]).expect("a text");
        assert!(
            header.contains("('instance', '<u2', (32, 32))") && header.contains("'shape': (6,)"),
            "{header}"
        );
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
        assert!(
            sentences.iter().all(|said| CATEGORIES.contains(&said["category"].as_str().unwrap_or_default()))
        );
        let manifest: serde_json::Value =
            serde_json::from_slice(&std::fs::read(folder.path().join("frames.json")).expect("a file"))
                .expect("JSON");
        assert_eq!((&manifest["purpose"], &manifest["split"]), (&"training".into(), &"train".into()));
        let again = tempfile::tempdir().expect("a folder");
        take(&options, again.path(), || ()).expect("pictures");
        assert_eq!(std::fs::read(again.path().join("training-0000.npy")).expect("a file"), file);
    }

    #[test]
    fn every_category_has_a_number() {
        for (seed, pool) in [(1, Pool::Train), (2, Pool::Validation), (3, Pool::Test), (4, Pool::Train)] {
            let house = avln_houses::HouseOptions { pool, ..Default::default() };
            for object in avln_houses::house("house", seed, &house).objects {
                assert!(CATEGORIES.contains(&object.category.as_str()), "{}", object.category);
            }
        }
    }

    #[test]
    fn measurement_files_are_marked() {
        let folder = tempfile::tempdir().expect("a folder");
        let options = FrameOptions { views: 1, side_px: 16, ..options("mini", Purpose::Measurement) };
        take(&options, folder.path(), || ()).expect("pictures");
        let file = std::fs::read(folder.path().join("measurement-0000.npy")).expect("a file");
        let header = String::from_utf8_lossy(&file[..600]).into_owned();
        assert!(header.contains("'hidden_instance'") && !header.contains("'instance'"), "{header}");
    }
}
