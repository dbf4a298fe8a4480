//! Checks of goals: targets, cues, success regions. Start poses and lines of sight by parry, independent of the navmesh and of the
//! scene's ray tree.

use crate::{
    check::Constraint,
    cue::{CueSpec, CueView, Description},
    describe::{Facts, fits_only, unsaid},
    mission::GoalSpec,
    recipe::MissionRules,
    survey::{Sightings, SurveyOptions, choose_pictures, counts, look_around},
};
use avln_episode::{Modality, Rules};
use avln_geom::{Capsule, Point3, QueryMesh, Vector3};
use avln_scene::InstanceId;
use avln_truth::Target;
use avln_world::{Body, NavPoint, SceneAssets};
use std::collections::{BTreeMap, btree_map::Entry};

/// Largest distance of a stored point from the mesh, metres.
pub(super) const SNAP_M: f32 = 0.1;
/// Most words per description.
const MAX_WORDS: usize = 60;
/// Tolerance for boxes, metres.
const BOX_M: f32 = 1e-3;

type Faults = Vec<(Constraint, String)>;

/// Goal checker with cached results per target.
pub(super) struct GoalCheck<'a> {
    assets: &'a SceneAssets,
    rules: &'a Rules,
    solid: &'a Solid<'a>,
    seen: Option<&'a Seen<'a>>,
    known: BTreeMap<u32, Known>,
    /// Checked sentences and pictures per target.
    cues: Vec<(u32, CueSpec)>,
}

struct Known {
    target: Target,
    distractors: u8,
    stands: Vec<NavPoint>,
}

impl<'a> GoalCheck<'a> {
    pub(super) fn new(
        assets: &'a SceneAssets,
        rules: &'a Rules,
        solid: &'a Solid<'a>,
        seen: Option<&'a Seen<'a>>,
    ) -> Self {
        Self { assets, rules, solid, seen, known: BTreeMap::new(), cues: Vec::new() }
    }

    /// Returns the success region on the mesh; empty for unchecked goals.
    pub(super) fn stands(&self, goal: &GoalSpec) -> &[NavPoint] {
        self.known.get(&goal.target.instance).map_or(&[], |known| &known.stands)
    }

    /// Checks a goal; renders the picture if `thorough`.
    pub(super) fn check(&mut self, goal: &GoalSpec, limits: &MissionRules, thorough: bool) -> Faults {
        let mut faults = Faults::new();
        let target = Target { modality: Modality::Category, start_distance_m: 0.0, ..goal.target.clone() };
        match self.known.entry(goal.target.instance) {
            Entry::Vacant(entry) => {
                let (stands, found) = inspect(self.assets, self.rules, self.solid, &target);
                faults.extend(found);
                entry.insert(Known { target, distractors: goal.distractors, stands });
                faults.extend(distractors(self.assets, goal, limits));
            }
            Entry::Occupied(entry)
                if entry.get().target != target || entry.get().distractors != goal.distractors =>
            {
                let found = format!("two goals describe instance {} differently", target.instance);
                faults.push((Constraint::Target, found));
            }
            Entry::Occupied(_) => {}
        }
        faults.extend(self.cue(goal, thorough));
        faults.extend(self.ambiguity(goal).map(|found| (Constraint::Cue, found)));
        faults
    }

    /// Reason for an ambiguous cue; every cue is checked once.
    fn ambiguity(&mut self, goal: &GoalSpec) -> Option<String> {
        let seen = self.seen?;
        let (instance, cue) = (goal.target.instance, &goal.cue);
        if self.cues.iter().any(|(known, checked)| *known == instance && checked == cue) {
            return None;
        }
        self.cues.push((instance, cue.clone()));
        match cue {
            CueSpec::Category => None,
            CueSpec::Description(said) => seen.sentence(instance, said),
            CueSpec::Image(view) => seen.picture(instance, view),
        }
    }

    fn cue(&self, goal: &GoalSpec, thorough: bool) -> Faults {
        let mut faults = Faults::new();
        match &goal.cue {
            CueSpec::Category => {}
            CueSpec::Description(sentence) => {
                let words = sentence.text.split_whitespace().count();
                if !(1..=MAX_WORDS).contains(&words) {
                    faults.push((Constraint::Cue, format!("the description has {words} words")));
                }
                if let Some(word) = sentence.claims.as_ref().and_then(|claims| unsaid(&sentence.text, claims))
                {
                    faults.push((Constraint::Cue, format!("'{}' lacks the word '{word}'", sentence.text)));
                }
            }
            CueSpec::Image(view) if thorough => {
                let id = InstanceId(goal.target.instance);
                if !view.render(self.assets, self.rules).instances.contains(&id) {
                    faults.push((Constraint::Cue, format!("the image does not show instance {}", id.0)));
                }
            }
            CueSpec::Image(_) => {}
        }
        faults
    }
}

