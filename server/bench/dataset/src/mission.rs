use crate::{cue::CueSpec, reference::Tour, survey::Instance};
use avln_episode::{Mission, Modality, Order, Rules};
use avln_geom::{Point3, Pose, Rng};
use avln_truth::{EpisodeTruth, Target};
use avln_world::{NavPoint, SceneAssets};
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// How many missions to draw in a scene, and what makes one worth playing.
#[derive(Clone, Debug)]
pub struct MissionOptions {
    /// Missions to draw.
    pub episodes: usize,
    /// Goals of a mission, 2 to 4 in the paper.
    pub goals: RangeInclusive<usize>,
    /// Least walking distance from the start to a success region, metres.
    pub min_start_m: f64,
    /// Least walking distance between two success regions of a mission, metres.
    pub min_separation_m: f64,
    /// Seed of everything that is drawn.
    pub seed: u64,
}

impl MissionOptions {
    /// `episodes` missions of 2 to 4 goals, at least 2 m from the start and 1 m from each other.
    pub fn new(episodes: usize, seed: u64) -> Self {
        Self { episodes, goals: 2..=4, min_start_m: 2.0, min_separation_m: 1.0, seed }
    }
}

/// One episode of the data set: it can be played in both orders.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EpisodeSpec {
    /// Id inside the split.
    pub id: String,
    /// Name of the scene.
    pub scene: String,
    /// Seed of everything that is drawn while the episode runs.
    pub seed: u64,
    /// Where the body starts.
    pub start: Pose,
    /// The goals, in their order.
    pub goals: Vec<GoalSpec>,
    /// Shortest tour in the order of the goals.
    pub ordered: ReferenceTour,
    /// Shortest tour in any order.
    pub unordered: ReferenceTour,
}

/// One goal of an episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GoalSpec {
    /// What must be found.
    pub target: Target,
    /// How the agent is told.
    pub cue: CueSpec,
}

/// The shortest tour from the start through the success regions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReferenceTour {
    /// Its length, metres.
    pub length_m: f64,
    /// Its corners on the floor.
    pub path: Vec<Point3<f32>>,
}

impl EpisodeSpec {
    /// What the agent is told; pictures are rendered now.
    pub fn mission(&self, assets: &SceneAssets, rules: &Rules, order: Order) -> Mission {
        let goals = self.goals.iter().map(|goal| goal.cue.present(assets, rules, &goal.target)).collect();
        Mission { order, goals }
    }

    /// What the agent is not told.
    pub fn truth(&self, order: Order) -> EpisodeTruth {
        let tour = match order {
            Order::Ordered => &self.ordered,
            Order::Unordered => &self.unordered,
        };
        EpisodeTruth {
            episode: self.id.clone(),
            scene: self.scene.clone(),
            seed: self.seed,
            start: self.start,
            order,
            targets: self.goals.iter().map(|goal| goal.target.clone()).collect(),
            reference_m: tour.length_m,
            reference_path: tour.path.clone(),
        }
    }
}

/// Attempts for each mission before the scene is said to hold no more.
const ATTEMPTS: usize = 200;

/// Draws missions among the instances of one scene. Fewer than asked come back when the scene does not hold more.
///
/// Every mission has at least two modalities and no category twice; its targets are reachable, apart from each
/// other and from the start; instances that were used less are preferred.
pub fn sample_missions(
    assets: &SceneAssets,
    instances: &[Instance],
    options: &MissionOptions,
) -> Vec<EpisodeSpec> {
    let rng = Rng::new(options.seed);
    let mut uses = vec![0_u32; instances.len()];
    let mut episodes = Vec::new();
    for number in 0..options.episodes {
        let mut rng = rng.fork(&format!("mission {number}"));
        let drawn = (0..ATTEMPTS).find_map(|_| draw(assets, instances, options, &uses, &mut rng));
        let Some((chosen, mut episode)) = drawn else { break };
        chosen.iter().for_each(|&index| uses[index] += 1);
        episode.id = format!("{}-{number:04}", assets.scene.name);
        episodes.push(episode);
    }
    episodes
}

