//! From the objects of a scene to instances that can be targets, with everything that a mission may say of them.

mod look;
mod options;
mod palette;
pub(crate) mod place;

#[cfg(test)]
pub(crate) use look::Histogram;
pub(crate) use look::Look;
pub use options::SurveyOptions;
pub(crate) use palette::Palette;

use crate::{
    cue::{Description, View},
    describe::Writer,
    picture,
};
use avln_episode::{Modality, Rules};
use avln_geom::{Point3, Pose, Rng};
use avln_scene::{InstanceId, Object, categories};
use avln_truth::Target;
use avln_world::{Frame, SceneAssets};
use std::collections::BTreeMap;

/// Fewest sampled points of a success region that one can really stand in.
const MIN_REGION_POINTS: usize = 4;
/// Looks after which an object that none of them shows at all is given up.
const HOPELESS_LOOKS: usize = 4;

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

/// Judges pictures in place of the built-in thresholds, for example with a detector.
pub trait Verifier: Sync {
    /// Whether `object` can be recognised in `frame`, which the built-in thresholds already accept.
    fn recognises(&self, frame: &Frame, object: &Object) -> bool;
}

/// Accepts what the built-in thresholds accept.
#[derive(Clone, Copy, Debug, Default)]
pub struct ThresholdsOnly;

impl Verifier for ThresholdsOnly {
    fn recognises(&self, _: &Frame, _: &Object) -> bool {
        true
    }
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

/// The target objects that were recognised, and the colours in which each instance was seen on the way.
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

/// An object that was recognised.
pub(crate) struct Sighting {
    /// Its index in the scene.
    pub(crate) index: usize,
    pub(crate) target: Target,
    /// The good looks at it, the best first; never empty.
    pub(crate) looks: Vec<Look>,
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
    let (images, image_margin) = picture::choose(scene, sighting, all, options);
    Instance {
        target: sighting.target.clone(),
        views: sighting.looks.iter().map(|look| look.view).collect(),
        sentences: sentences.into_iter().map(Description::from).collect(),
        images,
        image_margin,
        distractors: u8::try_from(scene.objects.iter().filter(same).count()).unwrap_or(u8::MAX),
    }
}

/// Goes through the house and looks at things.
struct Surveyor<'a> {
    assets: &'a SceneAssets,
    rules: &'a Rules,
    options: &'a SurveyOptions,
    verifier: &'a dyn Verifier,
    /// The colours in which each instance was seen in all pictures.
    palettes: BTreeMap<InstanceId, Palette>,
}

impl Surveyor<'_> {
    fn inspect(&mut self, index: usize) -> Option<Sighting> {
        let object = &self.assets.scene.objects[index];
        let mut target = Target {
            instance: object.id.0,
            category: object.category.clone(),
            modality: Modality::Category,
            bounds: object.bounds,
            source: object.bounds.center(),
            floor_y_m: place::floor_below(self.assets, &object.bounds)?,
            region: Vec::new(),
            viewpoints: Vec::new(),
            start_distance_m: 0.0,
        };
        target.region = place::success_region(self.assets, self.rules, &target);
        if target.region.len() < MIN_REGION_POINTS {
            return None;
        }
        let looks = self.look_at(object, &target.region);
        target.viewpoints = looks.iter().map(|look| look.view.pose).collect();
        (!looks.is_empty()).then_some(Sighting { index, target, looks })
    }

    /// The good looks at an object from places spread over its region, the best first.
    fn look_at(&mut self, object: &Object, region: &[Point3<f32>]) -> Vec<Look> {
        let mut good = Vec::new();
        let mut seen = false;
        let places = place::spread(region, &object.bounds.center(), self.options.looks);
        for (number, base) in places.into_iter().enumerate() {
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

    /// One picture, measured, and whether the verifier recognises the object; `None` where it does not show.
    fn take(&mut self, object: &Object, pose: Pose) -> Option<(Look, bool)> {
        let view = View { pose, hfov_rad: 2.0 * Rules::HALF_VIEW_RAD, side_px: self.options.look_px };
        let frame = view.render(self.assets, self.rules);
        look::collect_colors(&frame, &mut self.palettes);
        let look = Look::of(view, &frame, object.id, self.options)?;
        let recognised = self.verifier.recognises(&frame, object);
        Some((look, recognised))
    }
}
