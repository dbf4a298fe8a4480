//! Survey of a scene: possible targets with views, sentences and unambiguous reference pictures.

pub(crate) mod look;
mod place;
mod thresholds;
mod verify;

pub(crate) use place::counts;
pub use place::target_at;
pub use thresholds::{Removals, SurveyOptions};
pub(crate) use verify::recognised;
pub use verify::{DetectorView, ThresholdsOnly, Verifier, VerifierId};

use crate::{
    cue::{CueView, Description},
    describe::Writer,
    error::DatasetError,
};
use avln_episode::Rules;
use avln_geom::{Point3, Rng};
use avln_scene::{InstanceId, Object, Scene, categories};
use avln_truth::Target;
use avln_world::SceneAssets;
use look::{Look, Palette, collect_colors};
use std::{
    collections::{BTreeMap, BTreeSet},
    ops::RangeInclusive,
};
use thresholds::SurveyTest;

/// Potential target, reachable and recognisable from the success region.
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
    /// Least difference to other pictures in the category: 1 for a unique instance, 0 without pictures.
    pub image_margin: f32,
    /// Other instances in the same category, at most 255.
    pub distractors: u8,
}

/// Result of a survey.
#[derive(Clone, Debug, PartialEq)]
pub struct Survey {
    /// Potential targets, sorted by id.
    pub instances: Vec<Instance>,
    /// Removed instances.
    pub removals: Removals,
}

/// Finds potential targets with default options and without a verifier.
pub fn survey(assets: &SceneAssets, rules: &Rules) -> Vec<Instance> {
    let options = SurveyOptions::default();
    let seen = look_around(assets, rules, &options, &(0..=u8::MAX));
    instances(assets, &options, &seen, |_| true)
}

/// Finds reachable instances of target categories with an allowed number of distractors, recognisable by `options` and
/// `verifier`.
///
/// # Errors
/// If the verifier fails.
#[tracing::instrument(level = "debug", name = "survey", skip_all, fields(scene = assets.scene.name))]
pub fn survey_with(
    assets: &SceneAssets,
    rules: &Rules,
    options: &SurveyOptions,
    verifier: &dyn Verifier,
    distractors: &RangeInclusive<u8>,
) -> Result<Survey, DatasetError> {
    let seen = look_around(assets, rules, options, distractors);
    let recognised = recognised(assets, rules, options, &seen.sightings, verifier)?;
    let mut removals = seen.removals;
    (recognised.len()..seen.sightings.len()).for_each(|_| removals.note(SurveyTest::Verifier));
    let instances = instances(assets, options, &seen, |id| recognised.contains(&id));
    Ok(Survey { instances, removals })
}

/// Describes the sighted instances that satisfy `is_target`. Pictures differ from all others, so that no removed
/// instance resembles a target.
fn instances(
    assets: &SceneAssets,
    options: &SurveyOptions,
    seen: &Sightings,
    is_target: impl Fn(InstanceId) -> bool,
) -> Vec<Instance> {
    let writer = Writer::new(assets, &seen.palettes, options);
    let scene = &assets.scene;
    let instance = |sighting: &Sighting| {
        let id = sighting.id(assets);
        let rng = Rng::new(options.seed).fork(&format!("{} {}", scene.name, id.0));
        let sentences = writer.sentences(sighting, rng);
        let (images, image_margin) = choose_pictures(scene, sighting, &seen.sightings, options);
        Instance {
            target: sighting.target.clone(),
            views: sighting.looks.iter().map(|look| look.view).collect(),
            sentences: sentences.into_iter().map(Description::from).collect(),
            images,
            image_margin,
            distractors: distractors(scene, id),
        }
    };
    seen.sightings.iter().filter(|sighting| is_target(sighting.id(assets))).map(instance).collect()
}