/// One attempt: draws a start, goals and cues, and checks them.
fn draw(
    assets: &SceneAssets,
    instances: &[Instance],
    options: &MissionOptions,
    uses: &[u32],
    rng: &mut Rng,
) -> Option<(Vec<usize>, EpisodeSpec)> {
    let navmesh = &assets.navmesh;
    let start = navmesh.sample(rng, navmesh.largest_island());
    let count = options.goals.start() + rng.below(options.goals.end() - options.goals.start() + 1);
    let regions = Regions { assets, start_field: navmesh.field(&[(start, 0.0)]) };
    let chosen = choose_targets(instances, options, uses, count, &regions, rng)?;
    let cues = choose_cues(instances, &chosen, rng)?;
    let points: Vec<_> = chosen.iter().map(|&index| regions.points(&instances[index])).collect();
    let tour = Tour::new(navmesh, start, &points);
    let reference = |(length_m, path)| ReferenceTour { length_m, path };
    let goal = |(&index, cue): (&usize, CueSpec)| {
        let start_distance_m = regions.start_distance_m(&instances[index])?;
        let target = Target { modality: cue.modality(), start_distance_m, ..instances[index].target.clone() };
        Some(GoalSpec { target, cue })
    };
    let turns = rng.below(12) as f32;
    let episode = EpisodeSpec {
        id: String::new(),
        scene: assets.scene.name.clone(),
        seed: rng.next_u64(),
        start: Pose::new(start.position(), turns * std::f32::consts::PI / 6.0),
        goals: chosen.iter().zip(cues).map(goal).collect::<Option<_>>()?,
        ordered: tour.ordered().map(reference)?,
        unordered: tour.unordered().map(reference)?,
    };
    Some((chosen, episode))
}

/// Success regions on the navmesh and how far they are from the start.
struct Regions<'a> {
    assets: &'a SceneAssets,
    start_field: avln_world::DistanceField,
}

impl Regions<'_> {
    fn points(&self, instance: &Instance) -> Vec<NavPoint> {
        let snap = |place| self.assets.navmesh.snap(place, 0.1);
        instance.target.region.iter().filter_map(snap).collect()
    }

    fn start_distance_m(&self, instance: &Instance) -> Option<f64> {
        self.nearest_m(&self.start_field, instance)
    }

    fn nearest_m(&self, field: &avln_world::DistanceField, instance: &Instance) -> Option<f64> {
        let points = self.points(instance);
        let distances = points.iter().filter_map(|point| field.distance_m(&self.assets.navmesh, point));
        distances.min_by(f64::total_cmp)
    }

    fn field_of(&self, instance: &Instance) -> avln_world::DistanceField {
        let seeds: Vec<_> = self.points(instance).into_iter().map(|point| (point, 0.0)).collect();
        self.assets.navmesh.field(&seeds)
    }
}

/// Picks `count` targets one after the other: a new category, far enough from the start and from those picked.
fn choose_targets(
    instances: &[Instance],
    options: &MissionOptions,
    uses: &[u32],
    count: usize,
    regions: &Regions,
    rng: &mut Rng,
) -> Option<Vec<usize>> {
    let mut candidates: Vec<usize> = (0..instances.len()).collect();
    rng.shuffle(&mut candidates);
    candidates.sort_by_key(|&index| uses[index]);
    let mut chosen: Vec<usize> = Vec::new();
    let mut fields = Vec::new();
    for index in candidates {
        let instance = &instances[index];
        let new_category =
            chosen.iter().all(|&other| instances[other].target.category != instance.target.category);
        let far =
            |distance_m: Option<f64>, least_m| distance_m.is_some_and(|distance_m| distance_m >= least_m);
        let apart = |field| far(regions.nearest_m(field, instance), options.min_separation_m);
        if new_category
            && far(regions.start_distance_m(instance), options.min_start_m)
            && fields.iter().all(apart)
        {
            fields.push(regions.field_of(instance));
            chosen.push(index);
        }
        if chosen.len() == count {
            rng.shuffle(&mut chosen);
            return Some(chosen);
        }
    }
    None
}

/// Gives each target a cue so that the mission has at least two modalities.
fn choose_cues(instances: &[Instance], chosen: &[usize], rng: &mut Rng) -> Option<Vec<CueSpec>> {
    let cues: Vec<_> = chosen.iter().map(|&index| choose_cue(&instances[index], rng)).collect();
    let mut modalities: Vec<Modality> = cues.iter().map(CueSpec::modality).collect();
    modalities.sort_unstable();
    modalities.dedup();
    (modalities.len() >= 2).then_some(cues)
}

fn choose_cue(instance: &Instance, rng: &mut Rng) -> CueSpec {
    let mut cues = vec![CueSpec::Category];
    cues.extend(instance.images.first().copied().map(CueSpec::Image));
    cues.extend(instance.sentences.first().cloned().map(CueSpec::Description));
    cues.swap_remove(rng.below(cues.len()))
}
