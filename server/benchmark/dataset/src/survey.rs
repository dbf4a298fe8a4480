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
    cue::{Description, View},
    describe::Writer,
};
use avln_episode::Rules;
use avln_geom::Rng;
use avln_scene::Object;
use avln_truth::Target;
use avln_world::SceneAssets;

/// An instance that can be a target: reachable, and recognisable from where one can stand.
#[derive(Clone, Debug, PartialEq)]
pub struct Instance {
    /// The target, with a modality that the mission overwrites.
    pub target: Target,
    /// Views of it, the one that shows it best first; never empty.
    pub views: Vec<View>,
    /// Sentences that fit this instance of the scene alone; empty when words do not suffice.
    pub sentences: Vec<Description>,
    /// One to three reference pictures that tell it from its kind, the best first; empty when pictures do not suffice.
    pub images: Vec<View>,
    /// The least margin by which its reference pictures differ from its kind: 1 when it is the only one of it, 0 without
    /// pictures.
    pub image_margin: f32,
    /// Other instances of its category in the scene, 255 for more.
    pub distractors: u8,
}

/// Finds the instances of the target categories that are reachable from the largest island and can be recognised,
/// with default options.
pub fn survey(assets: &SceneAssets, rules: &Rules) -> Vec<Instance> {
    survey_with(assets, rules, &SurveyOptions::default(), &ThresholdsOnly)
}

/// Finds the instances of the target categories, in the order of their ids, that are reachable from the largest
/// island, that `options` and `verifier` find recognisable in some picture, and what can be said and shown of each.
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
