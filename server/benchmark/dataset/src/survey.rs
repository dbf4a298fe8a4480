//! Survey of a scene: its possible targets, with views, sentences and pictures.

mod look;
mod options;
mod picture;
mod place;
mod sighting;

pub(crate) use look::Palette;
pub use options::SurveyOptions;
pub(crate) use picture::choose_pictures;
pub use place::target_at;
pub(crate) use sighting::{Sighting, look_around};
pub use sighting::{ThresholdsOnly, Verifier};

use crate::{
    cue::{CueView, Description},
    describe::Writer,
};
use avln_episode::Rules;
use avln_geom::Rng;
use avln_scene::Object;
use avln_truth::Target;
use avln_world::SceneAssets;

/// Potential target: reachable and recognisable from its success region.
#[derive(Clone, Debug, PartialEq)]
pub struct Instance {
    /// Target; missions overwrite the modality.
    pub target: Target,
    /// Views, best first; never empty.
    pub views: Vec<CueView>,
    /// Unambiguous sentences; possibly empty.
    pub sentences: Vec<Description>,
    /// Unambiguous reference pictures, best first, at most three; possibly empty.
    pub images: Vec<CueView>,
    /// Least difference between its pictures and those of its category: 1 for a unique instance, 0 without pictures.
    pub image_margin: f32,
    /// Other instances in the same category, at most 255.
    pub distractors: u8,
}

/// Finds potential targets with default options.
pub fn survey(assets: &SceneAssets, rules: &Rules) -> Vec<Instance> {
    survey_with(assets, rules, &SurveyOptions::default(), &ThresholdsOnly)
}

/// Finds instances of target categories, sorted by id: reachable from the largest island, and recognisable by `options`
/// and `verifier`; with views, sentences and pictures.
pub fn survey_with(
    assets: &SceneAssets,
    rules: &Rules,
    options: &SurveyOptions,
    verifier: &dyn Verifier,
) -> Vec<Instance> {
    let (sightings, palettes) = look_around(assets, rules, options, verifier);
    let writer = Writer::new(assets, &palettes, options);
    sightings.iter().map(|sighting| instance(assets, sighting, &sightings, &writer, options)).collect()
}

fn instance(
    assets: &SceneAssets,
    sighting: &Sighting,
    all: &[Sighting],
    writer: &Writer,
    options: &SurveyOptions,
) -> Instance {
    let scene = &assets.scene;
    let object = &scene.objects[sighting.index];
    let same = |other: &&Object| other.category == object.category && other.id != object.id;
    let rng = Rng::new(options.seed).fork(&format!("{} {}", scene.name, object.id.0));
    let sentences = writer.sentences(sighting, rng);
    let (images, image_margin) = choose_pictures(scene, sighting, all, options);
    Instance {
        target: sighting.target.clone(),
        views: sighting.looks.iter().map(|look| look.view).collect(),
        sentences: sentences.into_iter().map(Description::from).collect(),
        images,
        image_margin,
        distractors: u8::try_from(scene.objects.iter().filter(same).count()).unwrap_or(u8::MAX),
    }
}
