//! Agents that ignore goals: random, forward-and-turn, frontier, and a sound follower.

use avln_client::{
    Action, Agent, Feedback, FeedbackRule, Mission, Observation, Order, Pose, SilenceRule, TaskSpec,
};
use avln_kit::explorer::Explorer;
use avln_kit::geometry::FloorPoint;
use avln_kit::hearing::{Ear, HeardSound, SoundSchedule};
use avln_kit::map::{SoundField, SourceBelief, SourceEstimate, range_m};
use avln_kit::outcome::SubmitOutcome;

/// A step forward below this share was blocked.
const BLOCKED: f32 = 0.5;
/// Probability of a random Submit per step.
const SUBMIT: f64 = 0.01;
/// Probability of starting a random turn per step.
const TURN: f64 = 0.12;
/// Longest random turn in actions: a half turn at 30 degrees.
const MAX_TURNS: u32 = 6;

/// The last action, and the pose before it.
type LastAction = Option<(Action, Pose)>;

/// An agent that walks ahead and turns right at obstacles, by pose only. Submits after equal step shares.
#[derive(Clone, Debug, Default)]
pub struct ForwardAndTurn {
    forward_m: f32,
    submits: SubmitSchedule,
    last: LastAction,
}

impl Agent for ForwardAndTurn {
    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        let submits = SubmitSchedule::new(mission.goals.len(), task.max_steps);
        *self = Self { forward_m: task.forward_m, submits, last: None };
    }

    fn act(&mut self, observation: &Observation) -> Action {
        let is_blocked = is_blocked(&self.last, &observation.pose, self.forward_m);
        let onward = if is_blocked { Action::TurnRight } else { Action::MoveForward };
        let action = self.submits.due(observation).unwrap_or(onward);
        self.last = Some((action, observation.pose));
        action
    }
}

/// An agent that walks to the nearest frontier (Yamauchi 1997). Submits after equal step shares.
#[derive(Default)]
pub struct Frontier {
    explorer: Option<Explorer>,
    submits: SubmitSchedule,
}

impl Agent for Frontier {
    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        let submits = SubmitSchedule::new(mission.goals.len(), task.max_steps);
        *self = Self { explorer: Some(Explorer::new(task)), submits };
    }

    fn act(&mut self, observation: &Observation) -> Action {
        let Some(explorer) = &mut self.explorer else { return Action::Stop };
        explorer.observe(observation);
        let action = self.submits.due(observation).unwrap_or_else(|| explorer.explore());
        explorer.record(action);
        action
    }
}

/// An agent that walks at random, by pose only: straight ahead, random turns, rare Submits, a final Stop.
#[derive(Clone, Debug)]
pub struct RandomAgent {
    rng: Rng,
    forward_m: f32,
    last: LastAction,
    /// Direction and remaining actions of the current turn.
    turning: Option<(Action, u32)>,
}

impl RandomAgent {
    /// Creates an agent: equal seeds and observations give equal actions.
    pub fn new(seed: u64) -> Self {
        Self { rng: Rng::new(seed), forward_m: 0.0, last: None, turning: None }
    }

    fn choose(&mut self, observation: &Observation) -> Action {
        if observation.remaining_steps <= 1 {
            return Action::Stop;
        }
        if let Some(turn) = self.continue_turn() {
            return turn;
        }
        if observation.remaining_submits > 0 && self.rng.unit() < SUBMIT {
            return Action::Submit;
        }
        let is_blocked = is_blocked(&self.last, &observation.pose, self.forward_m);
        if is_blocked || self.rng.unit() < TURN { self.begin_turn() } else { Action::MoveForward }
    }

    fn continue_turn(&mut self) -> Option<Action> {
        let (side, left) = self.turning.take()?;
        self.turning = (left > 1).then_some((side, left - 1));
        Some(side)
    }

    fn begin_turn(&mut self) -> Action {
        let side = if self.rng.unit() < 0.5 { Action::TurnLeft } else { Action::TurnRight };
        let turns = self.rng.between(1, MAX_TURNS);
        self.turning = (turns > 1).then_some((side, turns - 1));
        side
    }
}

impl Agent for RandomAgent {
    fn begin(&mut self, task: &TaskSpec, _mission: &Mission) {
        // The generator continues: episodes of one run differ.
        self.forward_m = task.forward_m;
        self.last = None;
        self.turning = None;
    }

