//! The agent: memories of an episode, updated with every observation.

use crate::candidate::{Candidate, Decision, Evidence};
use crate::goals::{GoalPairing, PendingSubmit, SourceMemory};
use crate::stairs::StairClimber;
use crate::trace::lines::TraceInput;
use crate::trace::{Recorder, TraceError};
use crate::weights::{Ablation, Weights};
use avln_client::{
    Action, Agent, Feedback, FeedbackRule, Mission, Observation, Order, SilenceRule, TaskSpec,
};
use avln_kit::LOOK_M;
use avln_kit::explorer::MotionController;
use avln_kit::geometry::{FloorPoint, PinholeCamera, Pose2d};
use avln_kit::hearing::{Ear, HeardSound, SoundSchedule};
use avln_kit::map::{Cell, ObjectMemory, Occupancy, SoundField, SourceEstimate, Storeys, range_m};
use avln_kit::outcome::SubmitOutcome;
use avln_kit::path::PathFollower;
use avln_kit::perception::{ClassicalRecognition, Hints, NetworkRecognition, Query, Recognition};
use std::{mem, sync::Arc};

/// Margin around the seen area in which sources may be, metres.
const AROUND_M: f32 = 1.5;
/// Sound steps over which the level is averaged.
const RECENT: usize = 3;

/// The paper's reference agent (section 4). Training-free; memories last for one episode.
pub struct PagNav {
    pub(crate) weights: Weights,
    pub(crate) ablation: Ablation,
    perception: Box<dyn Recognition>,
    hints: Option<Arc<dyn Hints>>,
    ear: Ear,
    view: PinholeCamera,
    pub(crate) map: Occupancy,
    pub(crate) objects: ObjectMemory,
    storeys: Storeys<StoreyMemory>,
    pub(crate) stairs: StairClimber,
    /// Sound propagation to the current position; recomputed after a move.
    field: Option<SoundField>,
    pub(crate) motion: MotionController,
    /// Paths to sources and candidates.
    pub(crate) follower: PathFollower,
    pub(crate) frontier_follower: PathFollower,
    /// The current frontier with score and remaining steps as the target.
    pub(crate) frontier: Option<(FloorPoint, f32, u32)>,
    pub(crate) schedule: SoundSchedule,
    pub(crate) queries: Vec<Query>,
    pub(crate) goals: GoalPairing,
    pub(crate) sources: Vec<SourceMemory>,
    /// The source that the agent heads for.
    pub(crate) focus: Option<usize>,
    pub(crate) pending: Option<PendingSubmit>,
    /// The current source's levels since its turn began.
    levels: Vec<f32>,
    /// True if the phase returns the verdict of a Submit.
    has_verdicts: bool,
    /// Silence of found targets.
    silence: SilenceRule,
    pub(crate) remaining_steps: u32,
    pub(crate) decision: Decision,
    trace: Option<Recorder>,
}

struct StoreyMemory {
    map: Occupancy,
    objects: ObjectMemory,
    sources: Vec<SourceMemory>,
}

impl StoreyMemory {
    fn new(goals: usize) -> Self {
        let sources = (0..goals).map(|_| SourceMemory::default()).collect();
        Self { map: Occupancy::default(), objects: ObjectMemory::new(goals), sources }
    }
}

impl Default for PagNav {
    fn default() -> Self {
        Self::new(Weights::default())
    }
}

impl PagNav {
    /// Creates an agent that sees by the bundled network.
    pub fn new(weights: Weights) -> Self {
        Self::with(weights, Box::<NetworkRecognition>::default())
    }

