//! The agent: memories of an episode, updated with every observation.

use crate::candidate::Decision;
use crate::memory::{Aim, PendingSubmit, SourceMemory, StoreyMemory};
use crate::mission::{GoalPairing, MissionState};
use crate::preset::{Ablation, Preset};
use crate::stairs::StairClimber;
use crate::trace::lines::TraceInput;
use crate::trace::{Recorder, TraceError};
use crate::weights::Weights;
use avln_client::{
    Action, Agent, DepthImage, MethodType, Mission, Observation, Order, SilenceRule, SoundingRule, TaskSpec,
    WrongSubmit,
};
use avln_kit::LOOK_M;
use avln_kit::explorer::MotionController;
use avln_kit::geometry::{FloorPoint, PinholeCamera, Pose2d};
use avln_kit::hearing::{Ear, HeardSound, SoundSchedule};
use avln_kit::map::{
    BearingMemory, Cell, FreshLook, GoalPrior, IntensityMemory, ObjectMemory, Occupancy, SoundField, Storeys,
};
use avln_kit::path::PathFollower;
use avln_kit::perception::{ClassicalRecognition, Hints, NetworkRecognition, Query, Recognition};
use std::{mem, sync::Arc};

/// The paper's reference agent (section 4). Memories last for one episode.
pub struct PagNav {
    pub(crate) weights: Weights,
    pub(crate) ablation: Ablation,
    perception: Box<dyn Recognition>,
    pub(crate) hints: Option<Arc<dyn Hints>>,
    ear: Ear,
    view: PinholeCamera,
    /// The memory M_t of the current storey.
    pub(crate) here: StoreyMemory,
    storeys: Storeys<StoreyMemory>,
    pub(crate) stairs: StairClimber,
    /// Looks of the current frame; empty if the perception did not process it.
    pub(crate) fresh: Vec<FreshLook>,
    /// Sound propagation to the current position; recomputed after a move.
    pub(crate) field: Option<SoundField>,
    pub(crate) motion: MotionController,
    /// Paths to sources, candidates and viewpoints.
    pub(crate) follower: PathFollower,
    pub(crate) frontier_follower: PathFollower,
    /// The current frontier with score and remaining steps as the target.
    pub(crate) frontier: Option<(FloorPoint, f32, u32)>,
    pub(crate) priors: Vec<GoalPrior>,
    pub(crate) mission: MissionState,
    pub(crate) schedule: SoundSchedule,
    pub(crate) window_steps: u32,
    pub(crate) pairing: GoalPairing,
    pub(crate) aim: Option<Aim>,
    /// The source that the agent heads for.
    pub(crate) focus: Option<usize>,
    pub(crate) pending: Option<PendingSubmit>,
    /// The last claim and the last known outcome, of the current step only.
    pub(crate) claimed: bool,
    pub(crate) outcome: Option<(PendingSubmit, bool)>,
    /// Levels since the current window began.
    pub(crate) levels: Vec<f32>,
    /// Steps of search on this storey since the last completed goal.
    pub(crate) searched_steps: u32,
    pub(crate) wrong_submit: WrongSubmit,
    /// Silence of found targets.
    pub(crate) silence: SilenceRule,
    /// True if found targets fall silent.
    pub(crate) falls_silent: bool,
    pub(crate) step: u32,
    pub(crate) remaining_steps: u32,
    pub(crate) decision: Decision,
    trace: Option<Recorder>,
}

impl Default for PagNav {
    /// Creates the preset `pag-nav`.
    fn default() -> Self {
        Self::preset(Preset::default())
    }
}

impl PagNav {
    /// Creates the agent of a preset, which sees by the bundled network.
    pub fn preset(preset: Preset) -> Self {
        Self::new(preset.weights())
    }

    /// Creates an agent that sees by the bundled network.
    pub fn new(weights: Weights) -> Self {
        Self::with(weights, Box::<NetworkRecognition>::default())
    }

    /// Returns the type of the method, by its perception.
    pub fn method_type(&self) -> MethodType {
        self.perception.method_type()
    }

    pub(crate) fn with(weights: Weights, perception: Box<dyn Recognition>) -> Self {
        let task = TaskSpec::default();
        Self {
            weights,
            ablation: Ablation::default(),
            perception,
            hints: None,
            ear: Ear::default(),
            view: PinholeCamera::new(&task),
            here: StoreyMemory::default(),
            storeys: Storeys::default(),
            stairs: StairClimber::new(task.turn_rad),
            fresh: Vec::new(),
            field: None,
            motion: MotionController::new(&task),
            follower: PathFollower::default(),
            frontier_follower: PathFollower::default(),
            frontier: None,
            priors: Vec::new(),
            mission: MissionState::default(),
            schedule: SoundSchedule::new(0, task.sounding_window_steps),
            window_steps: task.sounding_window_steps,
            pairing: GoalPairing::new(0, 0),
            aim: None,
            focus: None,
            pending: None,
            claimed: false,
            outcome: None,
            levels: Vec::new(),
            searched_steps: 0,
            wrong_submit: task.wrong_submit,
            silence: task.silence,
            falls_silent: true,
            step: 0,
            remaining_steps: task.max_steps,
            decision: Decision::default(),
            trace: None,
        }
    }

