use super::{Foreign, ForeignCue, ForeignEpisode, ForeignGoal, ForeignInstance, Loss, Shot, matching, tours};
use crate::{
    cue::{CueSpec, Description, View},
    mission::{EpisodeSpec, GoalSpec},
    survey::place,
};
use avln_episode::{Modality, Rules};
use avln_geom::{Point3, Pose, Rng, Vector3};
use avln_scene::{InstanceId, Object, Scene};
use avln_truth::Target;
use avln_world::{DistanceField, SceneAssets};
use std::collections::BTreeMap;

/// Most goals of a mission of ours; what comes after them is left out and told.
pub const MAX_GOALS: usize = 4;
/// How far from the walkable floor a start or a viewpoint may lie, metres.
const SNAP_M: f32 = 0.5;
/// Fewest places of a success region.
const FEWEST_PLACES: usize = 4;
/// Most viewpoints that are kept, and how many are made where the file has none.
const MOST_VIEWPOINTS: usize = 12;
/// Our cameras look level; a picture that was taken more tilted than this shows something else, radians.
const MOST_TILT_RAD: f32 = 0.35;
/// A stated reference length that is off by more than this share is worth a note.
const OFF: f64 = 0.1;

/// Makes missions of ours out of foreign episodes of one scene.
pub struct Adopter<'a> {
    assets: &'a SceneAssets,
    rules: &'a Rules,
    seed: u64,
    targets: BTreeMap<InstanceId, Option<Target>>,
}

/// What became of one foreign episode.
#[derive(Clone, Debug, PartialEq)]
pub struct Adopted {
    /// The mission; `None` where nothing could be kept.
    pub episode: Option<EpisodeSpec>,
    /// What could not be kept.
    pub losses: Vec<Loss>,
    /// What was done on the way.
    pub notes: Vec<String>,
}

impl<'a> Adopter<'a> {
    /// For the scene of `assets`, by `rules`; `seed` is for what is drawn while episodes run.
    pub fn new(assets: &'a SceneAssets, rules: &'a Rules, seed: u64) -> Self {
        Self { assets, rules, seed, targets: BTreeMap::new() }
    }

    /// The mission that is nearest to `foreign`: its start and cues, its goals found in the scene, and its id behind the
    /// scene's name and a hyphen, with `_` for hyphens of its own. The success regions and reference tours are computed by
    /// our rules, whatever lengths the file states.
    pub fn adopt(&mut self, foreign: &ForeignEpisode) -> Adopted {
        let mut adopted = Adopted { episode: None, losses: Vec::new(), notes: Vec::new() };
        match self.mission(foreign, &mut adopted) {
            Ok(episode) => adopted.episode = Some(episode),
            Err(reason) => adopted.losses.push(Loss::episode(foreign, reason)),
        }
        adopted
    }

    fn mission(&mut self, foreign: &ForeignEpisode, adopted: &mut Adopted) -> Result<EpisodeSpec, String> {
        let navmesh = &self.assets.navmesh;
        let start = navmesh.snap(&foreign.start.position, SNAP_M);
        let start =
            start.ok_or_else(|| format!("its start is more than {SNAP_M} m off the walkable floor"))?;
        let field = navmesh.field(&[(start, 0.0)]);
        let mut goals: Vec<GoalSpec> = Vec::new();
        for goal in &foreign.goals {
            let spec = match goals.len() {
                MAX_GOALS => Err(format!("missions have at most {MAX_GOALS} goals")),
                _ => self.goal(goal, &goals, &field, adopted),
            };
            match spec {
                Ok(spec) => goals.push(spec),
                Err(reason) => adopted.losses.push(Loss::goal(foreign, &goal.name, reason)),
            }
        }
        if goals.is_empty() {
            return Err("none of its goals could be kept".to_owned());
        }
        let pose = Pose::new(start.position(), foreign.start.heading_rad);
        let tours = tours::tours(self.assets, self.rules, &pose, start, &goals);
        let [ordered, unordered] = tours.ok_or("no walk leads through its goals")?;
        self.compare(foreign, ordered.length_m, unordered.length_m, adopted);
        let id = format!("{}-{}", self.assets.scene.name, foreign.id.replace('-', "_"));
        let seed = Rng::new(self.seed).fork(&id).next_u64();
        let scene = self.assets.scene.name.clone();
        Ok(EpisodeSpec { id, scene, seed, start: pose, goals, ordered, unordered })
    }

    /// Notes reference lengths that our rules make another.
    fn compare(&self, foreign: &ForeignEpisode, ordered_m: f64, unordered_m: f64, adopted: &mut Adopted) {
        let whole = adopted.losses.is_empty();
        for (stated_m, ours_m) in foreign.stated_m.into_iter().zip([ordered_m, unordered_m]) {
            let Some(stated_m) = stated_m.filter(|stated_m| whole && *stated_m > 1e-6) else { continue };
            if (stated_m - ours_m).abs() > OFF * stated_m {
                adopted
                    .notes
                    .push("reference lengths that differ from the file's by more than a tenth".to_owned());
            }
        }
    }

