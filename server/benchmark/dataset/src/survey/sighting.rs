//! Sightings: pictures of the target objects of a scene from their success regions.

use crate::{
    cue::View,
    survey::{
        look::{Look, Palette, collect_colors},
        options::SurveyOptions,
        place,
    },
};
use avln_episode::Rules;
use avln_geom::{Point3, Pose};
use avln_scene::{InstanceId, Object, categories};
use avln_truth::Target;
use avln_world::{Frame, SceneAssets};
use std::collections::BTreeMap;

/// Looks after which an object that none of them shows at all is given up.
const HOPELESS_LOOKS: usize = 4;

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
        let mut target = place::target_without_views(self.assets, self.rules, object, &object.category)?;
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
        collect_colors(&frame, &mut self.palettes);
        let look = Look::of(view, &frame, object.id, self.options)?;
        let recognised = self.verifier.recognises(&frame, object);
        Some((look, recognised))
    }
}