/// Returns the count of other objects in the same category, at most 255.
pub fn distractors(scene: &Scene, id: InstanceId) -> u8 {
    let own = scene.objects.iter().find(|object| object.id == id);
    let same = |other: &&Object| own.is_some_and(|own| own.category == other.category && own.id != other.id);
    u8::try_from(scene.objects.iter().filter(same).count()).unwrap_or(u8::MAX)
}

/// Attempts before giving up on an invisible object.
const HOPELESS_LOOKS: usize = 4;

/// Sighted instances, observed colours per instance, and removed instances.
pub(crate) struct Sightings {
    pub(crate) sightings: Vec<Sighting>,
    pub(crate) palettes: BTreeMap<InstanceId, Palette>,
    pub(crate) removals: Removals,
}

/// Looks at all objects in target categories with an allowed number of distractors.
pub(crate) fn look_around(
    assets: &SceneAssets,
    rules: &Rules,
    options: &SurveyOptions,
    allowed: &RangeInclusive<u8>,
) -> Sightings {
    let mut surveyor = Surveyor { assets, rules, options, palettes: BTreeMap::new() };
    let mut removals = Removals::default();
    let objects = assets.scene.objects.iter().enumerate();
    let candidates = objects.filter(|(_, object)| categories::is_target(&object.category));
    let mut sightings = Vec::new();
    for (index, object) in candidates {
        // Looks are most of the survey. All instances in a category have equally many distractors, so that no rival of a
        // target is skipped.
        let is_allowed = allowed.contains(&distractors(&assets.scene, object.id));
        let sighting = if is_allowed { surveyor.inspect(index) } else { Err(SurveyTest::Distractors) };
        match sighting {
            Ok(sighting) => sightings.push(sighting),
            Err(test) => removals.note(test),
        }
    }
    Sightings { sightings, palettes: surveyor.palettes, removals }
}

pub(crate) struct Sighting {
    pub(crate) index: usize,
    pub(crate) target: Target,
    /// Good looks, best first; never empty.
    pub(crate) looks: Vec<Look>,
}

impl Sighting {
    pub(crate) fn id(&self, assets: &SceneAssets) -> InstanceId {
        assets.scene.objects[self.index].id
    }
}

struct Surveyor<'a> {
    assets: &'a SceneAssets,
    rules: &'a Rules,
    options: &'a SurveyOptions,
    /// Observed colours per instance over all pictures.
    palettes: BTreeMap<InstanceId, Palette>,
}

impl Surveyor<'_> {
    /// Returns the sighting, or the test that removes the object.
    fn inspect(&mut self, index: usize) -> Result<Sighting, SurveyTest> {
        let object = &self.assets.scene.objects[index];
        let target = place::target_without_views(self.assets, self.rules, object, &object.category);
        let mut target = target.ok_or(SurveyTest::Region)?;
        let looks = self.look_at(object, &target.region)?;
        target.viewpoints = looks.iter().map(|look| look.view.pose).collect();
        Ok(Sighting { index, target, looks })
    }

    /// Returns the good looks from places spread over the region, best first, or the test that stops the best look.
    fn look_at(&mut self, object: &Object, region: &[Point3<f32>]) -> Result<Vec<Look>, SurveyTest> {
        let mut looks: Vec<Look> = Vec::new();
        let mut farthest: Option<SurveyTest> = None;
        let center = object.bounds.center();
        let places = place::spread(region, &center, self.options.looks);
        for (number, base) in places.into_iter().enumerate() {
            // Enclosed objects are never visible, and every look renders a picture.
            if number >= HOPELESS_LOOKS && looks.is_empty() && farthest.is_none() {
                break;
            }
            let pose = place::facing(&base, &center);
            let view = CueView { pose, hfov_rad: 2.0 * Rules::HALF_VIEW_RAD, side_px: self.options.look_px };
            let frame = view.render(self.assets, self.rules);
            collect_colors(&frame, &mut self.palettes);
            let Some(look) = Look::of(view, &frame, object.id, self.options) else { continue };
            match look.failed(self.options) {
                None => looks.push(look),
                test => farthest = farthest.max(test),
            }
        }
        if looks.is_empty() {
            return Err(farthest.unwrap_or(SurveyTest::Visible));
        }
        looks.sort_by(|a, b| b.quality().total_cmp(&a.quality()));
        looks.truncate(self.options.viewpoints);
        Ok(looks)
    }
}

