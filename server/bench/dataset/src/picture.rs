//! Reference pictures, and whether they show one instance and no other of its kind.

use crate::{
    cue::View,
    survey::{Look, Sighting, SurveyOptions},
};
use avln_scene::{Object, Scene};
use std::collections::BTreeSet;

/// How near to the target a thing is that tells its place, metres between boxes.
const NEAR_M: f32 = 0.8;
/// How far from a rival such a thing must be, metres between boxes.
const FAR_M: f32 = 1.5;
/// Share of the picture that such a thing fills at least.
const COMPANION_SHARE: f32 = 0.01;
/// Places of two reference pictures are this far apart, metres.
const APART_M: f32 = 0.6;

/// The reference pictures of an instance, the best first, and the least margin among them (0 without any).
///
/// A picture counts when it differs from every look at every other instance of the category by
/// [`SurveyOptions::min_image_margin`]; none come back when no picture does.
pub(crate) fn choose(
    scene: &Scene,
    sighting: &Sighting,
    all: &[Sighting],
    options: &SurveyOptions,
) -> (Vec<View>, f32) {
    let category = &sighting.target.category;
    let rivals: Vec<&Sighting> = all
        .iter()
        .filter(|other| other.target.category == *category && other.index != sighting.index)
        .collect();
    let mut chosen: Vec<View> = Vec::new();
    let mut least: Option<f32> = None;
    for look in &sighting.looks {
        let margin = rivals.iter().map(|rival| margin(scene, sighting, look, rival)).fold(1.0, f32::min);
        let apart = |other: &View| (other.pose.position - look.view.pose.position).norm() >= APART_M;
        if chosen.len() < options.images && margin >= options.min_image_margin && chosen.iter().all(apart) {
            chosen.push(look.view.as_cue());
            least = Some(least.map_or(margin, |least| least.min(margin)));
        }
    }
    (chosen, least.unwrap_or(0.0))
}

/// By how much `look` differs from a rival, 0 to 1: in its colours, in the room around it, or in what is next to it.
fn margin(scene: &Scene, sighting: &Sighting, look: &Look, rival: &Sighting) -> f32 {
    let nearest = |distance: &dyn Fn(&Look) -> f32| rival.looks.iter().map(distance).fold(1.0, f32::min);
    let colors = nearest(&|other| look.object.distance(&other.object));
    let (own, other) = (&scene.objects[sighting.index], &scene.objects[rival.index]);
    let rooms_differ = own.region.is_some() && other.region.is_some() && own.region != other.region;
    let room = if rooms_differ { nearest(&|other| look.context.distance(&other.context)) } else { 0.0 };
    colors.max(room).max(company(scene, own, look, other))
}

/// Share of the kinds of thing seen next to `own` that are not near `other`, 0 to 1.
fn company(scene: &Scene, own: &Object, look: &Look, other: &Object) -> f32 {
    let enough = COMPANION_SHARE * (look.view.side_px * look.view.side_px) as f32;
    let shown = |thing: &&Object| look.beside.get(&thing.id).is_some_and(|&pixels| pixels as f32 >= enough);
    let around = |object: &Object, reach_m: f32| -> BTreeSet<&str> {
        let reach = object.bounds.grown(reach_m);
        let things = scene.objects.iter().filter(|thing| thing.bounds.intersects(&reach));
        things.filter(|thing| thing.category != own.category).map(|thing| thing.category.as_str()).collect()
    };
    let reach = own.bounds.grown(NEAR_M);
    let seen: BTreeSet<&str> = scene
        .objects
        .iter()
        .filter(|thing| thing.category != own.category && thing.bounds.intersects(&reach))
        .filter(shown)
        .map(|thing| thing.category.as_str())
        .collect();
    let missing = seen.difference(&around(other, FAR_M)).count();
    if seen.is_empty() { 0.0 } else { missing as f32 / seen.len() as f32 }
}
