//! Random missions: targets, modalities and starts. Less used instances and modalities come first.

use crate::{
    cue::CueSpec,
    mission::{EpisodeSpec, GoalSpec, MissionOptions, ReferenceTour, StepGoal},
    reference::{Atlas, Departure, Tour, ordered, reference_steps, unordered},
    survey::Instance,
};
use avln_episode::{Modality, Rules};
use avln_geom::{Pose, Rng};
use avln_truth::Target;
use avln_world::{NavPoint, SceneAssets};

/// Attempts at a start, and as many at a mission, before the scene is said to hold no more.
const ATTEMPTS: usize = 40;
/// A draw this near to the wanted number of steps is taken at once, as a share of it.
const NEAR_ENOUGH: f64 = 0.04;
/// How far from the mesh a sampled place of a region may lie, metres.
const SNAP_M: f32 = 0.1;

/// How far chance may move an instance in the order of use, uses.
const CHANCE_USES: f64 = 2.0;
/// How much more an instance's own use of a modality counts than that of the whole scene.
const OWN_WEIGHT: f64 = 4.0;
/// How far chance may move a choice of modalities.
const CHANCE_MODALITY: f64 = 3.0;
/// The modalities in the order in which they are counted.
const MODALITIES: [Modality; 3] = [Modality::Category, Modality::Description, Modality::Image];

/// Draws missions among the instances of one scene. Fewer than asked come back when the scene does not hold more.
///
/// Every mission has at least two modalities and no category twice; its targets are reachable, apart from each
/// other and from the start; instances and modalities that were used less are preferred. Ids are the scene's name and
/// the mission's number.
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
            let mut episode = sampler.mission(&mut rng.fork(&format!("mission {number}")))?;
            episode.id = format!("{}-{number:04}", assets.scene.name);
            Some(episode)
        })
        .collect()
}

/// What the missions of one scene are drawn from.
struct Sampler<'a> {
    assets: &'a SceneAssets,
    rules: &'a Rules,
    options: &'a MissionOptions,
    atlas: Atlas<'a>,
    pool: CandidatePool<'a>,
}

/// Start and targets of a mission, with the tour in their order.
struct Draft {
    start: Pose,
    departure: Departure,
    chosen: Vec<usize>,
    tour: Tour,
    steps: u32,
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
        Self { assets, rules, options, atlas, pool: CandidatePool::new(instances) }
    }

    /// The next mission; `None` when none was found.
    fn mission(&mut self, rng: &mut Rng) -> Option<EpisodeSpec> {
        (0..ATTEMPTS).find_map(|_| self.try_mission(rng))
    }

    /// One mission, unless there are no targets that fit or their cues are all of one kind.
    fn try_mission(&mut self, rng: &mut Rng) -> Option<EpisodeSpec> {
        let goals = &self.options.goals;
        let count = goals.start() + rng.below(goals.end() - goals.start() + 1);
        let draft = match &self.options.steps {
            None => self.attempts(count, rng).next(),
            Some(steps) => self.draw_near(steps, count, rng),
        };
        let draft = draft.or_else(|| goals.clone().find_map(|count| self.attempts(count, rng).next()))?;
        let modalities = self.pool.modalities(&draft.chosen, rng)?;
        let episode = self.finish(&draft, &modalities, rng)?;
        self.pool.note(&draft.chosen, &modalities);
        Some(episode)
    }

    /// Of some drafts the one whose steps are nearest to a wanted number.
    fn draw_near(&self, steps: &StepGoal, count: usize, rng: &mut Rng) -> Option<Draft> {
        let goals = &self.options.goals;
        let middle = 0.5 * (goals.start() + goals.end()) as f64;
        let share = 1.0 + steps.spread * (2.0 * rng.unit() - 1.0);
        let wanted = steps.mean * share * count as f64 / middle;
        let off = |draft: &Draft| (f64::from(draft.steps) - wanted).abs();
        let mut best: Option<Draft> = None;
        for draft in self.attempts(count, rng).take(steps.draws.max(1) as usize) {
            if best.as_ref().is_none_or(|best| off(&draft) < off(best)) {
                best = Some(draft);
            }
            if best.as_ref().is_some_and(|best| off(best) < NEAR_ENOUGH * wanted) {
                break;
            }
        }
        best
    }

    /// Drafts of `count` goals, as far as attempts lead to some.
    fn attempts(&self, count: usize, rng: &mut Rng) -> impl Iterator<Item = Draft> {
        (0..ATTEMPTS).filter_map(move |_| self.attempt(count, rng))
    }

    fn attempt(&self, count: usize, rng: &mut Rng) -> Option<Draft> {
        let navmesh = &self.assets.navmesh;
        let point = navmesh.sample(rng, navmesh.largest_island());
        let turns = rng.below(360 / self.rules.turn_deg.max(1) as usize) as f32;
        let start = Pose::new(point.position(), (turns * self.rules.turn_deg as f32).to_radians());
        let departure = self.atlas.departure(&point);
        let chosen = self.pool.targets(&self.atlas, &departure, self.options, count, rng)?;
        let tour = ordered(&self.atlas, &departure, &chosen)?;
        let steps = self.steps(&start, &tour, count);
        Some(Draft { start, departure, chosen, tour, steps })
    }

    fn steps(&self, start: &Pose, tour: &Tour, goals: usize) -> u32 {
        reference_steps(self.rules, start, &tour.path, tour.length_m, goals)
    }

    fn finish(&self, draft: &Draft, modalities: &[Modality], rng: &mut Rng) -> Option<EpisodeSpec> {
        let Draft { start, departure, chosen, tour, steps } = draft;
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

/// Instances that may be targets, with what has been asked of them so far.
struct CandidatePool<'a> {
    instances: Vec<&'a Instance>,
    uses: Vec<u32>,
    /// How often each instance was asked for in each modality.
    asked: Vec<[u32; 3]>,
}

