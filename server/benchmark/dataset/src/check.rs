//! Independent check of missions against their constraints, from files and scenes.
//!
//! Distances come from plain fields and tours from brute force; the sampler uses neither. Cues are checked against
//! repeated survey looks. parry gives a second opinion on start poses and lines of sight.

mod goals;

use crate::{
    error::DatasetError,
    mission::EpisodeSpec,
    recipe::MissionRules,
    reference::reference_steps,
    survey::{SurveyOptions, Verifier, look_around, recognised},
};
use avln_episode::Rules;
use avln_scene::InstanceId;
use avln_world::{DistanceField, NavMesh, NavPoint, SceneAssets};
use goals::{GoalCheck, SNAP_M, Seen, Solid};
use std::{
    collections::{BTreeMap, BTreeSet},
    fmt,
};

/// Tolerance for stored lengths, metres.
const LENGTH_M: f64 = 1e-3;
/// Mission count from which targets must be balanced.
const BALANCED_FROM: usize = 50;
/// Allowed uses per target relative to the mean, plus [`REUSE_SLACK`].
const REUSE_FACTOR: f64 = 4.0;
const REUSE_SLACK: f64 = 8.0;

/// Violated constraint.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Mission id.
    pub mission: String,
    /// Constraint.
    pub constraint: Constraint,
    /// Details.
    pub found: String,
}

/// Mission constraint.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Constraint {
    /// Unique ids.
    UniqueIds,
    /// Allowed goal count.
    GoalCount,
    /// At least two modalities.
    Modalities,
    /// Distinct categories.
    Categories,
    /// Distractor count as stored and allowed.
    Distractors,
    /// Existing target instance.
    Target,
    /// Target recognised by the verifier.
    Recognised,
    /// Matching cue: a valid sentence, or a picture with the target.
    Cue,
    /// Sound source at the target.
    Source,
    /// Valid success region points on the reachable island.
    Region,
    /// Lines of sight from the success region, confirmed by a second ray caster.
    Sight,
    /// Start on the reachable island, with room for the body and a floor below.
    Start,
    /// Reachable targets.
    Reachable,
    /// Least start distance, as stored.
    StartDistance,
    /// Least distance between targets.
    Separation,
    /// Stored tours from the start with their stated length.
    ReferencePath,
    /// Correct step count for stored tours.
    ReferenceSteps,
    /// Shortest stored tours.
    ReferenceLength,
    /// Balanced target use.
    Reuse,
}

impl fmt::Display for Constraint {
    /// Writes the variant's name in report style: `goal-count` for `GoalCount`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, letter) in format!("{self:?}").char_indices() {
            let hyphen = if index > 0 && letter.is_ascii_uppercase() { "-" } else { "" };
            write!(f, "{hyphen}{}", letter.to_ascii_lowercase())?;
        }
        Ok(())
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}: {}", self.mission, self.constraint, self.found)
    }
}

/// Thoroughness of the check.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Depth<'a> {
    /// Interval for missions with recomputed tours and rendered pictures; 1 for all.
    pub every: usize,
    /// Survey options for repeated looks: sentences and pictures must then be unambiguous.
    pub survey: Option<&'a SurveyOptions>,
}

/// Checks all missions in a scene.
pub fn check_scene(
    assets: &SceneAssets,
    rules: &Rules,
    limits: &MissionRules,
    episodes: &[EpisodeSpec],
    depth: Depth<'_>,
) -> Vec<Fault> {
    let seen = depth.survey.map(|options| Seen::of(assets, rules, options, limits));
    let solid = Solid::new(assets, rules);
    let goals = GoalCheck::new(assets, rules, &solid, seen.as_ref());
    let mut check = SceneCheck { assets, rules, limits, solid: &solid, goals, faults: Vec::new() };
    let mut ids = BTreeSet::new();
    for (index, episode) in episodes.iter().enumerate() {
        if !ids.insert(&episode.id) {
            check.fault(episode, Constraint::UniqueIds, "its id occurs twice".to_owned());
        }
        check.mission(episode, index % depth.every.max(1) == 0);
    }
    check.reuse(episodes);
    check.faults
}

/// Repeats the survey of a scene, and checks that `verifier` recognises all targets.
///
/// # Errors
/// If the verifier fails.
pub fn check_recognition(
    assets: &SceneAssets,
    rules: &Rules,
    limits: &MissionRules,
    episodes: &[EpisodeSpec],
    (options, verifier): (&SurveyOptions, &dyn Verifier),
) -> Result<Vec<Fault>, DatasetError> {
    let seen = look_around(assets, rules, options, &limits.distractor_range());
    let recognised = recognised(assets, rules, options, &seen.sightings, verifier)?;
    let mut faults: BTreeMap<u32, Fault> = BTreeMap::new();
    for episode in episodes {
        for goal in &episode.goals {
            let (instance, category) = (goal.target.instance, &goal.target.category);
            if !recognised.contains(&InstanceId(instance)) {
                let found = format!("the verifier recognises {category} {instance} in no view");
                let mission = episode.id.clone();
                let fault = Fault { mission, constraint: Constraint::Recognised, found };
                faults.entry(instance).or_insert(fault);
            }
        }
    }
    Ok(faults.into_values().collect())
}

