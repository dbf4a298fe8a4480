//! Missions: data, constraints, and random draws. Less used instances and modalities come first.

use crate::{
    cue::CueSpec,
    reference::{Atlas, Departure, Tour, ordered, reference_steps, unordered},
    survey::Instance,
};
use avln_episode::{Mission, Modality, Order, Rules};
use avln_geom::{Point3, Pose, Rng};
use avln_truth::{EpisodeTruth, Target};
use avln_world::{NavPoint, SceneAssets};
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// Episode in a data set, playable in both orders.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EpisodeSpec {
    /// Id inside the split.
    pub id: String,
    /// Name of the scene.
    pub scene: String,
    /// Seed for random draws at run time.
    pub seed: u64,
    /// Start pose.
    pub start: Pose,
    /// Goals in order.
    pub goals: Vec<GoalSpec>,
    /// Shortest tour in goal order.
    pub ordered: ReferenceTour,
    /// Shortest tour in any order.
    pub unordered: ReferenceTour,
}

/// Goal in an episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GoalSpec {
    /// Target.
    pub target: Target,
    /// Cue.
    pub cue: CueSpec,
    /// Other instances in the same category, at most 255.
    #[serde(default)]
    pub distractors: u8,
}

/// Shortest tour from the start through all success regions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReferenceTour {
    /// Length, metres.
    pub length_m: f64,
    /// Actions: moves, turns and a claim per goal. Turns connect the headings closest to the legs.
    #[serde(default)]
    pub steps: u32,
    /// Corners on the floor.
    pub path: Vec<Point3<f32>>,
}

impl EpisodeSpec {
    /// Returns the mission for the agent; renders the pictures.
    pub fn mission(&self, assets: &SceneAssets, rules: &Rules, order: Order) -> Mission {
        let goals = self.goals.iter().map(|goal| goal.cue.present(assets, rules, &goal.target)).collect();
        Mission { order, goals }
    }

    /// Returns the hidden truth, without distractor sources.
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
            distractor_sources: Vec::new(),
            reference_m: tour.length_m,
            reference_path: tour.path.clone(),
        }
    }
}

/// Count and constraints for drawn missions.
#[derive(Clone, Debug, PartialEq)]
pub struct MissionOptions {
    /// Mission count.
    pub episodes: usize,
    /// Goal count, 2 to 4 in the paper, uniform.
    pub goals: RangeInclusive<usize>,
    /// Least walking distance from the start to a success region, metres.
    pub min_start_m: f64,
    /// Least walking distance between two success regions of a mission, metres.
    pub min_separation_m: f64,
    /// Distractor count in the scene.
    pub distractors: RangeInclusive<u8>,
    /// Wanted length; unconstrained if `None`.
    pub steps: Option<StepGoal>,
    /// Random seed.
    pub seed: u64,
}

/// Wanted reference steps in ordered missions: the closest of several draws wins. The wanted count is `mean` for the
/// middle goal count, proportional for others, and uniform within `spread`. Missing steps of earlier missions in the
/// scene are added, within limits.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StepGoal {
    /// Mean over all missions, actions.
    pub mean: f64,
    /// Half the distribution width relative to the mean, 0 to 1.
    pub spread: f64,
    /// Draws per mission, at least 1.
    pub draws: u32,
}

impl MissionOptions {
    /// Returns options for 2 to 4 goals, at least 2 m from the start and 1 m apart.
    pub fn new(episodes: usize, seed: u64) -> Self {
        Self {
            episodes,
            goals: 2..=4,
            min_start_m: 2.0,
            min_separation_m: 1.0,
            distractors: 0..=u8::MAX,
            steps: None,
            seed,
        }
    }
}

/// Attempts per start and per mission before giving up.
const ATTEMPTS: usize = 40;
/// Relative step deviation for immediate acceptance.
const NEAR_ENOUGH: f64 = 0.04;
/// Largest correction of the wanted steps by earlier missions, relative.
const MOST_CORRECTION: f64 = 0.5;
/// Largest distance from a sampled point to the mesh, metres.
const SNAP_M: f32 = 0.1;
/// Random shift in the use order, uses.
const CHANCE_USES: f64 = 2.0;
/// Weight for an instance's own modality count against the scene total.
const OWN_WEIGHT: f64 = 4.0;
/// Random shift in the modality choice.
const CHANCE_MODALITY: f64 = 3.0;
const MODALITIES: [Modality; 3] = [Modality::Category, Modality::Description, Modality::Image];

