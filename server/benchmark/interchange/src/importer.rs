//! Import: finds foreign goals in a scene, and computes success regions and reference tours.

use crate::{ForeignCue, ForeignEpisode, ForeignGoal, ForeignInstance, ForeignView, Loss};
use avln_dataset::{
    CueSpec, CueView, Description, EpisodeSpec, GoalSpec, distractors, reference_tours, target_at,
};
use avln_episode::Rules;
use avln_geom::{Aabb, Point3, Pose, Rng, Vector3};
use avln_scene::{InstanceId, Object, Scene, categories::mpcat40};
use avln_truth::Target;
use avln_world::{DistanceField, SceneAssets};
use std::collections::BTreeMap;

/// Most goals per mission; further goals are losses.
pub const MAX_GOALS: usize = 4;
/// Largest distance from a start to the walkable floor, metres.
const SNAP_M: f32 = 0.5;
/// Largest picture pitch, radians. Our cameras are level: with more pitch a picture shows other things.
const MAX_PITCH_RAD: f32 = 0.35;
/// Pitch with a note, radians.
const NOTED_PITCH_RAD: f32 = 0.02;
/// Relative deviation from a stated reference length with a note.
const NOTED_DEVIATION: f64 = 0.1;
/// Least box overlap (shared over joint volume) for equal categories.
const OVERLAP_SAME_CATEGORY: f32 = 0.25;
/// Least box overlap for unequal categories: data sets name objects differently.
const OVERLAP_ANY_CATEGORY: f32 = 0.6;
/// Largest distance from a stated centre to the object's box, metres.
const NEAR_M: f32 = 0.3;

/// Importer for foreign episodes in a scene.
pub struct Importer<'a> {
    assets: &'a SceneAssets,
    rules: &'a Rules,
    seed: u64,
    targets: BTreeMap<InstanceId, Option<Target>>,
}

/// Imported episode.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Imported {
    /// Mission; `None` if no goal can be imported.
    pub episode: Option<EpisodeSpec>,
    /// Goals that cannot be imported.
    pub losses: Vec<Loss>,
    /// Conversion notes.
    pub notes: Vec<String>,
}

impl<'a> Importer<'a> {
    /// Returns an importer for the scene in `assets`. `seed` determines the episode seeds.
    pub fn new(assets: &'a SceneAssets, rules: &'a Rules, seed: u64) -> Self {
        Self { assets, rules, seed, targets: BTreeMap::new() }
    }

    /// Converts an episode: start, cues, and goals found in the scene. The id is `SCENE-ID`, with `_` for hyphens in
    /// the foreign id. Success regions and reference tours follow the rules, not the stated lengths.
    pub fn import(&mut self, foreign: &ForeignEpisode) -> Imported {
        let mut imported = Imported::default();
        match self.mission(foreign, &mut imported) {
            Ok(episode) => imported.episode = Some(episode),
            Err(reason) => imported.losses.push(Loss::episode(foreign, reason)),
        }
        imported
    }

    fn mission(&mut self, foreign: &ForeignEpisode, imported: &mut Imported) -> Result<EpisodeSpec, String> {
        let navmesh = &self.assets.navmesh;
        let start = navmesh.snap(&foreign.start.position, SNAP_M);
        let start =
            start.ok_or_else(|| format!("the start is more than {SNAP_M} m from the walkable floor"))?;
        let field = navmesh.field(&[(start, 0.0)]);
        let mut goals: Vec<GoalSpec> = Vec::new();
        for goal in &foreign.goals {
            let spec = match goals.len() {
                MAX_GOALS => Err(format!("missions have at most {MAX_GOALS} goals")),
                _ => self.goal(goal, &goals, &field, imported),
            };
            match spec {
                Ok(spec) => goals.push(spec),
                Err(reason) => imported.losses.push(Loss::goal(foreign, &goal.name, reason)),
            }
        }
        if goals.is_empty() {
            return Err("no goal can be imported".to_owned());
        }
        let pose = Pose::new(start.position(), foreign.start.heading_rad);
        let tours = reference_tours(self.assets, self.rules, &pose, start, &goals);
        let [ordered, unordered] = tours.ok_or("no path leads through all goals")?;
        // With a goal left out, the tour is shorter than the stated tour, and the lengths are not comparable.
        if imported.losses.is_empty() {
            let lengths_m = [ordered.length_m, unordered.length_m];
            if foreign.stated_m.iter().zip(lengths_m).any(|(stated, ours)| deviates(*stated, ours)) {
                let note = "reference lengths that differ from the file's by more than a tenth";
                imported.notes.push(note.to_owned());
            }
        }
        let id = format!("{}-{}", self.assets.scene.name, foreign.id.replace('-', "_"));
        let seed = Rng::new(self.seed).fork(&id).next_u64();
        let scene = self.assets.scene.name.clone();
        Ok(EpisodeSpec { id, scene, seed, start: pose, goals, ordered, unordered })
    }