    fn act(&mut self, observation: &Observation) -> Action {
        let action = self.choose(observation);
        self.last = Some((action, observation.pose));
        action
    }
}

/// Returns true if the last action was a step forward that hit an obstacle.
fn is_blocked(last: &LastAction, pose: &Pose, forward_m: f32) -> bool {
    let Some((Action::MoveForward, before)) = last else { return false };
    let [dx, dz] = [0, 2].map(|axis| f64::from(pose.position()[axis] - before.position()[axis]));
    // Not libm::hypotf, which changes two episodes of the published calibration: the root in f64 has the published
    // bits on every platform (docs/decisions/0019).
    let moved_m = (dx * dx + dz * dz).sqrt() as f32;
    moved_m < BLOCKED * forward_m
}

/// A Submit schedule without goal knowledge: after equal step shares, and Stop as the last step.
#[derive(Clone, Copy, Debug, Default)]
struct SubmitSchedule {
    share_steps: u32,
    submits: u32,
}

impl SubmitSchedule {
    fn new(goals: usize, max_steps: u32) -> Self {
        let goals = u32::try_from(goals).unwrap_or(u32::MAX).max(1);
        Self { share_steps: (max_steps / goals).max(1), submits: 0 }
    }

    /// Returns the Submit or Stop that is due at this observation.
    fn due(&mut self, observation: &Observation) -> Option<Action> {
        if observation.remaining_steps <= 1 {
            return Some(Action::Stop);
        }
        let next_step = (self.submits + 1) * self.share_steps;
        let is_due = observation.step + 1 >= next_step && observation.remaining_submits > 0;
        self.submits += u32::from(is_due);
        is_due.then_some(Action::Submit)
    }
}

/// The SplitMix64 generator (Steele, Lea and Flood 2014): equal seeds give equal numbers on every platform.
#[derive(Clone, Debug)]
struct Rng(u64);

impl Rng {
    fn new(seed: u64) -> Self {
        Self(seed)
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Returns a number uniform in [0, 1).
    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Returns an integer uniform in `low..=high`.
    fn between(&mut self, low: u32, high: u32) -> u32 {
        low + (self.unit() * f64::from(high - low + 1)) as u32
    }
}

/// Radius around the start in which sources are sought, metres.
const AROUND_M: f32 = 12.0;
/// Largest distance, metres, and least certainty of a source at a Submit.
const NEAR_M: f32 = 1.2;
const CERTAIN: f32 = 0.5;
/// A Submit requires the free-field level at this distance, metres: rooms add to the level.
const LOUD_M: f32 = 0.8;
/// Distance to the estimated source at which a path ends, metres.
const REACH_M: f32 = 0.4;
/// Sound steps over which the level is averaged before a Submit.
const RECENT: usize = 3;
/// Level share after a Submit below which the source counts as silent: the target was found.
const FOUND_LEVEL: f32 = 0.5;
/// Unsuccessful Submits at a source before another is preferred.
const MOST_WRONG: u32 = 2;

/// An agent that walks to sounds and submits there, targets or distractors; the last claim is a Stop. Its map contains only obstacles that blocked it.
///
/// Follows SAVi (Chen, Al-Halah and Grauman 2021): a belief about each source persists through silence.
/// Differences: nothing is learned, there are no images, the clip does not reveal the category, and goals are
/// ignored, also in ordered missions.
#[derive(Default)]
pub struct SoundFollower {
    ear: Ear,
    state: Option<SoundFollowerState>,
}

struct SoundFollowerState {
    explorer: Explorer,
    schedule: SoundSchedule,
    sources: Vec<TrackedSource>,
    field: Option<SoundField>,
    levels: Vec<f32>,
    /// The last Submit's source and outcome so far.
    pending: Option<(usize, SubmitOutcome)>,
    has_verdicts: bool,
    /// Silence of found targets.
    silence: SilenceRule,
    /// True if a Submit may be for any target: an unsuccessful one then rules out all sources near it.
    is_any_right: bool,
    /// Submit, or Stop without Submits left.
    claim: Action,
}

#[derive(Default)]
struct TrackedSource {
    belief: SourceBelief,
    estimate: Option<SourceEstimate>,
    wrong_submits: u32,
    /// Positions of unsuccessful Submits.
    missed: Vec<FloorPoint>,
}

impl SoundFollowerState {
    fn new(task: &TaskSpec, mission: &Mission) -> Self {
        let sources = task.sounding_sources(mission.goals.len());
        let mut explorer = Explorer::new(task);
        // Without images nothing widens the area in which sources are sought.
        explorer.map.suppose([FloorPoint::new(-AROUND_M, -AROUND_M), FloorPoint::new(AROUND_M, AROUND_M)]);
        Self {
            explorer,
            schedule: SoundSchedule::new(sources, task.sounding_window_steps),
            sources: (0..sources).map(|_| TrackedSource::default()).collect(),
            field: None,
            levels: Vec::new(),
            pending: None,
            has_verdicts: task.feedback == FeedbackRule::Verdict,
            silence: task.silence,
            is_any_right: mission.order == Order::Unordered,
            claim: Action::Submit,
        }
    }