    /// Disables the parts that `ablation` names.
    pub fn without(self, ablation: Ablation) -> Self {
        Self { weights: self.weights.under(ablation), ablation, ..self }
    }

    /// Replaces the perception.
    pub fn seeing(self, perception: impl Recognition + 'static) -> Self {
        Self { perception: Box::new(perception), ..self }
    }

    /// Supplies the sounding source's true position, for privileged variants with `source_positions`.
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
            memory: &self.here,
            mission: &self.mission,
            schedule: &self.schedule,
            focus: self.focus,
            claimed: self.claimed,
            outcome: self.outcome,
            decision: &self.decision,
        }
    }

    /// Updates the memory: M_t = U(M_{t-1}, Psi_room, Psi_obj, Psi_aud, p_t, S_t).
    fn perceive(&mut self, observation: &Observation, pose: &Pose2d) {
        (self.step, self.remaining_steps) = (observation.step, observation.remaining_steps);
        self.mission.remaining_submits = observation.remaining_submits;
        self.fresh.clear();
        self.change_storey(observation.pose.position()[1]);
        if self.ablation.no_map {
            self.here.map = Occupancy::default();
        }
        self.motion.mark_blocked(pose, &mut self.here.map);
        if let Some(depth) = &observation.depth {
            self.here.map.see(&self.view, pose, depth);
            if self.weights.switches.stairs {
                self.stairs.elevation.see(&self.view, pose, self.stairs.height_m, depth);
            }
        }
        let audio = observation.audio.as_ref().filter(|_| !self.ablation.no_audio);
        let heard = audio.and_then(|audio| self.ear.hear(audio));
        self.settle(observation.feedback, heard.as_ref(), pose.place);
        self.listen(heard, pose);
        if observation.rgb.is_some() && observation.depth.is_some() {
            self.look(observation, pose);
        }
    }

    /// Swaps the memories when the body reaches another storey: what was mapped below does not apply above.
    pub(crate) fn change_storey(&mut self, height_m: f32) {
        self.stairs.height_m = height_m;
        if self.storeys.is_on(height_m) {
            return;
        }
        let (goals, sources) = (self.mission.goals(), self.here.sources.len());
        self.storeys.enter(height_m, &mut self.here, || StoreyMemory::new(goals, sources));
        // The sounds in the memory of a known storey are older than the present window.
        self.restart_acoustic_memory();
        // Fits are forgotten below, so the sources must be viewed again.
        self.here.sources.iter_mut().for_each(|source| (source.sought_steps, source.looks) = (0, 0));
        self.follower = PathFollower::default();
        self.frontier_follower = PathFollower::default();
        (self.frontier, self.field, self.focus, self.aim) = (None, None, None, None);
        self.searched_steps = 0;
        (0..sources).for_each(|source| self.pairing.forget(source));
    }

    /// Adds the room and object cues of a frame to the memory.
    fn look(&mut self, observation: &Observation, pose: &Pose2d) {
        if self.needs_fresh_look(pose) {
            self.perception.refresh();
        }
        let map = &self.here.map;
        let seen = self.perception.see(pose, observation, &|place| map.is_wall(Cell::at(place)));
        let Some(seen) = seen else { return };
        let fit = |detection: &_, goal| self.perception.fit(detection, goal);
        if self.ablation.no_object_memory {
            let last = mem::replace(&mut self.here.objects, ObjectMemory::new(self.mission.goals()));
            self.fresh = self.here.objects.recognise(pose, seen, fit);
            self.keep_efforts(&last);
        } else {
            self.fresh = self.here.objects.recognise(pose, seen, fit);
        }
        let missed = observation.depth.as_ref().and_then(|depth| self.missed_candidate(pose, depth));
        if let Some(object) = missed {
            self.here.objects.miss(object, pose.place);
        }
        let objects = self.here.objects.all();
        self.here.rooms.see(&self.here.map, self.fresh.iter().map(|look| &objects[look.object()]));
        self.look_at_sources(pose);
    }

    /// Returns the candidate that the current frame should show from near, if it shows none.
    fn missed_candidate(&self, pose: &Pose2d, depth: &DepthImage) -> Option<usize> {
        const AHEAD_RAD: f32 = 0.5;
        const SLACK_M: f32 = 0.3;
        let object = self.aim.as_ref()?.object;
        let detection = &self.here.objects.all().get(object)?.detection;
        let (place, height_m) = (detection.facing(pose.place), 0.5 * (detection.low_m + detection.high_m));
        let is_in_view = place.distance_m(pose.place) <= LOOK_M
            && pose.bearing_rad(place).abs() <= AHEAD_RAD
            && self.here.map.has_clear_line(pose.place, place)
            && self.view.reaches(pose, depth, (place, height_m), SLACK_M);
        (is_in_view && self.fresh.iter().all(|look| look.object() != object)).then_some(object)
    }

    /// Returns true if the current frame may show the candidate from near: its verification must not rest on an older frame.
    fn needs_fresh_look(&self, pose: &Pose2d) -> bool {
        const NEAR_M: f32 = 3.0;
        const ASIDE_RAD: f32 = 0.9;
        let Some(aim) = &self.aim else { return false };
        let Some(object) = self.here.objects.all().get(aim.object) else { return true };
        let place = object.detection.facing(pose.place);
        place.distance_m(pose.place) <= NEAR_M && pose.bearing_rad(place).abs() <= ASIDE_RAD
    }

    /// Adds the acoustic cues to the memory.
    pub(crate) fn listen(&mut self, heard: Option<HeardSound>, pose: &Pose2d) {
        let is_counted = self.weights.switches.count_windows;
        if self.pending.is_some_and(|pending| pending.heard.is_some()) {
            // The sound belongs to the pending source or, after a find, to the next one: only the outcome decides.
            self.restart_acoustic_memory();
            return self.schedule.defer();
        }
        let source = if is_counted { self.schedule.advance() } else { Some(0) };
        if is_counted && self.schedule.is_first() {
            self.levels.clear();
        }
        if !is_counted || self.schedule.is_first() {
            self.restart_acoustic_memory();
        }
        let Some(heard) = heard else { return };
        self.decision.heard = Some((source.filter(|_| is_counted), heard));
        self.levels.push(heard.level);
        if self.ablation.has_no_search_by_sound() {
            return;
        }
        self.remember(&heard, source, pose);
        if self.weights.switches.source_positions
            && let Some(source) = source
        {
            self.locate_source(source, pose, &heard);
        }
    }

    /// Forgets all sounds in the ablation without acoustic memory.
    fn restart_acoustic_memory(&mut self) {
        if self.ablation.no_acoustic_memory {
            self.here.intensity = IntensityMemory::default();
            self.here.bearings.iter_mut().for_each(BearingMemory::clear);
            self.here.sources.iter_mut().for_each(SourceMemory::forget_sounds);
        }
    }

    /// Updates A_int, and A_bear of all open goals: a sound does not identify its goal, unless its source is known as another's.
    fn remember(&mut self, heard: &HeardSound, source: Option<usize>, pose: &Pose2d) {
        self.here.intensity.hear(pose.place, heard.level);
        let is_another = source.is_some_and(|source| self.is_of_another_goal(source));
        for goal in self.mission.open().filter(|&goal| !is_another || !self.mission.is_active(goal)) {
            self.here.bearings[goal].hear(pose, heard, self.step);
        }
    }
}

