//! An environment: episodes of a source, one after another.

use crate::explorer::Explorer;
use crate::layout::{Layout, MAP_CELL_M, MAP_SIDE, MissionArrays, Row};
use crate::options::RewardFacts;
use crate::privileged::{self, Guide};
use crate::senses::{ClipCache, Sensing};
use crate::top_down::{self, MapFrame, Overview, StoreyMaps};
use crate::{AutoReset, EnvOptions, EpisodeSource, RewardRule, Teacher, TrainingEpisode, TrainingError};
use avln_episode::{Action, EndReason, Observation};
use avln_referee::{Audio, Referee};
use avln_scoring::distance_m;
use avln_truth::{EpisodeTruth, Record};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A Gymnasium step without the observation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepFlags {
    /// Reward.
    pub reward: f64,
    /// True if the task ended the episode.
    pub terminated: bool,
    /// True at the step limit.
    pub truncated: bool,
}

impl StepFlags {
    /// Returns true after the last step.
    pub fn is_over(&self) -> bool {
        self.terminated || self.truncated
    }
}

/// An exact state: the episode with all actions. Restoring repeats them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EnvState {
    /// Environment and number of the episode.
    env: u64,
    episode: u64,
    /// Start position, metres, world frame: the same numbers of another source or seed are another episode.
    start_m: [f32; 3],
    /// Actions with the state hashes after them.
    taken: Vec<(Action, u64)>,
    /// Next goal of the teachers, which depends on the way.
    routed: Option<usize>,
}

/// An environment. The episode sequence depends only on the source and the environment's number.
pub struct Env {
    number: u64,
    next_episode: u64,
    shared: Arc<Shared>,
    running: Option<Running>,
}

/// Parts shared by all environments of a vector.
pub(crate) struct Shared {
    pub(crate) source: Arc<EpisodeSource>,
    pub(crate) options: EnvOptions,
    pub(crate) layout: Layout,
    pub(crate) audio: Audio,
    pub(crate) clips: ClipCache,
}

struct Running {
    /// Environment whose episode this is; another one after the restoration of its state.
    env: u64,
    episode: u64,
    referee: Referee,
    truth: EpisodeTruth,
    guide: Guide,
    mission: MissionArrays,
    sensing: Sensing,
    path_m: f64,
    explorer: Option<Explorer>,
    /// Maps for the row, around the start pose.
    maps: Option<StoreyMaps>,
    /// Maps for pictures, along the scene's axes.
    picture_maps: Option<StoreyMaps>,
    /// Keeps the scene loaded.
    _scene: TrainingEpisode,
}

impl Shared {
    /// Checks the options.
    pub(crate) fn new(
        source: Arc<EpisodeSource>,
        options: EnvOptions,
        audio: Audio,
    ) -> Result<Arc<Self>, TrainingError> {
        options.check()?;
        source.check_rules(&options.rules)?;
        let layout = Layout::new(&options);
        Ok(Arc::new(Self { source, options, layout, audio, clips: ClipCache::default() }))
    }
}

impl Env {
    /// Creates environment `number`. Environments with the same source share its scenes.
    ///
    /// # Errors
    /// If an option is out of range.
    pub fn new(
        number: u64,
        source: impl Into<Arc<EpisodeSource>>,
        options: EnvOptions,
        audio: Audio,
    ) -> Result<Self, TrainingError> {
        Ok(Self::with(number, Shared::new(source.into(), options, audio)?))
    }

    pub(crate) fn with(number: u64, shared: Arc<Shared>) -> Self {
        Self { number, next_episode: 0, shared, running: None }
    }

    /// Returns the arrays of a row.
    pub fn layout(&self) -> &Layout {
        &self.shared.layout
    }

    pub(crate) fn autoreset(&self) -> AutoReset {
        self.shared.options.autoreset
    }

    /// Returns true between the end of an episode and the next reset.
    pub(crate) fn is_over(&self) -> bool {
        self.running.as_ref().is_some_and(|running| running.referee.end().is_some())
    }

    /// Returns the ground truth of the running episode.
    pub fn truth(&self) -> Option<&EpisodeTruth> {
        self.running.as_ref().map(|running| &running.truth)
    }