    fn goal(
        &mut self,
        goal: &ForeignGoal,
        others: &[GoalSpec],
        from_start: &DistanceField,
        imported: &mut Imported,
    ) -> Result<GoalSpec, String> {
        let cue = self.cue(&goal.cue, imported)?;
        let mut reason = "the file has no instance of this goal".to_owned();
        // Any instance completes a category goal: the nearest is the target, as in the stated shortest path.
        let mut best: Option<Target> = None;
        for instance in &goal.instances {
            let object = find(&self.assets.scene, instance);
            let found = object.and_then(|object| self.target(object, instance));
            let is_nearer = |target: &Target| {
                best.as_ref().is_none_or(|best| target.start_distance_m < best.start_distance_m)
            };
            match found.and_then(|target| self.reached(target, others, from_start)) {
                Ok(target) if is_nearer(&target) => best = Some(target),
                Ok(_) => {}
                Err(cause) => reason = cause,
            }
        }
        let target = best.ok_or(reason)?;
        let target = Target { modality: cue.modality(), ..target };
        let distractors = distractors(&self.assets.scene, InstanceId(target.instance));
        Ok(GoalSpec { target, cue, distractors })
    }

    /// The target with the start distance; an error if it is unreachable or belongs to another goal in the mission.
    fn reached(
        &self,
        target: Target,
        others: &[GoalSpec],
        from_start: &DistanceField,
    ) -> Result<Target, String> {
        if others.iter().any(|other| other.target.instance == target.instance) {
            return Err("the instance is already a goal of this mission".to_owned());
        }
        let navmesh = &self.assets.navmesh;
        let points = target.region.iter().filter_map(|place| navmesh.snap(place, 0.1));
        let distances = points.filter_map(|point| from_start.distance_m(navmesh, &point));
        let start_distance_m =
            distances.min_by(f64::total_cmp).ok_or("no path leads to it from the start")?;
        Ok(Target { start_distance_m, ..target })
    }

    /// Returns the target for an object, with category and viewpoints from the first goal that refers to it.
    fn target(&mut self, object: &Object, named: &ForeignInstance) -> Result<Target, String> {
        let (assets, rules) = (self.assets, self.rules);
        let target = self
            .targets
            .entry(object.id)
            .or_insert_with(|| target_at(assets, rules, object, &named.category, &named.viewpoints));
        target.clone().ok_or_else(|| "too little floor has a view of it".to_owned())
    }

    fn cue(&self, cue: &ForeignCue, imported: &mut Imported) -> Result<CueSpec, String> {
        match cue {
            ForeignCue::Category => Ok(CueSpec::Category),
            ForeignCue::Description(sentence) => {
                Ok(CueSpec::Description(Description { text: sentence.clone(), claims: None }))
            }
            ForeignCue::Image(view) if view.pitch_rad.abs() > MAX_PITCH_RAD => Err(format!(
                "the picture has a pitch of {:.0} degrees, our cameras are level",
                view.pitch_rad.to_degrees()
            )),
            ForeignCue::Image(view) => {
                if view.pitch_rad.abs() > NOTED_PITCH_RAD {
                    imported.notes.push("pictures with a slight pitch: shown level".to_owned());
                }
                Ok(CueSpec::Image(self.view(view)))
            }
        }
    }

    /// Returns the view with the same eye: the base is below it by our camera height.
    fn view(&self, view: &ForeignView) -> CueView {
        let base: Point3<f32> = view.eye - Vector3::y() * self.rules.camera_height_m;
        CueView { pose: Pose::new(base, view.heading_rad), hfov_rad: view.hfov_rad, side_px: 0 }.as_cue()
    }
}

/// True if a stated length deviates from the computed length by more than the tolerance.
fn deviates(stated_m: Option<f64>, computed_m: f64) -> bool {
    stated_m.is_some_and(|m| m > 1e-6 && (m - computed_m).abs() > NOTED_DEVIATION * m)
}

/// Finds a foreign instance's object by box, number or centre, in this order; or the reason why none matches.
fn find<'a>(scene: &'a Scene, wanted: &ForeignInstance) -> Result<&'a Object, String> {
    if let Some(bounds) = &wanted.bounds {
        return by_box(scene, wanted, bounds);
    }
    let near =
        |object: &Object| wanted.center.is_none_or(|center| object.bounds.distance_m(&center) <= NEAR_M);
    let numbered = scene.objects.iter().find(|object| Some(object.id.0) == wanted.id);
    if let Some(object) = numbered.filter(|object| is_category(object, wanted) && near(object)) {
        return Ok(object);
    }
    // Numbers differ between exports of a scene, so a number counts only with the category and a centre nearby.
    let Some(center) = wanted.center else {
        return Err("the scene has no such object, and the file has neither a box nor a position".to_owned());
    };
    let kind = scene.objects.iter().filter(|object| is_category(object, wanted) && near(object));
    let off = |object: &&Object| (object.bounds.center() - center).norm();
    let none = || format!("the scene has no {} at this position", wanted.category);
    kind.min_by(|a, b| off(a).total_cmp(&off(b))).ok_or_else(none)
}