/// Largest gap between target and companion, metres between boxes.
const NEAR_M: f32 = 0.8;
/// Least gap between companion and rival, metres between boxes.
const FAR_M: f32 = 1.5;
/// Least pixel share for companions.
const COMPANION_SHARE: f32 = 0.01;
/// Least distance between two picture positions, metres.
const APART_M: f32 = 0.6;

/// Returns the reference pictures, best first, and their least margin (0 without pictures): they differ by
/// [`SurveyOptions::min_image_margin`] from all looks at other instances in the category.
pub(crate) fn choose_pictures(
    scene: &Scene,
    sighting: &Sighting,
    all: &[Sighting],
    options: &SurveyOptions,
) -> (Vec<CueView>, f32) {
    let category = &sighting.target.category;
    let is_rival = |other: &&Sighting| other.target.category == *category && other.index != sighting.index;
    let rivals: Vec<&Sighting> = all.iter().filter(is_rival).collect();
    let mut chosen: Vec<CueView> = Vec::new();
    let mut least: Option<f32> = None;
    for look in &sighting.looks {
        let margin = rivals.iter().map(|rival| margin(scene, sighting, look, rival)).fold(1.0, f32::min);
        let apart = |other: &CueView| (other.pose.position - look.view.pose.position).norm() >= APART_M;
        if chosen.len() < options.images && margin >= options.min_image_margin && chosen.iter().all(apart) {
            chosen.push(look.view.as_cue());
            least = Some(least.map_or(margin, |least| least.min(margin)));
        }
    }
    (chosen, least.unwrap_or(0.0))
}

/// Difference to a rival, 0 to 1: the largest from object colours, room colours, and neighbouring objects.
fn margin(scene: &Scene, sighting: &Sighting, look: &Look, rival: &Sighting) -> f32 {
    let nearest = |distance: &dyn Fn(&Look) -> f32| rival.looks.iter().map(distance).fold(1.0, f32::min);
    let colors = nearest(&|other| look.object.distance(&other.object));
    let (own, other) = (&scene.objects[sighting.index], &scene.objects[rival.index]);
    let rooms_differ = own.region.is_some() && other.region.is_some() && own.region != other.region;
    let room = if rooms_differ { nearest(&|other| look.context.distance(&other.context)) } else { 0.0 };
    // A single clear difference is enough for a visitor to distinguish two instances: the largest counts.
    colors.max(room).max(company(scene, own, look, other))
}