    fn with(weights: Weights, perception: Box<dyn Recognition>) -> Self {
        let task = TaskSpec::default();
        Self {
            weights,
            ablation: Ablation::default(),
            perception,
            hints: None,
            ear: Ear::default(),
            view: PinholeCamera::new(&task),
            map: Occupancy::default(),
            objects: ObjectMemory::default(),
            storeys: Storeys::default(),
            stairs: StairClimber::new(task.turn_rad),
            field: None,
            motion: MotionController::new(&task),
            follower: PathFollower::default(),
            frontier_follower: PathFollower::default(),
            frontier: None,
            schedule: SoundSchedule::new(0, task.sounding_window_steps),
            queries: Vec::new(),
            goals: GoalPairing::new(0, false),
            sources: Vec::new(),
            focus: None,
            pending: None,
            levels: Vec::new(),
            has_verdicts: false,
            silence: task.silence,
            remaining_steps: task.max_steps,
            decision: Decision::default(),
            trace: None,
        }
    }

    /// Disables the parts that `ablation` names.
    pub fn without(self, ablation: Ablation) -> Self {
        let weights = if ablation.no_audio { self.weights.silent() } else { self.weights };
        Self { weights, ablation, ..self }
    }

    /// Replaces the perception.
    pub fn seeing(self, perception: impl Recognition + 'static) -> Self {
        Self { perception: Box::new(perception), ..self }
    }

    /// Supplies the sounding source's true position, for privileged variants.
    pub fn hinted(self, hints: Arc<dyn Hints>) -> Self {
        Self { hints: Some(hints), ..self }
    }

    /// Records traces. Actions stay the same, even if recording fails.
    pub fn traced(self, trace: Recorder) -> Self {
        Self { trace: Some(trace), ..self }
    }

    /// Ends the last episode's trace; fails with the first failure in any episode.
    pub fn end_trace(&mut self) -> Result<(), TraceError> {
        self.trace(Recorder::end);
        self.trace.take().map_or(Ok(()), Recorder::conclude)
    }

    fn trace(&mut self, write: impl FnOnce(&mut Recorder, &TraceInput)) {
        let Some(mut trace) = self.trace.take() else { return };
        write(&mut trace, &self.trace_input());
        self.trace = Some(trace);
    }