/// Checks a target's own data; returns the region on the mesh.
fn inspect(
    assets: &SceneAssets,
    rules: &Rules,
    solid: &Solid<'_>,
    target: &Target,
) -> (Vec<NavPoint>, Faults) {
    let mut faults = Faults::new();
    let id = target.instance;
    let object = assets.scene.objects.iter().find(|object| object.id.0 == id);
    let same = object.is_some_and(|object| {
        let (a, b) = (&object.bounds, &target.bounds);
        let off = (a.min - b.min).amax().max((a.max - b.max).amax());
        object.category == target.category && off <= BOX_M
    });
    if !same {
        let found = format!("the scene has no {} with number {id} in that box", target.category);
        faults.push((Constraint::Target, found));
    }
    if target.bounds.distance_m(&target.source) > BOX_M {
        faults.push((Constraint::Source, format!("the sound source of instance {id} is outside the box")));
    }
    let navmesh = &assets.navmesh;
    let stand = |place| {
        let point = navmesh.snap(place, SNAP_M)?;
        (navmesh.island_of(&point) == navmesh.largest_island()).then_some(point)
    };
    let stands: Vec<NavPoint> = target.region.iter().filter_map(stand).collect();
    let (reached, all) = (stands.len(), target.region.len());
    if reached == 0 || reached < all {
        let found = format!("{reached} of {all} success points of instance {id} can be reached");
        faults.push((Constraint::Region, found));
    }
    faults.extend(region_faults(assets, rules, solid, target));
    (stands, faults)
}

fn region_faults(assets: &SceneAssets, rules: &Rules, solid: &Solid<'_>, target: &Target) -> Faults {
    let mut faults = Faults::new();
    let id = InstanceId(target.instance);
    let (inside, outside): (Vec<_>, Vec<_>) =
        target.region.iter().partition(|base| counts(assets, rules, target, base));
    if let Some(base) = outside.first() {
        faults
            .push((Constraint::Region, format!("a Submit for instance {} would not count at {base}", id.0)));
    }
    if let Some(base) = inside.into_iter().find(|base| !solid.confirms_sight(base, id)) {
        let found = format!("a second ray caster does not see instance {} from {base}", id.0);
        faults.push((Constraint::Sight, found));
    }
    if target.viewpoints.is_empty() {
        faults.push((Constraint::Region, format!("instance {} has no viewpoint", id.0)));
    }
    faults
}

fn distractors(assets: &SceneAssets, goal: &GoalSpec, limits: &MissionRules) -> Faults {
    let (id, category) = (goal.target.instance, &goal.target.category);
    let others =
        assets.scene.objects.iter().filter(|other| other.category == *category && other.id.0 != id).count();
    let (count, [fewest, most]) = (u8::try_from(others).unwrap_or(u8::MAX), limits.distractors);
    let mut faults = Faults::new();
    if count != goal.distractors {
        let found = format!("instance {id} has {count} distractors, {} in the file", goal.distractors);
        faults.push((Constraint::Distractors, found));
    }
    if !(fewest..=most).contains(&count) {
        let found = format!("instance {id} has {count} distractors, {fewest} to {most} are allowed");
        faults.push((Constraint::Distractors, found));
    }
    faults
}

pub(super) struct Seen<'a> {
    assets: &'a SceneAssets,
    options: &'a SurveyOptions,
    seen: Sightings,
}

impl<'a> Seen<'a> {
    pub(super) fn of(
        assets: &'a SceneAssets,
        rules: &Rules,
        options: &'a SurveyOptions,
        limits: &MissionRules,
    ) -> Self {
        let seen = look_around(assets, rules, options, &limits.distractor_range());
        Self { assets, options, seen }
    }

    /// Returns the problem with a sentence about `instance`.
    pub(super) fn sentence(&self, instance: u32, said: &Description) -> Option<String> {
        let Some(claims) = &said.claims else {
            return Some("the description has no claims".to_owned());
        };
        let facts = Facts::new(self.assets, &self.seen.palettes);
        let index = self.assets.scene.objects.iter().position(|object| object.id.0 == instance)?;
        let fits = fits_only(&facts, claims, index);
        (!fits).then(|| format!("'{}' does not describe instance {instance} uniquely", said.text))
    }

    /// Returns the problem with a picture of `instance`.
    pub(super) fn picture(&self, instance: u32, view: &CueView) -> Option<String> {
        let objects = &self.assets.scene.objects;
        let sightings = &self.seen.sightings;
        let sighting = sightings.iter().find(|sighting| objects[sighting.index].id.0 == instance);
        let known = sighting.is_some_and(|sighting| {
            choose_pictures(&self.assets.scene, sighting, sightings, self.options).0.contains(view)
        });
        (!known).then(|| {
            format!("the picture does not distinguish instance {instance} from others in the category")
        })
    }
}