/// Share of neighbour categories visible with `own` and absent near `other`, 0 to 1.
fn company(scene: &Scene, own: &Object, look: &Look, other: &Object) -> f32 {
    let enough = COMPANION_SHARE * (look.view.side_px * look.view.side_px) as f32;
    let shown = |thing: &&Object| look.beside.get(&thing.id).is_some_and(|&pixels| pixels as f32 >= enough);
    let around = |object: &Object, reach_m: f32| {
        let reach = object.bounds.grown(reach_m);
        let is_near =
            move |thing: &&Object| thing.bounds.intersects(&reach) && thing.category != own.category;
        scene.objects.iter().filter(is_near)
    };
    let seen: BTreeSet<&str> =
        around(own, NEAR_M).filter(shown).map(|thing| thing.category.as_str()).collect();
    let there: BTreeSet<&str> = around(other, FAR_M).map(|thing| thing.category.as_str()).collect();
    let missing = seen.difference(&there).count();
    if seen.is_empty() { 0.0 } else { missing as f32 / seen.len() as f32 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_episode::Modality;
    use avln_geom::{Aabb, Pose};
    use avln_scene::{Attributes, Lighting, Mesh};
    use look::Histogram;

    const RED: [u8; 3] = [200, 30, 30];
    const BLUE: [u8; 3] = [30, 30, 200];
    const WHITE: [u8; 3] = [240, 240, 240];

    /// Two sofas 10 m apart; a lamp next to the first.
    fn scene(regions: [u16; 2]) -> Scene {
        let object = |id: u32, category: &str, x: f32, region: u16| Object {
            id: InstanceId(id),
            category: category.to_owned(),
            bounds: Aabb::new(Point3::new(x, 0.0, 0.0), Point3::new(x + 1.0, 1.0, 1.0)),
            region: Some(region),
            attributes: Attributes::default(),
        };
        let objects = vec![
            object(1, "sofa", 0.0, regions[0]),
            object(2, "sofa", 10.0, regions[1]),
            object(3, "lamp", 1.5, regions[0]),
        ];
        Scene {
            name: "sofas".into(),
            mesh: Mesh::default(),
            materials: vec![],
            textures: vec![],
            regions: vec![],
            objects,
            lighting: Lighting::Painted,
        }
    }

    /// Sofa `index`, seen in a colour before another, with or without the lamp.
    fn sighting(scene: &Scene, index: usize, color: [u8; 3], around: [u8; 3], lamp: bool) -> Sighting {
        let bounds = scene.objects[index].bounds;
        let view = CueView { pose: Pose::new(bounds.center(), 0.0), hfov_rad: 1.5, side_px: 96 };
        let of = |rgb: [u8; 3]| Histogram::of(std::iter::once(rgb));
        let look = Look {
            view,
            share: 0.2,
            truncation: 0.0,
            contrast: 1.0,
            distinctness: 1.0,
            object: of(color),
            context: of(around),
            beside: if lamp { BTreeMap::from([(InstanceId(3), 400)]) } else { BTreeMap::new() },
        };
        let target = Target {
            instance: index as u32 + 1,
            category: "sofa".into(),
            modality: Modality::Image,
            bounds,
            source: bounds.center(),
            floor_y_m: 0.0,
            region: vec![],
            viewpoints: vec![],
            start_distance_m: 0.0,
        };
        Sighting { index, target, looks: vec![look] }
    }

    /// Pictures and margin for the first sofa, red before white.
    fn chosen(regions: [u16; 2], lamp: bool, color: [u8; 3], around: [u8; 3]) -> (usize, f32) {
        let scene = scene(regions);
        let all = [sighting(&scene, 0, RED, WHITE, lamp), sighting(&scene, 1, color, around, false)];
        let (views, margin) = choose_pictures(&scene, &all[0], &all, &SurveyOptions::default());
        assert!(views.iter().all(|view| view.side_px == 256));
        (views.len(), margin)
    }

    #[test]
    fn twin_in_the_same_room_excludes_pictures() {
        assert_eq!(
            chosen([0, 0], false, RED, BLUE),
            (0, 0.0),
            "the room is the same, however it looks from there"
        );
    }

    #[test]
    fn colours_company_or_room_distinguish_instances() {
        assert_eq!(chosen([0, 0], false, BLUE, WHITE), (1, 1.0));
        assert_eq!(chosen([0, 0], true, RED, WHITE), (1, 1.0), "only the first one has a lamp next to it");
        assert_eq!(chosen([0, 1], false, RED, BLUE), (1, 1.0));
        assert_eq!(chosen([0, 1], false, RED, WHITE), (0, 0.0), "the other room looks the same");
    }

    #[test]
    fn unique_instance_has_full_margin() {
        let scene = scene([0, 0]);
        let all = [sighting(&scene, 0, RED, WHITE, false)];
        let (views, margin) = choose_pictures(&scene, &all[0], &all, &SurveyOptions::default());
        assert_eq!((views.len(), margin), (1, 1.0));
    }
}