impl Agent for PagNav {
    fn enter(&mut self, episode: &str) {
        self.trace(|trace, agent| trace.enter(agent, episode));
    }

    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        let goals = mission.goals.len();
        let placeholder: Box<dyn Recognition> = Box::<ClassicalRecognition>::default();
        let mut perception = mem::replace(&mut self.perception, placeholder);
        perception.begin(task, mission);
        let prior = |(goal, cue)| GoalPrior::new(&Query::new(cue), perception.category_of(goal));
        let priors = mission.goals.iter().enumerate().map(prior).collect();
        // Without counting, all sounds belong to a single source.
        let is_counted = self.weights.switches.count_windows;
        let sources = if is_counted { task.sounding_sources(goals) } else { 1 };
        *self = Self {
            ablation: self.ablation,
            hints: self.hints.take(),
            trace: self.trace.take(),
            view: PinholeCamera::new(task),
            motion: MotionController::new(task),
            stairs: StairClimber::new(task.turn_rad),
            here: StoreyMemory::new(goals, sources),
            priors,
            mission: MissionState::new(goals, mission.order == Order::Ordered),
            schedule: SoundSchedule::new(sources, task.sounding_window_steps),
            window_steps: task.sounding_window_steps,
            pairing: GoalPairing::new(sources, goals),
            wrong_submit: task.wrong_submit,
            silence: task.silence,
            falls_silent: task.sounding == SoundingRule::UnfinishedInDrawnOrder,
            ..Self::with(self.weights.clone(), perception)
        };
        self.trace(|trace, agent| trace.begin(agent, mission));
    }

    fn act(&mut self, observation: &Observation) -> Action {
        let pose = Pose2d::new(&observation.pose);
        self.decision = Decision::default();
        (self.claimed, self.outcome) = (false, None);
        self.perceive(observation, &pose);
        let action = self.decide(&pose);
        self.motion.record(action, &pose);
        self.trace(|trace, agent| trace.step(agent, observation, action));
        action
    }
}
