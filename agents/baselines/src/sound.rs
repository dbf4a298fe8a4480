use avln_client::{Action, Agent, Feedback, FeedbackRule, Mission, Observation, Order, TaskSpec};
use avln_kit::explorer::Explorer;
use avln_kit::geometry::FloorPoint;
use avln_kit::hearing::{Ear, HeardSound, SoundSchedule, SubmitOutcome};
use avln_kit::map::{SoundField, SourceBelief, SourceEstimate, range_m};

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

/// An agent that walks to sounds and submits there. It does not see: its map contains only the obstacles that blocked
/// it.
///
/// The behaviour follows SAVi (Chen, Al-Halah and Grauman 2021) for sounding goals: a belief about each source
/// persists through silence, and the agent walks to it. Differences to SAVi: nothing is learned, there are no images,
/// the clip does not reveal the category, and goals are ignored, so that it submits at the nearest source even in
/// ordered missions.
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
    /// True if a Submit may be for any target: an unsuccessful one then rules out all sources near it.
    is_any_right: bool,
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
        let goals = mission.goals.len();
        let mut explorer = Explorer::new(task);
        // Without images nothing widens the area in which sources are sought.
        explorer.map.suppose([FloorPoint::new(-AROUND_M, -AROUND_M), FloorPoint::new(AROUND_M, AROUND_M)]);
        Self {
            explorer,
            schedule: SoundSchedule::new(goals, task.sounding_window_steps),
            sources: (0..goals).map(|_| TrackedSource::default()).collect(),
            field: None,
            levels: Vec::new(),
            pending: None,
            has_verdicts: task.feedback == FeedbackRule::Verdict,
            is_any_right: mission.order == Order::Unordered,
        }
    }

    /// Applies the outcome of the last Submit, once it is known.
    fn settle(&mut self, feedback: Feedback, heard: Option<&HeardSound>) {
        let Some((source, outcome)) = &mut self.pending else { return };
        let Some(found) = outcome.update(feedback, heard, FOUND_LEVEL) else { return };
        if found {
            self.schedule.silence(*source);
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
            self.pending = Some((source, SubmitOutcome::new(level)));
            return Action::Submit;
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