/// Draws missions in a scene; fewer than requested if the scene has no more.
///
/// Every mission has at least two modalities and distinct categories. Targets are reachable, and apart from the start
/// and from each other. Rarely used instances and modalities come first. Ids are `SCENE-NUMBER`.
#[tracing::instrument(level = "debug", name = "missions", skip_all, fields(scene = assets.scene.name))]
pub fn sample_missions(
    assets: &SceneAssets,
    instances: &[Instance],
    rules: &Rules,
    options: &MissionOptions,
) -> Vec<EpisodeSpec> {
    let mut sampler = Sampler::new(assets, instances, rules, options);
    let rng = Rng::new(options.seed).fork("missions");
    (0..options.episodes)
        .map_while(|number| {
            // A generator per mission: a longer list with the same seed begins with the same missions.
            let mut rng = rng.fork(&format!("mission {number}"));
            let mut episode = (0..ATTEMPTS).find_map(|_| sampler.mission(&mut rng))?;
            episode.id = format!("{}-{number:04}", assets.scene.name);
            Some(episode)
        })
        .collect()
}

struct Sampler<'a> {
    assets: &'a SceneAssets,
    rules: &'a Rules,
    options: &'a MissionOptions,
    atlas: Atlas<'a>,
    pool: CandidatePool<'a>,
    /// Wanted minus drawn steps over all missions with wanted steps.
    missing_steps: f64,
}

struct Draft {
    start: Pose,
    departure: Departure,
    chosen: Vec<usize>,
    tour: Tour,
    steps: u32,
    wanted_steps: Option<f64>,
}

impl<'a> Sampler<'a> {
    fn new(
        assets: &'a SceneAssets,
        instances: &'a [Instance],
        rules: &'a Rules,
        options: &'a MissionOptions,
    ) -> Self {
        let fits = |instance: &&Instance| options.distractors.contains(&instance.distractors);
        let instances: Vec<_> = instances.iter().filter(fits).collect();
        let points = |instance: &&Instance| -> Vec<NavPoint> {
            let snap = |place| assets.navmesh.snap(place, SNAP_M);
            instance.target.region.iter().filter_map(snap).collect()
        };
        let regions: Vec<_> = instances.iter().map(points).collect();
        let atlas = Atlas::new(&assets.navmesh, &regions, options.min_separation_m);
        let count = instances.len();
        let pool = CandidatePool { instances, uses: vec![0; count], asked: vec![[0; 3]; count] };
        Self { assets, rules, options, atlas, pool, missing_steps: 0.0 }
    }

    /// Draws a mission; `None` without matching targets, or if several goals have a single modality.
    fn mission(&mut self, rng: &mut Rng) -> Option<EpisodeSpec> {
        let goals = &self.options.goals;
        let count = goals.start() + rng.below(goals.end() - goals.start() + 1);
        let draft = match &self.options.steps {
            None => self.attempts(count, rng).next(),
            Some(steps) => self.draw_near(steps, count, rng),
        };
        // A small house may not fit the drawn goal count. Any allowed count is better than a scene without missions.
        let draft = draft.or_else(|| goals.clone().find_map(|count| self.attempts(count, rng).next()))?;
        let modalities = self.pool.modalities(&draft.chosen, rng)?;
        let episode = self.finish(&draft, &modalities, rng)?;
        self.pool.note(&draft.chosen, &modalities);
        self.missing_steps += draft.wanted_steps.map_or(0.0, |wanted| wanted - f64::from(draft.steps));
        Some(episode)
    }