struct SceneCheck<'a> {
    assets: &'a SceneAssets,
    rules: &'a Rules,
    limits: &'a MissionRules,
    solid: &'a Solid<'a>,
    goals: GoalCheck<'a>,
    faults: Vec<Fault>,
}

impl SceneCheck<'_> {
    fn fault(&mut self, episode: &EpisodeSpec, constraint: Constraint, found: String) {
        self.faults.push(Fault { mission: episode.id.clone(), constraint, found });
    }

    fn mission(&mut self, episode: &EpisodeSpec, thorough: bool) {
        self.composition(episode);
        for goal in &episode.goals {
            for (constraint, found) in self.goals.check(goal, self.limits, thorough) {
                self.fault(episode, constraint, found);
            }
        }
        let navmesh = &self.assets.navmesh;
        let start = navmesh.snap(&episode.start.position, SNAP_M);
        let Some(start) = start.filter(|start| navmesh.island_of(start) == navmesh.largest_island()) else {
            let found = format!("no reachable floor is at {}", episode.start.position);
            return self.fault(episode, Constraint::Start, found);
        };
        if let Some(found) = self.solid.stand_fault(&episode.start.position) {
            self.fault(episode, Constraint::Start, found);
        }
        let stands: Vec<Vec<NavPoint>> =
            episode.goals.iter().map(|goal| self.goals.stands(goal).to_vec()).collect();
        self.distances(episode, &start, &stands);
        self.paths(episode);
        if thorough {
            self.tours(episode, start, &stands);
        }
    }

    fn composition(&mut self, episode: &EpisodeSpec) {
        let (count, [fewest, most]) = (episode.goals.len(), self.limits.goals);
        if !(fewest..=most).contains(&count) {
            let found = format!("{count} goals, {fewest} to {most} are allowed");
            self.fault(episode, Constraint::GoalCount, found);
        }
        let modalities: BTreeSet<_> = episode.goals.iter().map(|goal| goal.cue.modality()).collect();
        if modalities.len() < 2.min(count) {
            self.fault(episode, Constraint::Modalities, "all goals have the same modality".to_owned());
        }
        let categories: BTreeSet<_> = episode.goals.iter().map(|goal| &goal.target.category).collect();
        if categories.len() < count {
            self.fault(episode, Constraint::Categories, "two targets have the same category".to_owned());
        }
    }

    fn distances(&mut self, episode: &EpisodeSpec, start: &NavPoint, stands: &[Vec<NavPoint>]) {
        let navmesh = &self.assets.navmesh;
        let from_start = navmesh.field(&[(*start, 0.0)]);
        let (start_m, separation_m) = (self.limits.min_start_m, self.limits.min_separation_m);
        let mut fields = Vec::new();
        for (goal, points) in episode.goals.iter().zip(stands) {
            let least = |field: &DistanceField| {
                let ways = points.iter().filter_map(|point| field.distance_m(navmesh, point));
                ways.fold(f64::INFINITY, f64::min)
            };
            let (found_m, stated_m) = (least(&from_start), goal.target.start_distance_m);
            let instance = goal.target.instance;
            if !found_m.is_finite() {
                self.fault(episode, Constraint::Reachable, format!("no path leads to instance {instance}"));
            } else if (found_m - stated_m).abs() > LENGTH_M {
                let found = format!(
                    "instance {instance} is {found_m:.3} m from the start, {stated_m:.3} m in the file"
                );
                self.fault(episode, Constraint::StartDistance, found);
            }
            if found_m < start_m - LENGTH_M {
                let found =
                    format!("instance {instance} is {found_m:.3} m from the start, less than {start_m} m");
                self.fault(episode, Constraint::StartDistance, found);
            }
            let apart_m = fields.iter().map(least).fold(f64::INFINITY, f64::min);
            if apart_m < separation_m - LENGTH_M {
                let found = format!(
                    "instance {instance} is {apart_m:.3} m from another target, less than {separation_m} m"
                );
                self.fault(episode, Constraint::Separation, found);
            }
            let seeds: Vec<_> = points.iter().map(|point| (*point, 0.0)).collect();
            fields.push(navmesh.field(&seeds));
        }
    }

    fn paths(&mut self, episode: &EpisodeSpec) {
        for (name, tour) in [("ordered", &episode.ordered), ("unordered", &episode.unordered)] {
            let walked: f64 = tour.path.windows(2).map(|leg| f64::from((leg[1] - leg[0]).norm())).sum();
            if (walked - tour.length_m).abs() > 0.02 + 1e-4 * tour.length_m {
                let found =
                    format!("the {name} tour is {walked:.3} m long, {:.3} m in the file", tour.length_m);
                self.fault(episode, Constraint::ReferencePath, found);
            }
            let begins =
                tour.path.first().map_or(f32::INFINITY, |first| (first - episode.start.position).norm());
            if begins > SNAP_M {
                let found = format!("the {name} tour begins {begins} m from the start");
                self.fault(episode, Constraint::ReferencePath, found);
            }
            let steps =
                reference_steps(self.rules, &episode.start, &tour.path, tour.length_m, episode.goals.len());
            if steps != tour.steps {
                let found = format!("the {name} tour takes {steps} steps, {} in the file", tour.steps);
                self.fault(episode, Constraint::ReferenceSteps, found);
            }
        }
    }

    fn tours(&mut self, episode: &EpisodeSpec, start: NavPoint, stands: &[Vec<NavPoint>]) {
        let tours = Tours { navmesh: &self.assets.navmesh, regions: stands };
        let lengths = [
            ("ordered", tours.ordered_m(start), episode.ordered.length_m),
            ("unordered", tours.unordered_m(start), episode.unordered.length_m),
        ];
        for (name, found_m, stated_m) in lengths {
            let off_m = (found_m - stated_m).abs();
            if off_m.is_nan() || off_m > LENGTH_M {
                let found =
                    format!("the shortest {name} tour is {found_m:.4} m, {stated_m:.4} m in the file");
                self.fault(episode, Constraint::ReferenceLength, found);
            }
        }
    }

    fn reuse(&mut self, episodes: &[EpisodeSpec]) {
        let mut uses: BTreeMap<u32, usize> = BTreeMap::new();
        let goals = episodes.iter().flat_map(|episode| &episode.goals);
        goals.for_each(|goal| *uses.entry(goal.target.instance).or_default() += 1);
        let mean = uses.values().sum::<usize>() as f64 / uses.len().max(1) as f64;
        let most = uses.iter().max_by_key(|(_, count)| **count);
        if episodes.len() < BALANCED_FROM {
            return;
        }
        if let Some((instance, &count)) = most
            && count as f64 > REUSE_FACTOR * mean + REUSE_SLACK
        {
            let found = format!("instance {instance} is a target {count} times, the mean is {mean:.1} times");
            self.fault(&episodes[0], Constraint::Reuse, found);
        }
    }
}