    /// Starts the next episode and writes the first observation.
    ///
    /// # Errors
    /// If a scene cannot be prepared, or the row does not fit the layout.
    pub fn reset(&mut self, row: &mut Row) -> Result<(), TrainingError> {
        row.check(&self.shared.layout)?;
        // Until the next episode has begun, the old one holds their scene in memory.
        let old = self.running.take();
        let running = Running::start(&self.shared, self.number, self.next_episode)?;
        drop(old);
        self.next_episode += 1;
        let running = self.running.insert(running);
        let first = running.referee.start();
        running.sense();
        running.put(row, &self.shared, &first);
        Ok(())
    }

    /// Performs an action and writes the observation.
    ///
    /// # Errors
    /// If the number is no action, there is no running episode, or the row does not fit the layout.
    pub fn step(&mut self, action: i64, row: &mut Row) -> Result<StepFlags, TrainingError> {
        row.check(&self.shared.layout)?;
        let env = self.number as usize;
        let action = Action::try_from(action).map_err(|source| TrainingError::Action { env, source })?;
        let running = self.running.as_mut().ok_or(TrainingError::NotReset(env))?;
        let (before, routed) = (running.found_goals(), running.guide.routed);
        let is_measured = !matches!(self.shared.options.reward, RewardRule::Sparse | RewardRule::None);
        let goal = routed.filter(|_| is_measured);
        let from_m = goal.and_then(|goal| running.referee.walk_m(goal));
        let outcome = running.referee.step(action)?;
        running.sense();
        running.add_step_to_path();
        running.look();
        let to_m = goal.and_then(|goal| running.referee.walk_m(goal));
        running.guide.route(&running.referee, running.truth.order);
        let found = running.found_goals();
        let is_same = running.guide.routed == routed;
        let facts = RewardFacts {
            progress_m: from_m.zip(to_m).filter(|_| is_same).map_or(0.0, |(from_m, to_m)| from_m - to_m),
            is_submit: action == Action::Submit,
            is_stop: action == Action::Stop,
            found: found - before,
            is_complete: found as usize == running.truth.targets.len(),
        };
        running.put(row, &self.shared, &outcome.observation);
        let truncated = outcome.end == Some(EndReason::StepLimit);
        Ok(StepFlags {
            reward: facts.reward(self.shared.options.reward),
            terminated: outcome.end.is_some() && !truncated,
            truncated,
        })
    }

    /// Returns the exact state.
    ///
    /// # Errors
    /// If there is no running episode.
    pub fn state(&self) -> Result<EnvState, TrainingError> {
        let running = self.running.as_ref().ok_or(TrainingError::NotReset(self.number as usize))?;
        let taken = running.referee.facts().iter().map(|step| (step.action, step.state_hash)).collect();
        let start_m = running.truth.start.position.coords.into();
        Ok(EnvState {
            env: running.env,
            episode: running.episode,
            start_m,
            taken,
            routed: running.guide.routed,
        })
    }

    /// Restores a state of this or another environment with the same source, and writes its observation.
    ///
    /// # Errors
    /// If the state belongs to other episodes, or the row does not fit the layout.
    pub fn restore(&mut self, state: &EnvState, row: &mut Row) -> Result<(), TrainingError> {
        row.check(&self.shared.layout)?;
        let mut running = Running::start(&self.shared, state.env, state.episode)?;
        if state.start_m != <[f32; 3]>::from(running.truth.start.position.coords) {
            return Err(TrainingError::State("its episode is of another source or seed".to_owned()));
        }
        let goals = running.truth.targets.len();
        if let Some(goal) = state.routed.filter(|&goal| goal >= goals) {
            return Err(TrainingError::State(format!(
                "it leads to goal {goal}, and its mission has {goals}"
            )));
        }
        let first = running.referee.start();
        running.sense();
        let outcome = running.referee.replay(&state.taken);
        let outcome = outcome.map_err(|error| TrainingError::State(error.to_string()))?;
        let seen = outcome.map_or(first, |outcome| outcome.observation);
        running.sense_replayed();
        running.path_m = running.walked_m();
        running.look_back();
        running.guide.routed = state.routed;
        running.put(row, &self.shared, &seen);
        self.next_episode = state.episode + 1;
        self.running = Some(running);
        Ok(())
    }

    /// Returns the parts of a picture with a view of `side × side` pixels.
    ///
    /// # Errors
    /// If there is no running episode, or the side is out of range.
    pub fn overview(&mut self, side: u32) -> Result<Overview, TrainingError> {
        crate::options::within("side", side, 16, 2048)?;
        let running = self.running.as_mut().ok_or(TrainingError::NotReset(self.number as usize))?;
        let Running { referee, truth, picture_maps, .. } = running;
        let maps = picture_maps.get_or_insert_with(|| {
            StoreyMaps::new(referee.world().assets(), top_down::overview_frame(truth))
        });
        Ok(Overview::new(referee, truth, maps, side))
    }