    /// Returns the draft closest to the wanted step count.
    fn draw_near(&self, steps: &StepGoal, count: usize, rng: &mut Rng) -> Option<Draft> {
        let goals = &self.options.goals;
        let middle = 0.5 * (goals.start() + goals.end()) as f64;
        let share = 1.0 + steps.spread * (2.0 * rng.unit() - 1.0);
        // More goals need longer tours: without the proportion, missions with few goals would rarely match.
        let wanted = steps.mean * share * count as f64 / middle;
        // Most houses have fewer long tours than short ones: without the correction, the mean would be too low.
        let limit = MOST_CORRECTION * wanted;
        let aim = wanted + self.missing_steps.clamp(-limit, limit);
        let off = |draft: &Draft| (f64::from(draft.steps) - aim).abs();
        let mut best: Option<Draft> = None;
        for draft in self.attempts(count, rng).take(steps.draws.max(1) as usize) {
            if best.as_ref().is_none_or(|best| off(&draft) < off(best)) {
                best = Some(draft);
            }
            // Later draws would only cost time: the spread of the wanted counts is much wider than this tolerance.
            if best.as_ref().is_some_and(|best| off(best) < NEAR_ENOUGH * aim) {
                break;
            }
        }
        best.map(|draft| Draft { wanted_steps: Some(wanted), ..draft })
    }

    fn attempts(&self, count: usize, rng: &mut Rng) -> impl Iterator<Item = Draft> {
        (0..ATTEMPTS).filter_map(move |_| self.attempt(count, rng))
    }

    fn attempt(&self, count: usize, rng: &mut Rng) -> Option<Draft> {
        let navmesh = &self.assets.navmesh;
        let point = navmesh.sample(rng, navmesh.largest_island());
        // Headings are multiples of a turn, so that reference steps count whole turns.
        let turns = rng.below(360 / self.rules.turn_deg.max(1) as usize) as f32;
        let start = Pose::new(point.position(), (turns * self.rules.turn_deg as f32).to_radians());
        let departure = self.atlas.departure(&point);
        let chosen = self.pool.targets(&self.atlas, &departure, self.options, count, rng)?;
        let tour = ordered(&self.atlas, &departure, &chosen)?;
        let steps = self.steps(&start, &tour, count);
        Some(Draft { start, departure, chosen, tour, steps, wanted_steps: None })
    }

    fn steps(&self, start: &Pose, tour: &Tour, goals: usize) -> u32 {
        reference_steps(self.rules, start, &tour.path, tour.length_m, goals)
    }

    fn finish(&self, draft: &Draft, modalities: &[Modality], rng: &mut Rng) -> Option<EpisodeSpec> {
        let Draft { start, departure, chosen, tour, steps, .. } = draft;
        let goal = |(&index, &modality): (&usize, &Modality)| {
            let instance = self.pool.instances[index];
            let start_distance_m = self.atlas.start_m(departure, index);
            let target = Target { modality, start_distance_m, ..instance.target.clone() };
            let cue = self.pool.cue(index, modality, rng)?;
            Some(GoalSpec { target, cue, distractors: instance.distractors })
        };
        let goals = chosen.iter().zip(modalities).map(goal).collect::<Option<_>>()?;
        let free = unordered(&self.atlas, departure, chosen)?;
        let free_steps = self.steps(start, &free, chosen.len());
        Some(EpisodeSpec {
            id: String::new(),
            scene: self.assets.scene.name.clone(),
            seed: rng.next_u64(),
            start: *start,
            goals,
            ordered: reference(tour.clone(), *steps),
            unordered: reference(free, free_steps),
        })
    }
}

fn reference(tour: Tour, steps: u32) -> ReferenceTour {
    ReferenceTour { length_m: tour.length_m, steps, path: tour.path }
}

/// Returns the reference tours of an imported mission, ordered and unordered; `None` if no path leads through all goals.
pub fn reference_tours(
    assets: &SceneAssets,
    rules: &Rules,
    pose: &Pose,
    start: NavPoint,
    goals: &[GoalSpec],
) -> Option<[ReferenceTour; 2]> {
    let snap = |place| assets.navmesh.snap(place, SNAP_M);
    let regions: Vec<Vec<NavPoint>> =
        goals.iter().map(|goal| goal.target.region.iter().filter_map(snap).collect()).collect();
    let atlas = Atlas::new(&assets.navmesh, &regions, 0.0);
    let departure = atlas.departure(&start);
    let all: Vec<usize> = (0..goals.len()).collect();
    let with_steps = |tour: Tour| {
        let steps = reference_steps(rules, pose, &tour.path, tour.length_m, goals.len());
        reference(tour, steps)
    };
    let ordered = ordered(&atlas, &departure, &all).map(with_steps)?;
    let unordered = unordered(&atlas, &departure, &all).map(with_steps)?;
    Some([ordered, unordered])
}

