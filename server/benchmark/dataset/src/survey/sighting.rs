//! Sightings: pictures of the target objects of a scene from their success regions.

use crate::{
    cue::CueView,
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
use avln_world::{CameraImage, SceneAssets};
use std::collections::BTreeMap;

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