fn by_box<'a>(scene: &'a Scene, wanted: &ForeignInstance, bounds: &Aabb) -> Result<&'a Object, String> {
    let shared = |object: &Object| overlap(&object.bounds, bounds);
    let fits = |object: &&Object| {
        shared(object)
            >= if is_category(object, wanted) { OVERLAP_SAME_CATEGORY } else { OVERLAP_ANY_CATEGORY }
    };
    let best = scene.objects.iter().filter(fits).max_by(|a, b| shared(a).total_cmp(&shared(b)));
    best.ok_or_else(|| format!("the scene has no {} in this box", wanted.category))
}

/// True if the category names agree, after normalisation by mpcat40.
fn is_category(object: &Object, wanted: &ForeignInstance) -> bool {
    let plain = |name: &str| name.to_lowercase().replace('_', " ");
    let category = |name: &str| mpcat40(name).map_or_else(|| plain(name), plain);
    category(&object.category) == category(&wanted.category)
        || (!object.attributes.noun.is_empty() && plain(&object.attributes.noun) == plain(&wanted.category))
}

/// Shared over joint volume.
fn overlap(a: &Aabb, b: &Aabb) -> f32 {
    // Pictures and mirrors have boxes without depth: every box is at least 1 cm thick.
    const THIN_M: f32 = 0.005;
    let (a, b) = (a.grown(THIN_M), b.grown(THIN_M));
    let volume = |size: [f32; 3]| size.into_iter().map(|side| side.max(0.0)).product::<f32>();
    let shared = volume([0, 1, 2].map(|axis| a.max[axis].min(b.max[axis]) - a.min[axis].max(b.min[axis])));
    let joint = volume(a.size().into()) + volume(b.size().into()) - shared;
    if joint > 0.0 { shared / joint } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_scene::{Attributes, Lighting, Mesh};

    fn object(id: u32, category: &str, x: f32) -> Object {
        Object {
            id: InstanceId(id),
            category: category.to_owned(),
            bounds: Aabb::new(Point3::new(x, 0.0, 0.0), Point3::new(x + 1.0, 1.0, 1.0)),
            region: None,
            attributes: Attributes::default(),
        }
    }

    fn scene() -> Scene {
        Scene {
            name: "flat".to_owned(),
            mesh: Mesh::default(),
            materials: vec![],
            textures: vec![],
            regions: vec![],
            objects: vec![object(1, "chair", 0.0), object(2, "table", 3.0), object(3, "chair", 6.0)],
            lighting: Lighting::Painted,
        }
    }

    fn wanted(category: &str) -> ForeignInstance {
        ForeignInstance { category: category.to_owned(), ..ForeignInstance::default() }
    }

    #[test]
    fn overlap_is_shared_over_joint_volume() {
        let cube = |x: f32| Aabb::new(Point3::new(x, 0.0, 0.0), Point3::new(x + 1.0, 1.0, 1.0));
        assert!((overlap(&cube(0.0), &cube(0.0)) - 1.0).abs() < 1e-5);
        // Half is shared: 0.5 / 1.5.
        assert!((overlap(&cube(0.0), &cube(0.5)) - 1.0 / 3.0).abs() < 0.01);
        assert_eq!(overlap(&cube(0.0), &cube(2.0)), 0.0);
    }

    #[test]
    fn box_finds_object_despite_wrong_number() {
        let scene = scene();
        let bounds = Some(Aabb::new(Point3::new(6.1, 0.0, 0.0), Point3::new(7.1, 1.0, 1.0)));
        let found = find(&scene, &ForeignInstance { id: Some(1), bounds, ..wanted("armchair") });
        assert_eq!(found.unwrap().id, InstanceId(3));
        let bounds = Some(Aabb::new(Point3::new(9.0, 0.0, 0.0), Point3::new(10.0, 1.0, 1.0)));
        assert!(find(&scene, &ForeignInstance { bounds, ..wanted("chair") }).unwrap_err().contains("chair"));
    }

    #[test]
    fn number_and_position_decide_without_box() {
        let scene = scene();
        let id = |id, category| find(&scene, &ForeignInstance { id: Some(id), ..wanted(category) });
        assert_eq!(id(2, "table").unwrap().id, InstanceId(2));
        assert!(id(2, "sofa").is_err() && id(9, "table").unwrap_err().contains("neither"));
        let at = |x: f32| {
            let center = Some(Point3::new(x, 0.5, 0.5));
            find(&scene, &ForeignInstance { id: Some(1), center, ..wanted("chair") })
        };
        // Number 1 is elsewhere: the position decides.
        assert_eq!(at(6.6).unwrap().id, InstanceId(3));
        assert!(at(4.9).unwrap_err().contains("no chair at this position"));
    }
}