struct CandidatePool<'a> {
    instances: Vec<&'a Instance>,
    uses: Vec<u32>,
    /// Uses per instance and modality.
    asked: Vec<[u32; 3]>,
}

impl CandidatePool<'_> {
    fn note(&mut self, chosen: &[usize], modalities: &[Modality]) {
        for (&index, modality) in chosen.iter().zip(modalities) {
            self.uses[index] += 1;
            self.asked[index][*modality as usize] += 1;
        }
    }

    /// Chooses `count` targets with distinct categories, apart from the start and other targets.
    fn targets(
        &self,
        atlas: &Atlas,
        start: &Departure,
        options: &MissionOptions,
        count: usize,
        rng: &mut Rng,
    ) -> Option<Vec<usize>> {
        // Strict order by use would pair the same instances in every mission; the random shift mixes them.
        let uses = self.uses.iter().map(|&uses| f64::from(uses) + CHANCE_USES * rng.unit());
        let mut candidates: Vec<(f64, usize)> = uses.zip(0..).collect();
        candidates.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let category = |index: usize| self.instances[index].target.category.as_str();
        let mut chosen: Vec<usize> = Vec::with_capacity(count);
        for (_, index) in candidates {
            let new_category = chosen.iter().all(|&other| category(other) != category(index));
            let apart = |&other: &usize| within(atlas.apart_m(other, index), options.min_separation_m);
            let far = || within(atlas.start_m(start, index), options.min_start_m);
            if new_category && chosen.iter().all(apart) && far() {
                chosen.push(index);
            }
            if chosen.len() == count {
                // Choice order follows use; goal order must not.
                rng.shuffle(&mut chosen);
                return Some(chosen);
            }
        }
        None
    }

    /// Assigns modalities: at least two to several goals, rarely used ones first.
    fn modalities(&self, chosen: &[usize], rng: &mut Rng) -> Option<Vec<Modality>> {
        let totals =
            self.asked.iter().fold([0_u32; 3], |sum, asked| std::array::from_fn(|m| sum[m] + asked[m]));
        let least = totals.iter().copied().min().unwrap_or(0);
        let mut best: Option<(f64, Vec<Modality>)> = None;
        for choice in choices(chosen.iter().map(|&index| available(self.instances[index])).collect()) {
            // The paper requires at least two modalities per mission, which has several goals.
            if choice.len() > 1 && choice.iter().all(|modality| *modality == choice[0]) {
                continue;
            }
            let weight = |(&index, &modality): (&usize, &Modality)| {
                let own = self.asked[index][modality as usize];
                f64::from(totals[modality as usize] - least) + OWN_WEIGHT * f64::from(own)
            };
            let cost = chosen.iter().zip(&choice).map(weight).sum::<f64>() + CHANCE_MODALITY * rng.unit();
            if best.as_ref().is_none_or(|best| cost < best.0) {
                best = Some((cost, choice));
            }
        }
        best.map(|best| best.1)
    }

    fn cue(&self, index: usize, modality: Modality, rng: &mut Rng) -> Option<CueSpec> {
        let instance = self.instances[index];
        match modality {
            Modality::Category => Some(CueSpec::Category),
            Modality::Description => rng.choose(&instance.sentences).cloned().map(CueSpec::Description),
            Modality::Image => rng.choose(&instance.images).copied().map(CueSpec::Image),
        }
    }
}

/// True if the distance is finite and long enough.
fn within(distance_m: f64, least_m: f64) -> bool {
    distance_m.is_finite() && distance_m >= least_m
}

fn available(instance: &Instance) -> Vec<Modality> {
    let can = |modality: &Modality| match modality {
        Modality::Category => true,
        Modality::Description => !instance.sentences.is_empty(),
        Modality::Image => !instance.images.is_empty(),
    };
    MODALITIES.into_iter().filter(can).collect()
}

/// All combinations with an entry per list.
fn choices(lists: Vec<Vec<Modality>>) -> Vec<Vec<Modality>> {
    lists.into_iter().fold(vec![Vec::new()], |begun, list| {
        let longer = |begin: &Vec<Modality>| {
            let begin = begin.clone();
            list.iter().map(move |&modality| [begin.as_slice(), &[modality]].concat()).collect::<Vec<_>>()
        };
        begun.iter().flat_map(longer).collect()
    })
}