    fn trace_input(&self) -> TraceInput<'_> {
        TraceInput {
            weights: &self.weights,
            ablation: self.ablation,
            map: &self.map,
            objects: &self.objects,
            goals: self.queries.len(),
            sources: &self.sources,
            schedule: &self.schedule,
            focus: self.focus,
            pending: self.pending,
            decision: &self.decision,
        }
    }

    fn perceive(&mut self, observation: &Observation, pose: &Pose2d) {
        self.remaining_steps = observation.remaining_steps;
        self.change_storey(observation.pose.position[1]);
        self.motion.mark_blocked(pose, &mut self.map);
        if let Some(depth) = &observation.depth {
            self.map.see(&self.view, pose, depth);
            self.stairs.elevation.see(&self.view, pose, self.stairs.height_m, depth);
        }
        let audio = observation.audio.as_ref().filter(|_| !self.ablation.no_audio);
        let heard = audio.and_then(|audio| self.ear.hear(audio));
        self.settle(observation.feedback, heard.as_ref(), pose.place);
        if self.pending.is_some() {
            // The sound belongs to the pending source or, after a find, to the next one: only the outcome decides.
            self.schedule.defer();
        } else if let (Some(source), Some(heard)) = (self.schedule.advance(), heard) {
            self.listen(source, pose, &heard);
        }
        if observation.rgb.is_some() && observation.depth.is_some() {
            self.look(observation, pose);
        }
    }

    /// Swaps the memories when the body reaches another storey: what was mapped below does not apply above.
    fn change_storey(&mut self, height_m: f32) {
        self.stairs.height_m = height_m;
        if self.storeys.is_on(height_m) {
            return;
        }
        let (map, objects) = (mem::take(&mut self.map), mem::take(&mut self.objects));
        let mut memory = StoreyMemory { map, objects, sources: mem::take(&mut self.sources) };
        let count = self.queries.len();
        self.storeys.enter(height_m, &mut memory, || StoreyMemory::new(count));
        StoreyMemory { map: self.map, objects: self.objects, sources: self.sources } = memory;
        self.sources.iter_mut().for_each(|source| source.sought_steps = 0);
        self.follower = PathFollower::default();
        self.frontier_follower = PathFollower::default();
        self.frontier = None;
        self.field = None;
        self.focus = None;
        (0..count).for_each(|source| self.goals.forget(source));
    }

    /// Updates the object memory by an image.
    fn look(&mut self, observation: &Observation, pose: &Pose2d) {
        let map = &self.map;
        let detections = self.perception.see(pose, observation, &|place| map.is_wall(Cell::at(place)));
        if self.ablation.no_memory && detections.is_some() {
            self.objects = ObjectMemory::new(self.queries.len());
        }
        self.objects.see(detections.unwrap_or_default());
        self.objects.look(map, pose, LOOK_M, |detection, goal| self.perception.fit(detection, goal));
        self.look_at_sources(pose);
    }

    /// Applies the pending Submit's outcome, once it is known.
    fn settle(&mut self, feedback: Feedback, heard: Option<&HeardSound>, here: FloorPoint) {
        let Some(pending) = &mut self.pending else { return };
        let outcome = pending.outcome.update(feedback, heard, self.weights.found_level);
        // Without audio and verdicts there is no evidence: the Submit counts as correct.
        let Some(found) = outcome.or(self.ablation.no_audio.then_some(true)) else { return };
        let pending = *pending;
        self.pending = None;
        self.levels.clear();
        if found {
            pending.outcome.silence(pending.source, &mut self.schedule);
            if self.ablation.no_audio {
                self.goals.close(pending.goal);
                self.objects.refute(pending.object);
            } else {
                self.goals.found(pending.source);
                self.forget_misses();
            }
            self.focus = None;
        } else {
            self.goals.missed(pending.source);
            self.objects.refute(pending.object);
            self.record_miss(&pending, here);
        }
    }

    /// Forgets unsuccessful Submits in ordered missions: they were for the previous goal.
    fn forget_misses(&mut self) {
        if self.goals.is_ordered() {
            for source in &mut self.sources {
                source.missed.clear();
                source.missed_level = 0.0;
            }
        }
    }

    /// Records an unsuccessful Submit. In unordered missions it rules out every source near the position.
    fn record_miss(&mut self, pending: &PendingSubmit, here: FloorPoint) {
        const LOUDER: f32 = 1.2;
        let all = !self.goals.is_ordered();
        for (index, source) in self.sources.iter_mut().enumerate() {
            if all || index == pending.source {
                source.missed.push(here);
            }
        }
        self.sources[pending.source].missed_level = LOUDER * pending.level;
    }

    /// Records the objects' fits at located sources in view.
    fn look_at_sources(&mut self, pose: &Pose2d) {
        for index in 0..self.sources.len() {
            let is_located = self.sources[index].is_located(&self.weights);
            let Some(estimate) = self.sources[index].estimate.filter(|_| is_located) else { continue };
            if self.map.is_in_view(pose, estimate.place, LOOK_M) {
                self.sources[index].look_at(estimate.place);
                for goal in 0..self.queries.len() {
                    self.goals.see(index, goal, self.fit_at(estimate.place, goal));
                }
            }
        }
    }

    /// Returns the best visual fit with a goal among the objects at a position, 0 to 1.
    fn fit_at(&self, place: FloorPoint, goal: usize) -> f32 {
        const AT_M: f32 = 0.4;
        let at = self.objects.all().iter().filter(|object| object.detection.distance_m(place) <= AT_M);
        let fits = at.map(|object| {
            let context = self.context(object.detection.center(), goal);
            Evidence { vis: object.vis(goal), context, sound: 0.0 }.seen(&self.weights)
        });
        fits.fold(0.0, f32::max)
    }

    /// Returns the support from rooms and neighbouring objects for a goal at a position, 0 to 1.
    pub(crate) fn context(&self, place: FloorPoint, goal: usize) -> f32 {
        const NEUTRAL: f32 = 0.5;
        if self.ablation.no_priors { NEUTRAL } else { self.objects.context(place, &self.queries[goal]) }
    }

    fn listen(&mut self, index: usize, pose: &Pose2d, heard: &HeardSound) {
        if self.schedule.is_first() {
            self.levels.clear();
        }
        self.levels.push(heard.level);
        self.decision.heard = Some((index, *heard));
        let map = &self.map;
        let source = &mut self.sources[index];
        let field = self.field.take().filter(|field| field.listener() == pose.place);
        let field = field.unwrap_or_else(|| SoundField::new(map, pose.place, map.area(AROUND_M)));
        source.intensity.hear(pose.place, heard.level);
        source.belief.hear(&field, pose, heard);
        let hint = self.hints.as_ref().and_then(|hints| hints.source());
        let hint = hint.map(|place| SourceEstimate { place, certainty: 1.0 });
        let estimate = hint.or_else(|| source.belief.estimate(&field, map, &source.missed));
        if source.locate(estimate) {
            self.goals.forget(index);
        }
        self.field = Some(field);
    }

    /// Submits a candidate, unless the outcome would remain unknown.
    pub(crate) fn submit(&mut self, candidate: &Candidate, pose: &Pose2d) -> Option<Action> {
        let Candidate { object, source, goal, .. } = *candidate;
        let recent = &self.levels[self.levels.len().saturating_sub(RECENT)..];
        let level = recent.iter().sum::<f32>() / recent.len().max(1) as f32;
        // Without verdicts the only evidence is the silence of a source that was loud before.
        if !self.has_verdicts && !self.ablation.no_audio {
            let is_heard = self.schedule.current() == source
                && recent.len() == RECENT
                && self.schedule.steps_left() >= SubmitOutcome::STEPS
                && range_m(level) <= self.weights.look_range_m;
            if !is_heard {
                return None;
            }
            if !self.sources[source].is_worth_submit(level, pose.place) {
                // The same Submit failed before, and waiting would not help: another candidate is next.
                self.objects.refute(object);
                return None;
            }
        }
        let outcome = SubmitOutcome::new(self.silence, source, &self.schedule, level);
        self.pending = Some(PendingSubmit { source, object, goal, level, outcome });
        Some(Action::Submit)
    }
}

