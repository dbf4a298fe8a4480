use super::{EpisodeSpec, GoalSpec, MissionOptions, ReferenceTour, StepGoal, choose::Pool};
use crate::{
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
    pool: Pool<'a>,
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
        Self { assets, rules, options, atlas, pool: Pool::new(instances) }
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