/// Shortest tours by plain distance fields: slower than the atlas of the sampler, and independent of it.
struct Tours<'a> {
    navmesh: &'a NavMesh,
    regions: &'a [Vec<NavPoint>],
}

impl Tours<'_> {
    /// Length in region order, metres; infinite if unreachable.
    fn ordered_m(&self, start: NavPoint) -> f64 {
        let mut field = self.navmesh.field(&[(start, 0.0)]);
        let mut length_m = f64::INFINITY;
        for region in 0..self.regions.len() {
            (field, length_m) = self.visit(&field, region);
        }
        length_m
    }

    /// Length in the best order, by brute force.
    fn unordered_m(&self, start: NavPoint) -> f64 {
        let mut best_m = f64::INFINITY;
        let left: Vec<usize> = (0..self.regions.len()).collect();
        self.try_all(&self.navmesh.field(&[(start, 0.0)]), &left, &mut best_m);
        best_m
    }

    fn try_all(&self, field: &DistanceField, left: &[usize], best_m: &mut f64) {
        for &region in left {
            let (onward, length_m) = self.visit(field, region);
            if length_m >= *best_m {
                continue;
            }
            let rest: Vec<usize> = left.iter().copied().filter(|&other| other != region).collect();
            if rest.is_empty() {
                *best_m = length_m;
            } else {
                self.try_all(&onward, &rest, best_m);
            }
        }
    }

    /// Continues to every point in a region; returns the field from there and the least distance, metres.
    fn visit(&self, field: &DistanceField, region: usize) -> (DistanceField, f64) {
        let points = self.regions[region].iter();
        let seeds: Vec<_> =
            points.filter_map(|point| Some((*point, field.distance_m(self.navmesh, point)?))).collect();
        let least_m = seeds.iter().map(|seed| seed.1).fold(f64::INFINITY, f64::min);
        (self.navmesh.field(&seeds), least_m)
    }
}