/// Rounding of the navmesh: a cell and a level of 5 cm, metres.
const ROUNDING_M: f32 = 0.051;
/// Radius of a body's axis in messages, metres.
const AXIS_M: f32 = 0.005;
/// Largest gap between a hit and the aimed surface point, metres.
const TOLERANCE_M: f32 = 0.01;

/// A scene's triangles for a second opinion.
pub(super) struct Solid<'a> {
    assets: &'a SceneAssets,
    rules: &'a Rules,
    mesh: Option<QueryMesh>,
}

impl<'a> Solid<'a> {
    pub(super) fn new(assets: &'a SceneAssets, rules: &'a Rules) -> Self {
        let mesh = &assets.scene.mesh;
        let mesh = QueryMesh::new(&mesh.positions, (0..).zip(mesh.triangles.iter().copied()));
        Self { assets, rules, mesh }
    }

    /// Returns the problem with a body that stands at `base`.
    pub(super) fn stand_fault(&self, base: &Point3<f32>) -> Option<String> {
        let mesh = self.mesh.as_ref()?;
        let climb_m = Body::default().climb_m;
        let (radius_m, height_m) = (self.rules.body_radius_m, self.rules.body_height_m);
        let body = Capsule {
            base: *base,
            radius_m: (radius_m - ROUNDING_M).max(0.5 * radius_m),
            height_m: height_m - ROUNDING_M,
        };
        // Surfaces below the highest step are floor, not obstacles.
        let lift_m = climb_m + ROUNDING_M;
        let body = body.without_feet(lift_m);
        if mesh.intersects(&body) {
            let axis = Capsule { radius_m: AXIS_M, ..body };
            let room_m = mesh.clearance_m(&axis) + AXIS_M;
            return Some(format!(
                "a body of radius {radius_m} m and height {height_m} m does not fit at {base}: {room_m:.3} m are free around its axis"
            ));
        }
        let reach_m = lift_m + climb_m + ROUNDING_M;
        let stands = mesh.cast_capsule(&body, &-Vector3::y(), reach_m).is_some();
        (!stands).then(|| format!("no floor is within {climb_m} m below {base}"))
    }

    /// Returns true if a sampled surface point of `instance` is visible from the camera at `base` by parry's rays too.
    pub(super) fn confirms_sight(&self, base: &Point3<f32>, instance: InstanceId) -> bool {
        let eye = base + Vector3::y() * self.rules.camera_height_m;
        let mut points = self.assets.visible_points(&eye, instance, Rules::HALF_VIEW_RAD);
        points.any(|point| self.shows(&eye, point, instance))
    }

    fn shows(&self, eye: &Point3<f32>, point: &Point3<f32>, instance: InstanceId) -> bool {
        let offset = point - eye;
        let reach = 1.0 + TOLERANCE_M / offset.norm().max(TOLERANCE_M);
        let hit = self.mesh.as_ref().and_then(|mesh| mesh.cast(eye, &offset, reach));
        hit.is_some_and(|(triangle, _)| self.assets.scene.mesh.instance_of[triangle as usize] == instance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_scene::{RoomPlan, Scene};

    /// A room of 4 m by 4 m with a corner at the origin; the last triangle is instance 1.
    fn room() -> SceneAssets {
        let mut scene: Scene = RoomPlan::shoebox(4.0, 4.0, 2.5).expect("a room").scene();
        let last = scene.mesh.instance_of.last_mut().expect("triangles");
        *last = InstanceId(1);
        SceneAssets::prepare(scene, &Body::default()).expect("a floor")
    }

    #[test]
    fn bodies_need_room_and_a_floor() {
        let (assets, rules) = (room(), Rules::paper());
        let bounds = assets.scene.bounds().expect("walls");
        let solid = Solid::new(&assets, &rules);
        let at = |x: f32, y: f32| Point3::new(bounds.min.x + x, y, bounds.center().z);
        assert_eq!(solid.stand_fault(&at(2.0, 0.0)), None);
        assert_eq!(solid.stand_fault(&at(0.1, 0.0)), None, "a radius from the wall");
        let fault = |place: Point3<f32>| solid.stand_fault(&place).expect("a fault");
        assert!(fault(at(0.03, 0.0)).contains("does not fit"));
        assert!(fault(at(2.0, 1.2)).contains("does not fit"), "the ceiling");
        assert!(fault(at(2.0, 0.6)).contains("no floor"));
    }

    #[test]
    fn sight_is_confirmed_for_visible_instances() {
        let (assets, rules) = (room(), Rules::paper());
        let solid = Solid::new(&assets, &rules);
        let mut base = assets.scene.bounds().expect("walls").center();
        base.y = 0.0;
        assert!(solid.confirms_sight(&base, InstanceId(1)));
        base.x += 9.0;
        assert!(!solid.confirms_sight(&base, InstanceId(1)), "behind a wall, or without it");
        assert!(!solid.confirms_sight(&base, InstanceId(2)), "no such instance");
    }
}
