//! Survey of a scene: its possible targets, with views, sentences and pictures.

mod look;
mod picture;
mod place;

pub(crate) use look::Palette;
pub(crate) use picture::choose_pictures;
pub use place::target_at;

use crate::{
    cue::{CueView, Description},
    describe::Writer,
};
use avln_episode::Rules;
use avln_geom::{Point3, Pose, Rng};
use avln_scene::{InstanceId, Object, categories};
use avln_truth::Target;
use avln_world::{CameraImage, SceneAssets};
use look::{Look, collect_colors};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Survey thresholds, recorded with a split.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SurveyOptions {
    /// Seed for word choice.
    pub seed: u64,
    /// Picture side, pixels.
    pub look_px: u32,
    /// Most viewpoints tried per object.
    pub looks: usize,
    /// Most viewpoints kept.
    pub viewpoints: usize,
    /// Least pixel share, 0 to 1.
    pub min_share: f32,
    /// Largest pixel share, 0 to 1.
    pub max_share: f32,
    /// Largest outline share on the picture border, 0 to 1.
    pub max_truncation: f32,
    /// Least visible contrast in the strongest channel, 0 to 255.
    pub contrast_levels: u8,
    /// Least outline share with visible contrast, 0 to 1.
    pub min_contrast: f32,
    /// Least colour distance to the surrounding ring, 0 to 1 (1 minus the histogram intersection).
    pub min_distinctness: f32,
    /// Most sentences per instance.
    pub sentences: usize,
    /// Least words per sentence.
    pub min_words: usize,
    /// Most words per sentence.
    pub max_words: usize,
    /// Most reference pictures per instance.
    pub images: usize,
    /// Least picture difference to all other instances in the category, 0 to 1.
    pub min_image_margin: f32,
}

impl Default for SurveyOptions {
    fn default() -> Self {
        Self {
            seed: 0,
            look_px: 96,
            looks: 10,
            viewpoints: 6,
            min_share: 0.006,
            max_share: 0.85,
            max_truncation: 0.35,
            contrast_levels: 16,
            min_contrast: 0.4,
            min_distinctness: 0.25,
            sentences: 3,
            min_words: 8,
            max_words: 35,
            images: 3,
            min_image_margin: 0.35,
        }
    }
}

impl SurveyOptions {
    /// Checks the ranges; returns the first violation.
    pub(crate) fn check(&self) -> Result<(), String> {
        let counts = [
            ("look_px", self.look_px as usize, 16, 1024),
            ("looks", self.looks, 1, 64),
            ("viewpoints", self.viewpoints, 1, 64),
            ("sentences", self.sentences, 0, 16),
            ("min_words", self.min_words, 1, self.max_words),
            ("max_words", self.max_words, self.min_words, 60),
            ("images", self.images, 0, 3),
        ];
        let shares = [
            ("min_share", self.min_share),
            ("max_share", self.max_share),
            ("max_truncation", self.max_truncation),
            ("min_contrast", self.min_contrast),
            ("min_distinctness", self.min_distinctness),
            ("min_image_margin", self.min_image_margin),
        ];
        for (name, value, least, most) in counts {
            if !(least..=most).contains(&value) {
                return Err(format!("`survey.{name}` is {value}; {least} to {most} are possible"));
            }
        }
        match shares.into_iter().find(|(_, value)| !(0.0..=1.0).contains(value)) {
            Some((name, value)) => Err(format!("`survey.{name}` is {value}; 0 to 1 are possible")),
            None => Ok(()),
        }
    }
}

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

/// Attempts before giving up on an invisible object.
const HOPELESS_LOOKS: usize = 4;

/// Extra recognition check after the built-in thresholds, for example a detector.
pub trait Verifier: Sync {
    /// True if `object` is recognisable in `frame`, which has passed the built-in thresholds.
    fn recognises(&self, frame: &CameraImage, object: &Object) -> bool;
}

/// Verifier without extra checks.
#[derive(Clone, Copy, Debug, Default)]
pub struct ThresholdsOnly;

impl Verifier for ThresholdsOnly {
    fn recognises(&self, _: &CameraImage, _: &Object) -> bool {
        true
    }
}

/// Returns the recognised target objects, and observed colours per instance.
pub(crate) fn look_around(
    assets: &SceneAssets,
    rules: &Rules,
    options: &SurveyOptions,
    verifier: &dyn Verifier,
) -> (Vec<Sighting>, BTreeMap<InstanceId, Palette>) {
    let mut surveyor = Surveyor { assets, rules, options, verifier, palettes: BTreeMap::new() };
    let objects = assets.scene.objects.iter().enumerate();
    let candidates = objects.filter(|(_, object)| categories::is_target(&object.category));
    let sightings = candidates.filter_map(|(index, _)| surveyor.inspect(index)).collect();
    (sightings, surveyor.palettes)
}

/// Recognised object.
pub(crate) struct Sighting {
    /// Index in the scene.
    pub(crate) index: usize,
    pub(crate) target: Target,
    /// Good looks, best first; never empty.
    pub(crate) looks: Vec<Look>,
}

/// Survey state.
struct Surveyor<'a> {
    assets: &'a SceneAssets,
    rules: &'a Rules,
    options: &'a SurveyOptions,
    verifier: &'a dyn Verifier,
    /// Observed colours per instance over all pictures.
    palettes: BTreeMap<InstanceId, Palette>,
}

impl Surveyor<'_> {
    fn inspect(&mut self, index: usize) -> Option<Sighting> {
        let object = &self.assets.scene.objects[index];
        let mut target = place::target_without_views(self.assets, self.rules, object, &object.category)?;
        let looks = self.look_at(object, &target.region);
        target.viewpoints = looks.iter().map(|look| look.view.pose).collect();
        (!looks.is_empty()).then_some(Sighting { index, target, looks })
    }

    /// Good looks from places spread over the region, best first.
    fn look_at(&mut self, object: &Object, region: &[Point3<f32>]) -> Vec<Look> {
        let mut good = Vec::new();
        let mut seen = false;
        let places = place::spread(region, &object.bounds.center(), self.options.looks);
        for (number, base) in places.into_iter().enumerate() {
            // Enclosed objects are never visible, and every look renders a picture.
            if number >= HOPELESS_LOOKS && !seen {
                break;
            }
            let pose = place::facing(&base, &object.bounds.center());
            let look = self.take(object, pose);
            seen |= look.is_some();
            good.extend(look.filter(|(look, recognised)| *recognised && look.is_good(self.options)));
        }
        let mut looks: Vec<Look> = good.into_iter().map(|(look, _)| look).collect();
        looks.sort_by(|a, b| b.quality().total_cmp(&a.quality()));
        looks.truncate(self.options.viewpoints);
        looks
    }

    /// Takes and measures a picture; returns the verifier's result with it, or `None` if the object is invisible.
    fn take(&mut self, object: &Object, pose: Pose) -> Option<(Look, bool)> {
        let view = CueView { pose, hfov_rad: 2.0 * Rules::HALF_VIEW_RAD, side_px: self.options.look_px };
        let frame = view.render(self.assets, self.rules);
        collect_colors(&frame, &mut self.palettes);
        let look = Look::of(view, &frame, object.id, self.options)?;
        let recognised = self.verifier.recognises(&frame, object);
        Some((look, recognised))
    }
}
