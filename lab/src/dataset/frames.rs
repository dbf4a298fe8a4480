//! Pictures with what is in them, from the houses of a split: what perception is trained on, or measured by.
//!
//! A folder holds `frames.json`, which tells kind, categories and houses, and for each house a `.npy` file of records and a
//! `.json` file of what can be said of its instances. The same recipe, split and numbers give the same bytes.

mod record;
mod shot;

pub use record::CATEGORIES;

use crate::parallel;
use avln_arena::{Failure, FailureKind, dataset::write_whole};
use avln_dataset::{Instance, Job, Recipe, SceneChoice, SceneSource, SceneSpec, survey};
use avln_episode::Rules;
use avln_geom::Rng;
use avln_houses::Pool;
use avln_world::{Body, SceneAssets};
use serde::Serialize;
use std::path::Path;

/// Purpose of labelled pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Purpose {
    /// To learn from: houses of the training pool alone.
    Training,
    /// To measure what was learnt: houses of the validation pool alone.
    Measurement,
}

/// Selection of pictures.
#[derive(Clone, Debug)]
pub struct FrameOptions {
    /// The recipe whose houses are drawn.
    pub recipe: Recipe,
    /// One of its splits.
    pub split: String,
    /// Purpose of the pictures.
    pub purpose: Purpose,
    /// Houses, the first ones of the split.
    pub houses: usize,
    /// Pictures in each house.
    pub views: usize,
    /// Pixels along a side.
    pub side_px: u32,
    /// Threads; one for each processor without a number.
    pub threads: Option<usize>,
}

/// Content of `frames.json`.
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
    /// Names of the category numbers.
    categories: &'static [&'static str],
    /// The number of pixels that show none of them.
    unknown: u8,
    houses: Vec<LabelledHouse>,
}

/// One house and its files.
#[derive(Debug, Serialize)]
struct LabelledHouse {
    /// The records of its pictures.
    file: String,
    /// The sentences about its instances.
    sentences: String,
    #[serde(flatten)]
    source: SceneSource,
}

/// A sentence that fits one instance of its house alone.
#[derive(Debug, Serialize)]
struct Sentence {
    instance: u32,
    category: String,
    text: String,
}

impl Purpose {
    /// The only pool whose houses may serve it: those of the test pool serve none.
    fn pool(self) -> Pool {
        match self {
            Self::Training => Pool::Train,
            Self::Measurement => Pool::Validation,
        }
    }

    /// The field of records that holds instances: what is made for one purpose cannot be read as if made for the other.
    fn instance_field(self) -> &'static str {
        match self {
            Self::Training => "instance",
            Self::Measurement => "hidden_instance",
        }
    }

    fn word(self) -> &'static str {
        match self {
            Self::Training => "training",
            Self::Measurement => "measurement",
        }
    }
}

/// Takes the pictures and writes them to `folder`; houses whose files are there already are not visited again. `done` hears of
/// each house.
///
/// # Errors
/// When the split is not one that the purpose allows, has fewer houses, or the folder cannot be written.
pub fn take(options: &FrameOptions, folder: &Path, mut done: impl FnMut()) -> Result<(), Failure> {
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
    let manifest = manifest(options, houses);
    let text =
        serde_json::to_vec_pretty(&manifest).map_err(|error| Failure::new(FailureKind::Internal, error))?;
    write_whole(&folder.join("frames.json"), &text)?;
    parallel::share(&manifest.houses, parallel::threads(options.threads), visit, |_, ()| done())
}

fn manifest(options: &FrameOptions, houses: Vec<LabelledHouse>) -> FramesManifest<'_> {
    FramesManifest {
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
    }
}

/// The number of the split in its recipe.
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
        return Err(refused(format!("split '{name}' is not for {}", purpose.word())).hinted(
            "training takes houses of the training pool; with --measure, those of the validation pool",
        ));
    }
    if split.scene_count() < options.houses {
        return Err(refused(format!(
            "split '{name}' has {} houses, not {}",
            split.scene_count(),
            options.houses
        )));
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

/// The file of what can be said of the instances of a house that can be targets.
fn sentences(assets: &SceneAssets, rules: &Rules) -> Result<Vec<u8>, Failure> {
    let instances = survey(assets, rules);
    let sentences = instances.iter().flat_map(|Instance { target, sentences, .. }| {
        sentences.iter().map(|sentence| Sentence {
            instance: target.instance,
            category: target.category.clone(),
            text: sentence.text.clone(),
        })
    });
    serde_json::to_vec_pretty(&sentences.collect::<Vec<_>>())
        .map_err(|error| Failure::new(FailureKind::Internal, error))
}

/// The file of the pictures of a house.
fn records(house: &LabelledHouse, assets: &SceneAssets, options: &FrameOptions) -> Result<Vec<u8>, Failure> {
    let mut rng = Rng::new(options.recipe.seed).fork(&house.file).fork("frames");
    let shots = shot::shots(assets, &mut rng, options.views, options.side_px);
    let labels = record::Labels::of(&assets.scene);
    let mut file = Vec::new();
    record::write_header(&mut file, options.purpose.instance_field(), options.side_px, shots.len())
        .map_err(|error| Failure::new(FailureKind::Internal, error))?;
    for shot in &shots {
        record::append(&mut file, shot, &assets.render(&shot.camera), &labels);
    }
    Ok(file)
}

#[cfg(test)]
mod tests;