impl<'a> CandidatePool<'a> {
    fn new(instances: Vec<&'a Instance>) -> Self {
        let count = instances.len();
        Self { instances, uses: vec![0; count], asked: vec![[0; 3]; count] }
    }

    /// Notes that a mission asks for `chosen` in `modalities`.
    fn note(&mut self, chosen: &[usize], modalities: &[Modality]) {
        for (&index, modality) in chosen.iter().zip(modalities) {
            self.uses[index] += 1;
            self.asked[index][place(*modality)] += 1;
        }
    }

    /// Picks `count` targets one after the other: a new category, far enough from the start and from those picked.
    fn targets(
        &self,
        atlas: &Atlas,
        start: &Departure,
        options: &MissionOptions,
        count: usize,
        rng: &mut Rng,
    ) -> Option<Vec<usize>> {
        let uses = self.uses.iter().map(|&uses| f64::from(uses) + CHANCE_USES * rng.unit());
        let mut candidates: Vec<(f64, usize)> = uses.zip(0..).collect();
        candidates.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let category = |index: usize| self.instances[index].target.category.as_str();
        let mut chosen: Vec<usize> = Vec::with_capacity(count);
        for (_, index) in candidates {
            let new_category = chosen.iter().all(|&other| category(other) != category(index));
            let apart = |&other: &usize| within(atlas.apart_m(other, index), options.min_separation_m);
            if new_category
                && chosen.iter().all(apart)
                && within(atlas.start_m(start, index), options.min_start_m)
            {
                chosen.push(index);
            }
            if chosen.len() == count {
                rng.shuffle(&mut chosen);
                return Some(chosen);
            }
        }
        None
    }

    /// Gives each target a modality: at least two different ones, the less used ones first.
    fn modalities(&self, chosen: &[usize], rng: &mut Rng) -> Option<Vec<Modality>> {
        let totals =
            self.asked.iter().fold([0_u32; 3], |sum, asked| std::array::from_fn(|m| sum[m] + asked[m]));
        let least = totals.iter().copied().min().unwrap_or(0);
        let mut best: Option<(f64, Vec<Modality>)> = None;
        for choice in choices(chosen.iter().map(|&index| available(self.instances[index])).collect()) {
            if choice.iter().all(|modality| *modality == choice[0]) {
                continue;
            }
            let weight = |(&index, &modality): (&usize, &Modality)| {
                let own = self.asked[index][place(modality)];
                f64::from(totals[place(modality)] - least) + OWN_WEIGHT * f64::from(own)
            };
            let cost = chosen.iter().zip(&choice).map(weight).sum::<f64>() + CHANCE_MODALITY * rng.unit();
            if best.as_ref().is_none_or(|best| cost < best.0) {
                best = Some((cost, choice));
            }
        }
        best.map(|best| best.1)
    }

    /// The cue of `modality` for an instance: one of its sentences or pictures.
    fn cue(&self, index: usize, modality: Modality, rng: &mut Rng) -> Option<CueSpec> {
        let instance = self.instances[index];
        match modality {
            Modality::Category => Some(CueSpec::Category),
            Modality::Description => rng.choose(&instance.sentences).cloned().map(CueSpec::Description),
            Modality::Image => rng.choose(&instance.images).copied().map(CueSpec::Image),
        }
    }
}

/// Whether there is a way, and it is long enough.
fn within(distance_m: f64, least_m: f64) -> bool {
    distance_m.is_finite() && distance_m >= least_m
}

fn place(modality: Modality) -> usize {
    match modality {
        Modality::Category => 0,
        Modality::Description => 1,
        Modality::Image => 2,
    }
}

fn available(instance: &Instance) -> Vec<Modality> {
    let can = |modality: &Modality| match modality {
        Modality::Category => true,
        Modality::Description => !instance.sentences.is_empty(),
        Modality::Image => !instance.images.is_empty(),
    };
    MODALITIES.into_iter().filter(can).collect()
}

/// All ways to take one of each list.
fn choices(lists: Vec<Vec<Modality>>) -> Vec<Vec<Modality>> {
    lists.into_iter().fold(vec![Vec::new()], |begun, list| {
        let longer = |begin: &Vec<Modality>| {
            let begin = begin.clone();
            list.iter().map(move |&modality| [begin.as_slice(), &[modality]].concat()).collect::<Vec<_>>()
        };
        begun.iter().flat_map(longer).collect()
    })
}
