//! Distractor sources: sounding non-goals, drawn from the targets of a scene's other missions.
//!
//! Position must not distinguish a distractor from a target, so that a distractor follows the constraints of targets: apart from the
//! start and from other sources, on the storey of a goal, with about its walking distance from the start. Category is no constraint.

use crate::mission::EpisodeSpec;
use avln_episode::{Order, Rules};
use avln_geom::{Point3, Rng};
use avln_truth::{DistractorSource, EpisodeTruth, Target};
use avln_world::{DistanceField, NavMesh, NavPoint, SceneAssets};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::OnceLock;

/// Candidates of which one is drawn: those most like a goal.
const ALIKE: usize = 6;
/// Penalty for another storey, metres: candidates on the same one come first.
const OTHER_STOREY_M: f64 = 1e6;
/// Largest height difference of floors on the same storey, metres.
const SAME_STOREY_M: f32 = 1.0;
/// Largest distance from a stored point to the mesh, metres.
const SNAP_M: f32 = 0.5;

/// The missions of a scene, and the constraint that their goals satisfy.
#[derive(Debug)]
pub struct SceneMissions {
    episodes: Vec<EpisodeSpec>,
    /// Computed at the first draw.
    min_separation_m: OnceLock<f64>,
}

impl SceneMissions {
    /// Creates the missions of a scene from all its episodes.
    pub fn new(episodes: Vec<EpisodeSpec>) -> Self {
        Self { episodes, min_separation_m: OnceLock::new() }
    }

    /// Returns the missions.
    pub fn episodes(&self) -> &[EpisodeSpec] {
        &self.episodes
    }

    /// Returns the number of targets that are no goals of `episode`.
    pub fn distractor_candidates(&self, episode: &EpisodeSpec) -> usize {
        candidates(episode, &self.episodes).len()
    }

    /// Returns the ground truth of `episode`, one of the missions, with the distractor sources of `rules`; fewer if the scene has
    /// fewer other targets.
    pub fn truth(
        &self,
        episode: &EpisodeSpec,
        order: Order,
        rules: &Rules,
        assets: &SceneAssets,
    ) -> EpisodeTruth {
        let count = rules.distractor_sources.count(episode.goals.len());
        EpisodeTruth {
            distractor_sources: self.distractor_sources(episode, assets, count),
            ..episode.truth(order)
        }
    }

    /// Draws `count` distractor sources for `episode` among the targets of the missions; fewer if they have fewer.
    ///
    /// Equal episodes give equal sources. The draw is independent of goal order, cues and categories.
    pub fn distractor_sources(
        &self,
        episode: &EpisodeSpec,
        assets: &SceneAssets,
        count: usize,
    ) -> Vec<DistractorSource> {
        if count == 0 {
            return Vec::new();
        }
        let navmesh = &assets.navmesh;
        let least_m = *self.min_separation_m.get_or_init(|| min_separation_m(&self.episodes, navmesh));
        let mut draw = Draw::new(episode, &self.episodes, navmesh, least_m);
        let mut rng = Rng::new(episode.seed).fork("distractors");
        let mut like: Vec<&Target> = episode.goals.iter().map(|goal| &goal.target).collect();
        rng.shuffle(&mut like);
        like.iter().cycle().take(count).map_while(|goal| draw.next(goal, &mut rng)).collect()
    }
}

/// Returns the targets of the other missions by instance id.
fn candidates<'a>(episode: &EpisodeSpec, scene: &'a [EpisodeSpec]) -> BTreeMap<u32, &'a Target> {
    let goals = scene.iter().flat_map(|other| &other.goals);
    let all = goals.map(|goal| (goal.target.instance, &goal.target));
    let is_goal = |id: u32| episode.goals.iter().any(|goal| goal.target.instance == id);
    all.filter(|(id, _)| !is_goal(*id)).collect()
}

struct Draw<'a> {
    navmesh: &'a NavMesh,
    candidates: Vec<Candidate<'a>>,
    /// Success regions of the present sources, goals first.
    taken: Vec<SuccessRegion>,
    goals: usize,
    /// Least distance from the start, metres: that of the scene's goals.
    min_start_m: f64,
    /// Least walking distance between two sources, metres: that between two goals of a mission in the scene.
    min_separation_m: f64,
}

struct Candidate<'a> {
    target: &'a Target,
    region: SuccessRegion,
    /// Walking distance from the start, metres; infinite if unreachable.
    start_m: f64,
}

/// Success region, on the mesh.
struct SuccessRegion(Vec<NavPoint>);

impl SuccessRegion {
    fn new(navmesh: &NavMesh, places: &[Point3<f32>]) -> Self {
        Self(places.iter().filter_map(|place| navmesh.snap(place, SNAP_M)).collect())
    }

    fn field(&self, navmesh: &NavMesh) -> DistanceField {
        navmesh.field(&self.0.iter().map(|&point| (point, 0.0)).collect::<Vec<_>>())
    }

    /// Returns the shortest distance from the seeds of `field`, metres; infinite if unreachable.
    fn distance_m(&self, navmesh: &NavMesh, field: &DistanceField) -> f64 {
        self.0.iter().filter_map(|point| field.distance_m(navmesh, point)).fold(f64::INFINITY, f64::min)
    }

    /// Returns the straight-line distance to `other`, metres; infinite if a region is empty.
    fn line_m(&self, other: &Self) -> f64 {
        let to_other = self
            .0
            .iter()
            .flat_map(|a| other.0.iter().map(|b| f64::from((a.position() - b.position()).norm())));
        to_other.fold(f64::INFINITY, f64::min)
    }