    /// Applies the outcome of the last Submit, once it is known.
    fn settle(&mut self, feedback: Feedback, heard: Option<&HeardSound>) {
        let Some((source, outcome)) = &mut self.pending else { return };
        let Some(found) = outcome.update(feedback, heard, FOUND_LEVEL) else { return };
        if found {
            outcome.silence(*source, &mut self.schedule);
        } else {
            let here = self.explorer.pose().place;
            let source = &mut self.sources[*source];
            source.wrong_submits += 1;
            source.missed.extend(self.is_any_right.then_some(here));
        }
        self.pending = None;
        self.levels.clear();
    }

    fn listen(&mut self, source: usize, heard: &HeardSound) {
        if self.schedule.is_first() {
            self.levels.clear();
        }
        self.levels.push(heard.level);
        let (pose, map) = (self.explorer.pose(), &self.explorer.map);
        let field = self.field.take().filter(|field| field.listener() == pose.place);
        let field = field.unwrap_or_else(|| SoundField::new(map, pose.place, map.area(0.0)));
        let source = &mut self.sources[source];
        source.belief.hear(&field, &pose, heard);
        source.estimate = source.belief.estimate(&field, map, &source.missed);
        self.field = Some(field);
    }

    /// Returns the nearest open source with an estimate; sources with several unsuccessful Submits come last.
    fn aim(&self) -> Option<(usize, SourceEstimate)> {
        let here = self.explorer.pose().place;
        let open = (0..self.sources.len()).filter(|&source| !self.schedule.is_silent(source));
        let heard = open.filter_map(|source| Some((source, self.sources[source].estimate?)));
        let cost = |&(source, estimate): &(usize, SourceEstimate)| {
            (self.sources[source].wrong_submits >= MOST_WRONG, estimate.place.distance_m(here))
        };
        heard.min_by(|a, b| {
            let (a, b) = (cost(a), cost(b));
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
        })
    }

    fn decide(&mut self) -> Action {
        if self.pending.is_some() {
            return Action::TurnLeft;
        }
        let Some((source, SourceEstimate { place, certainty })) = self.aim() else {
            return Action::MoveForward;
        };
        if certainty >= CERTAIN
            && place.distance_m(self.explorer.pose().place) <= NEAR_M
            && let Some(level) = self.loudness_of(source)
        {
            self.pending = Some((source, SubmitOutcome::new(self.silence, source, &self.schedule, level)));
            return self.claim;
        }
        self.explorer.go_to(place, REACH_M).unwrap_or(Action::TurnLeft)
    }

    /// Returns a source's level if it sounds now at close range: otherwise silence proves nothing.
    fn loudness_of(&self, source: usize) -> Option<f32> {
        let recent = &self.levels[self.levels.len().saturating_sub(RECENT)..];
        let level = recent.iter().sum::<f32>() / recent.len().max(1) as f32;
        let is_heard = self.schedule.current() == source
            && self.schedule.steps_left() >= SubmitOutcome::STEPS
            && recent.len() == RECENT
            && range_m(level) <= LOUD_M;
        (is_heard || self.has_verdicts).then_some(level)
    }
}

impl Agent for SoundFollower {
    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        self.state = Some(SoundFollowerState::new(task, mission));
    }