impl Agent for PagNav {
    fn enter(&mut self, episode: &str) {
        self.trace(|trace, agent| trace.enter(agent, episode));
    }

    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        let count = mission.goals.len();
        let placeholder: Box<dyn Recognition> = Box::<ClassicalRecognition>::default();
        let mut perception = mem::replace(&mut self.perception, placeholder);
        perception.begin(task, mission);
        *self = Self {
            ablation: self.ablation,
            hints: self.hints.take(),
            trace: self.trace.take(),
            view: PinholeCamera::new(task),
            motion: MotionController::new(task),
            stairs: StairClimber::new(task.turn_rad),
            objects: ObjectMemory::new(count),
            schedule: SoundSchedule::new(count, task.sounding_window_steps),
            queries: mission.goals.iter().map(Query::new).collect(),
            goals: GoalPairing::new(count, mission.order == Order::Ordered),
            sources: mission.goals.iter().map(|_| SourceMemory::default()).collect(),
            has_verdicts: task.feedback == FeedbackRule::Verdict,
            silence: task.silence,
            ..Self::with(self.weights.clone(), perception)
        };
        self.trace(|trace, agent| trace.begin(agent, mission));
    }

    fn act(&mut self, observation: &Observation) -> Action {
        let pose = Pose2d::new(&observation.pose);
        self.decision = Decision::default();
        self.perceive(observation, &pose);
        let action = self.decide(&pose);
        self.motion.record(action, &pose);
        self.trace(|trace, agent| trace.step(agent, observation, action));
        action
    }
}