    fn goal(
        &mut self,
        goal: &ForeignGoal,
        others: &[GoalSpec],
        from_start: &DistanceField,
        adopted: &mut Adopted,
    ) -> Result<GoalSpec, String> {
        let cue = self.cue(&goal.cue, adopted)?;
        let mut reason = "the file has no instance of it".to_owned();
        let mut best: Option<Target> = None;
        for instance in &goal.instances {
            let object = matching::find(&self.assets.scene, instance);
            let found = object.and_then(|object| self.target(object, instance));
            let is_nearer = |target: &Target| {
                best.as_ref().is_none_or(|best| target.start_distance_m < best.start_distance_m)
            };
            match found.and_then(|target| self.reached(target, others, from_start)) {
                Ok(target) if is_nearer(&target) => best = Some(target),
                Ok(_) => {}
                Err(why) => reason = why,
            }
        }
        let target = best.ok_or(reason)?;
        let target = Target { modality: cue.modality(), ..target };
        let distractors = distractors(&self.assets.scene, target.instance);
        Ok(GoalSpec { target, cue, distractors })
    }

    /// The target with its distance, unless it cannot be reached or is another goal's.
    fn reached(
        &self,
        target: Target,
        others: &[GoalSpec],
        from_start: &DistanceField,
    ) -> Result<Target, String> {
        if others.iter().any(|other| other.target.instance == target.instance) {
            return Err("its instance is a goal of this mission already".to_owned());
        }
        let navmesh = &self.assets.navmesh;
        let points = target.region.iter().filter_map(|place| navmesh.snap(place, 0.1));
        let distances = points.filter_map(|point| from_start.distance_m(navmesh, &point));
        let start_distance_m =
            distances.min_by(f64::total_cmp).ok_or("no walk leads there from the start")?;
        Ok(Target { start_distance_m, ..target })
    }

    /// The target that an object of the scene makes, with its success region, and with the category and the viewpoints
    /// of the first goal that names it.
    fn target(&mut self, object: &Object, named: &ForeignInstance) -> Result<Target, String> {
        let (assets, rules) = (self.assets, self.rules);
        let made = self.targets.entry(object.id).or_insert_with(|| target(assets, rules, object, named));
        made.clone()
            .ok_or_else(|| "there is too little floor from which it can be seen and reached".to_owned())
    }

    fn cue(&self, cue: &ForeignCue, adopted: &mut Adopted) -> Result<CueSpec, String> {
        match cue {
            ForeignCue::Category => Ok(CueSpec::Category),
            ForeignCue::Description(sentence) => {
                Ok(CueSpec::Description(Description { text: sentence.clone(), claims: None }))
            }
            ForeignCue::Image(shot) if shot.pitch_rad.abs() > MOST_TILT_RAD => Err(format!(
                "its picture was taken with the camera tilted by {:.0} degrees, ours look level",
                shot.pitch_rad.to_degrees()
            )),
            ForeignCue::Image(shot) => {
                if shot.pitch_rad.abs() > 0.02 {
                    adopted.notes.push("pictures taken with a slight tilt: shown level".to_owned());
                }
                Ok(CueSpec::Image(self.view(shot)))
            }
        }
    }

    /// The view whose eye is that of the shot: its base lies as much lower as our cameras are high.
    fn view(&self, shot: &Shot) -> View {
        let base: Point3<f32> = shot.eye - Vector3::y() * self.rules.camera_height_m;
        View { pose: Pose::new(base, shot.heading_rad), hfov_rad: shot.hfov_rad, side_px: 0 }.as_cue()
    }
}

fn target(assets: &SceneAssets, rules: &Rules, object: &Object, named: &ForeignInstance) -> Option<Target> {
    let center = object.bounds.center();
    let mut target = Target {
        instance: object.id.0,
        category: named.category.clone(),
        modality: Modality::Category,
        bounds: object.bounds,
        source: center,
        floor_y_m: place::floor_below(assets, &object.bounds)?,
        region: Vec::new(),
        viewpoints: Vec::new(),
        start_distance_m: 0.0,
    };
    target.region = place::success_region(assets, rules, &target);
    target.viewpoints = on_floor(assets, &named.viewpoints);
    if target.viewpoints.is_empty() {
        let spread = place::spread(&target.region, &center, MOST_VIEWPOINTS);
        target.viewpoints = spread.iter().map(|base| place::facing(base, &center)).collect();
    }
    (target.region.len() >= FEWEST_PLACES).then_some(target)
}

/// Other objects of the category that an object has in the scene, 255 for more.
fn distractors(scene: &Scene, instance: u32) -> u8 {
    let own = scene.objects.iter().find(|object| object.id.0 == instance);
    let same = |other: &&Object| own.is_some_and(|own| own.category == other.category && own.id != other.id);
    u8::try_from(scene.objects.iter().filter(same).count()).unwrap_or(u8::MAX)
}

/// The poses that are on the floor.
fn on_floor(assets: &SceneAssets, poses: &[Pose]) -> Vec<Pose> {
    let snapped = poses.iter().filter_map(|pose| {
        let point = assets.navmesh.snap(&pose.position, SNAP_M)?;
        Some(Pose::new(point.position(), pose.heading_rad))
    });
    snapped.take(MOST_VIEWPOINTS).collect()
}

impl Foreign {
    /// The scenes of its episodes, in the order of their names, each with how many episodes it has.
    pub fn scenes(&self) -> BTreeMap<&str, usize> {
        let mut scenes = BTreeMap::new();
        self.episodes.iter().for_each(|episode| *scenes.entry(episode.scene.as_str()).or_default() += 1);
        scenes
    }
}