    fn act(&mut self, observation: &Observation) -> Action {
        let Some(state) = &mut self.state else { return Action::Stop };
        state.explorer.observe(observation);
        state.claim = observation.claim();
        let heard = observation.audio.as_ref().and_then(|audio| self.ear.hear(audio));
        state.settle(observation.feedback, heard.as_ref());
        if state.pending.is_some() {
            // The source of this sound depends on the outcome of the Submit.
            state.schedule.defer();
        } else if let (Some(source), Some(heard)) = (state.schedule.advance(), heard) {
            state.listen(source, &heard);
        }
        let action = if observation.remaining_steps <= 1 { Action::Stop } else { state.decide() };
        state.explorer.record(action);
        action
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The pose a quarter of a metre ahead of a body with heading 0.
    fn ahead(pose: &Pose) -> Pose {
        let [x, y, z] = pose.position();
        Pose::new([x, y, z - 0.25], pose.heading_rad())
    }

    #[test]
    fn forward_and_turn_walks_until_blocked() {
        let mut agent = ForwardAndTurn::default();
        agent.begin(&TaskSpec::default(), &Mission::default());
        let mut seen = Observation { remaining_steps: 9, ..Observation::default() };
        assert_eq!(agent.act(&seen), Action::MoveForward);
        seen.pose = ahead(&seen.pose);
        assert_eq!(agent.act(&seen), Action::MoveForward);
        assert_eq!(agent.act(&seen), Action::TurnRight);
        assert_eq!(agent.act(&seen), Action::MoveForward);
        assert_eq!(agent.act(&Observation { remaining_steps: 1, ..seen }), Action::Stop);
    }

    /// Actions in front of a wall (`free` false) or in the open.
    fn walk(seed: u64, steps: u32, free: bool) -> Vec<Action> {
        let mut agent = RandomAgent::new(seed);
        agent.begin(&TaskSpec::default(), &Mission::default());
        let mut seen = Observation { remaining_submits: 3, ..Observation::default() };
        (0..steps)
            .map(|step| {
                seen.remaining_steps = steps - step;
                let action = agent.act(&seen);
                match action {
                    Action::MoveForward if free => seen.pose = ahead(&seen.pose),
                    Action::Submit => seen.remaining_submits -= 1,
                    _ => {}
                }
                action
            })
            .collect()
    }

    fn count(actions: &[Action], wanted: Action) -> usize {
        actions.iter().filter(|&&action| action == wanted).count()
    }

    #[test]
    fn equal_seeds_give_equal_walks() {
        assert_eq!(walk(1, 500, true), walk(1, 500, true));
        assert_ne!(walk(1, 500, true), walk(2, 500, true));
    }

    #[test]
    fn random_agent_walks_submits_rarely_and_stops_last() {
        for seed in 0..20 {
            let actions = walk(seed, 1000, true);
            assert!(count(&actions, Action::MoveForward) > 500, "seed {seed}");
            assert!(count(&actions, Action::Submit) <= 3, "seed {seed}");
            assert_eq!(actions.iter().position(|&action| action == Action::Stop), Some(999), "seed {seed}");
        }
    }

    #[test]
    fn random_agent_turns_after_each_blocked_step() {
        let actions = walk(3, 300, false);
        let stubborn = actions.windows(2).filter(|pair| pair == &[Action::MoveForward; 2]);
        assert_eq!(stubborn.count(), 0);
        assert!(count(&actions, Action::TurnLeft) > 0 && count(&actions, Action::TurnRight) > 0);
    }

    #[test]
    fn submits_are_spread_and_stop_comes_last() {
        let (mut schedule, mut submits_left) = (SubmitSchedule::new(4, 100), 3);
        let mut due = Vec::new();
        for step in 0..100 {
            let seen = Observation {
                step,
                remaining_steps: 100 - step,
                remaining_submits: submits_left,
                ..Observation::default()
            };
            let Some(action) = schedule.due(&seen) else { continue };
            submits_left -= u32::from(action == Action::Submit);
            due.push((step, action));
        }
        let submit = |step| (step, Action::Submit);
        assert_eq!(due, [submit(24), submit(49), submit(74), (99, Action::Stop)]);
    }

    #[test]
    fn generator_matches_the_reference() {
        let mut rng = Rng::new(0);
        assert_eq!([rng.next(), rng.next()], [0xE220_A839_7B1D_CDAF, 0x6E78_9E6A_A1B9_65F4]);
    }

    #[test]
    fn ranges_include_both_ends() {
        let mut rng = Rng::new(7);
        let mut seen = [0_u32; 5];
        for _ in 0..1000 {
            seen[rng.between(1, 3) as usize] += 1;
        }
        assert_eq!((seen[0], seen[4]), (0, 0));
        assert!(seen[1..4].iter().all(|&n| n > 250), "{seen:?}");
    }
}