    /// Returns the points within `most_m` of a point in `other`, in space.
    fn near(&self, other: &Self, most_m: f64) -> Self {
        let is_near = |point: &&NavPoint| {
            let away_m = |b: &NavPoint| f64::from((point.position() - b.position()).norm());
            other.0.iter().any(|b| away_m(b) < most_m)
        };
        Self(self.0.iter().filter(is_near).copied().collect())
    }
}

/// Returns true if the success regions of two targets are on the same storey.
fn is_same_storey(a: &Target, b: &Target) -> bool {
    match (a.region.first(), b.region.first()) {
        (Some(a), Some(b)) => (a.y - b.y).abs() <= SAME_STOREY_M,
        _ => true,
    }
}

/// Returns the least walking distance between two goals of a mission in `scene`, metres; infinite without missions.
fn min_separation_m(scene: &[EpisodeSpec], navmesh: &NavMesh) -> f64 {
    let goals = scene.iter().flat_map(|mission| &mission.goals);
    let regions: BTreeMap<u32, SuccessRegion> =
        goals.map(|goal| (goal.target.instance, SuccessRegion::new(navmesh, &goal.target.region))).collect();
    let mut distinct = BTreeSet::new();
    for mission in scene {
        for (index, a) in mission.goals.iter().enumerate() {
            let ids = mission.goals[index + 1..].iter().map(|b| [a.target.instance, b.target.instance]);
            distinct.extend(ids.map(|[a, b]| [a.min(b), a.max(b)]));
        }
    }
    let mut pairs: Vec<_> =
        distinct.iter().map(|[a, b]| (&regions[a], &regions[b])).map(|(a, b)| (a.line_m(b), a, b)).collect();
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut least_m = f64::INFINITY;
    for (line_m, a, b) in pairs {
        // No walk is shorter than the straight line.
        if line_m >= least_m {
            break;
        }
        least_m = least_m.min(a.distance_m(navmesh, &b.field(navmesh)));
    }
    least_m
}

impl<'a> Draw<'a> {
    fn new(
        episode: &EpisodeSpec,
        scene: &'a [EpisodeSpec],
        navmesh: &'a NavMesh,
        min_separation_m: f64,
    ) -> Self {
        let start: Vec<_> =
            navmesh.snap(&episode.start.position, SNAP_M).map(|point| (point, 0.0)).into_iter().collect();
        let from_start = navmesh.field(&start);
        let candidate = |target: &'a Target| {
            let region = SuccessRegion::new(navmesh, &target.region);
            let start_m = region.distance_m(navmesh, &from_start);
            Candidate { target, region, start_m }
        };
        let goals = scene.iter().flat_map(|other| &other.goals);
        Self {
            navmesh,
            candidates: candidates(episode, scene).into_values().map(candidate).collect(),
            taken: episode
                .goals
                .iter()
                .map(|goal| SuccessRegion::new(navmesh, &goal.target.region))
                .collect(),
            goals: episode.goals.len(),
            min_start_m: goals.map(|goal| goal.target.start_distance_m).fold(f64::INFINITY, f64::min),
            min_separation_m,
        }
    }

    /// Draws a source like a goal: on the same storey, with a close walking distance from the start; `None` without candidates.
    fn next(&mut self, goal: &Target, rng: &mut Rng) -> Option<DistractorSource> {
        let off_m = |candidate: &Candidate| {
            let other_m = if is_same_storey(candidate.target, goal) { 0.0 } else { OTHER_STOREY_M };
            (candidate.start_m - goal.start_distance_m).abs() + other_m
        };
        // A stable sort: candidates with equal distances stay in the order of their ids.
        self.candidates
            .sort_by(|a, b| off_m(a).total_cmp(&off_m(b)).then(a.target.instance.cmp(&b.target.instance)));
        let far = (0..self.candidates.len()).filter(|&index| self.is_far(&self.candidates[index]));
        let alike: Vec<usize> = far.take(ALIKE).collect();
        // Likeness comes first: in a crowded scene few candidates are apart from all sources, and always the same ones.
        let apart_from = |taken: &[SuccessRegion]| -> Vec<usize> {
            let is_apart = |index: &&usize| {
                let region = &self.candidates[**index].region;
                taken.iter().all(|other| self.is_apart(other, region))
            };
            alike.iter().filter(is_apart).copied().collect()
        };
        let choices = [apart_from(&self.taken), apart_from(&self.taken[self.goals..]), alike.clone()];
        let choices = choices.into_iter().find(|choices| !choices.is_empty()).unwrap_or_default();
        // A scene too small for the constraints still gets its number of sources.
        let index = rng.choose(&choices).copied().or((!self.candidates.is_empty()).then_some(0))?;
        let Candidate { target, region, .. } = self.candidates.remove(index);
        self.taken.push(region);
        Some(DistractorSource {
            instance: target.instance,
            category: target.category.clone(),
            source: target.source,
        })
    }

    /// Returns true if the candidate is as far from the start as goals are.
    fn is_far(&self, candidate: &Candidate) -> bool {
        candidate.start_m.is_finite() && candidate.start_m >= self.min_start_m
    }

    fn is_apart(&self, a: &SuccessRegion, b: &SuccessRegion) -> bool {
        // No walk is shorter than the straight line, so most pairs need no field.
        let near = b.near(a, self.min_separation_m);
        near.0.is_empty()
            || near.distance_m(self.navmesh, &a.near(&near, self.min_separation_m).field(self.navmesh))
                >= self.min_separation_m
    }
}