    /// Ends the episode and returns its facts for scoring; `None` without an episode.
    pub fn take_record(&mut self) -> Option<(EpisodeTruth, Record)> {
        self.running.take().map(|running| running.referee.into_record())
    }
}

impl Running {
    fn start(shared: &Shared, env: u64, number: u64) -> Result<Self, TrainingError> {
        let options = &shared.options;
        let scene = shared.source.episode(env, number, &options.rules)?;
        let (assets, mission, truth) =
            (Arc::clone(&scene.assets), scene.mission.clone(), scene.truth.clone());
        let referee = Referee::new(
            assets,
            mission,
            truth.clone(),
            options.rules.clone(),
            options.sensors.clone(),
            &shared.audio,
        )?
        .with_added_submits(options.added_submits)
        .with_detail(options.detail);
        let referee = if options.ids { referee.with_instances() } else { referee };
        let guide = Guide::new(&referee, &truth);
        let mission = MissionArrays::new(referee.mission(), options.goal_side as usize);
        let sensing = Sensing::new(options, &shared.audio, &shared.clips, &scene, &referee)?;
        let frame =
            MapFrame { origin: truth.start, cell_m: MAP_CELL_M, side: MAP_SIDE, has_solid_walls: true };
        let maps = options.top_down.then(|| StoreyMaps::new(&scene.assets, frame));
        let is_exploring = options.privileged && options.teacher == Teacher::Explore;
        let explorer = is_exploring.then(|| {
            let (assets, hfov_rad) = (Arc::clone(&scene.assets), options.sensors.hfov_rad);
            Explorer::new(assets, scene.floor(), truth.targets.len(), &options.rules, hfov_rad)
        });
        let (path_m, picture_maps, _scene) = (0.0, None, scene);
        let mut running = Self {
            env,
            episode: number,
            referee,
            truth,
            guide,
            mission,
            sensing,
            path_m,
            explorer,
            maps,
            picture_maps,
            _scene,
        };
        running.look();
        Ok(running)
    }

    /// Updates the cheap senses after the start or a step.
    fn sense(&mut self) {
        self.sensing.sense(self.referee.world().pose(), self.referee.sounding());
    }

    /// Updates the cheap senses after a replay: map and sound depend on all steps.
    fn sense_replayed(&mut self) {
        for step in self.referee.facts() {
            self.sensing.sense(step.pose, step.sounding.map(usize::from));
        }
    }

    /// Adds the present view to the explorer.
    fn look(&mut self) {
        if let Some(explorer) = &mut self.explorer {
            explorer.look(&self.referee.world().pose(), &self.truth.targets);
        }
    }

    /// Adds the views after all steps to a new explorer.
    fn look_back(&mut self) {
        if let Some(explorer) = &mut self.explorer {
            self.referee.facts().iter().for_each(|step| explorer.look(&step.pose, &self.truth.targets));
        }
    }

    fn add_step_to_path(&mut self) {
        let steps = self.referee.facts();
        let before =
            steps.len().checked_sub(2).map_or(self.truth.start.position, |last| steps[last].pose.position);
        if let Some(step) = steps.last() {
            self.path_m += distance_m(&before, &step.pose.position);
        }
    }

    fn walked_m(&self) -> f64 {
        let places = self.referee.facts().iter().map(|step| step.pose.position);
        let from = std::iter::once(self.truth.start.position).chain(places.clone());
        from.zip(places).map(|(from, to)| distance_m(&from, &to)).sum()
    }

    fn found_goals(&self) -> u32 {
        self.referee.is_found().iter().filter(|found| **found).count() as u32
    }

    fn put(&mut self, row: &mut Row, shared: &Shared, seen: &Observation) {
        let (layout, options) = (&shared.layout, &shared.options);
        row.put_mission(layout, &self.mission);
        row.put_observation(layout, seen);
        self.sensing.put(row, layout);
        let Self { referee, guide, truth, .. } = self;
        if options.privileged {
            privileged::put(row, layout, referee, guide, truth, self.path_m, self.explorer.as_ref());
        }
        if options.ids {
            privileged::put_ids(row, layout, referee, truth);
        }
        if let Some(maps) = &mut self.maps {
            let storey = maps.storey(referee.world().pose().position.y);
            row.put(layout, "top_down", maps.map(referee.world().assets(), storey));
        }
    }
}
