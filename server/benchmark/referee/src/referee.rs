use crate::{
    schedule::Schedule,
    sounds::{self, TooFewClips},
    success::SuccessTest,
};
use avln_episode::{
    self as episode, Action, EndReason, Feedback, FeedbackRule, GoalCue, Mission, Observation, Order, Pose,
    PoseFrame, Rules, Sensors, SensorsError, SoundingRule, WrongSubmit,
};
use avln_truth::{EpisodeTruth, Record, StepFacts, SubmitFacts};
use avln_world::{
    Bank, DepthNoise, Head, Motion, Noise, RgbNoise, Rng, SceneAssets, Senses, StartError, View, World,
    WorldOptions,
};
use std::sync::Arc;

/// One running episode: the rules applied to a world, from the first observation to the sealed record.
///
/// Synchronous and heavy on the processor: a step moves, renders and listens.
pub struct Referee {
    rules: Rules,
    sensors: Sensors,
    mission: Mission,
    truth: EpisodeTruth,
    world: World,
    success: SuccessTest,
    schedule: Schedule,
    goals: Vec<GoalState>,
    submits_used: u32,
    first: Option<Observation>,
    sounding: Option<usize>,
    steps: Vec<StepFacts>,
    submits: Vec<SubmitFacts>,
    in_region_at_start: Vec<bool>,
    end: Option<EndReason>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum GoalState {
    Open,
    Found,
    Skipped,
}

/// What one action led to.
#[derive(Clone, Debug, PartialEq)]
pub struct StepOutcome {
    /// What the agent's sensors say now.
    pub observation: Observation,
    /// Why the episode is over, when it is.
    pub end: Option<EndReason>,
}

/// Why an episode could not be started or go on.
#[derive(Debug, thiserror::Error)]
pub enum RefereeError {
    /// The episode has ended; no action is possible.
    #[error("the episode ended after {steps} steps ({}); ask for the next one", reason.as_str())]
    Over {
        /// Why.
        reason: EndReason,
        /// Steps taken.
        steps: u32,
    },
    /// An action of an interrupted episode leads elsewhere than it did when it was taken.
    #[error(
        "step {step} led to state {recorded:016x} and leads to {replayed:016x} now; scene, rules or program changed since"
    )]
    Diverged {
        /// Number of the step, counted from 1.
        step: u32,
        /// Hash of the state that it led to when it was taken.
        recorded: u64,
        /// Hash of the state that it leads to now.
        replayed: u64,
    },
    /// The sensors asked for are outside of the limits.
    #[error(transparent)]
    Sensors(#[from] SensorsError),
    /// Mission and truth do not belong together.
    #[error(
        "episode {episode}: the mission has {goals} goals, its truth {targets} targets (1 to 8 are possible)"
    )]
    Mismatch {
        /// Id of the episode.
        episode: String,
        /// Goals of the mission.
        goals: usize,
        /// Targets of the truth.
        targets: usize,
    },
    /// The start pose is not a place where the body can stand.
    #[error("episode {episode}: {source}")]
    Start {
        /// Id of the episode.
        episode: String,
        /// What the world said.
        source: StartError,
    },
    /// The bank cannot give what the rules ask for.
    #[error("episode {episode}: {source}")]
    Sounds {
        /// Id of the episode.
        episode: String,
        /// What is missing.
        source: TooFewClips,
    },
}

/// What rules name of sound and cannot hold: the clips that are played, and who listens.
#[derive(Clone, Debug, Default)]
pub struct Audio {
    /// Clips are drawn from it.
    pub bank: Bank,
    /// Who listens.
    pub head: Head,
}

impl From<Bank> for Audio {
    /// The clips of a bank, heard by a sphere.
    fn from(bank: Bank) -> Self {
        Self { bank, head: Head::default() }
    }
}

impl Referee {
    /// Most goals in one mission: one bit each in the record.
    const MAX_GOALS: usize = 8;

    /// Sets the body down at the start of the episode. Nothing is rendered yet. `audio` is what the rules name.
    ///
    /// # Errors
    /// When sensors, mission or start pose are not possible, or the bank holds too few clips.
    pub fn new(
        assets: Arc<SceneAssets>,
        mission: Mission,
        truth: EpisodeTruth,
        rules: Rules,
        sensors: Sensors,
        audio: &Audio,
    ) -> Result<Self, RefereeError> {
        sensors.validate()?;
        let (goals, targets) = (mission.goals.len(), truth.targets.len());
        if goals != targets || !(1..=Self::MAX_GOALS).contains(&goals) {
            return Err(RefereeError::Mismatch { episode: truth.episode, goals, targets });
        }
        let rng = Rng::new(truth.seed);
        let sources = match sensors.audio {
            true => sounds::sources(&rules, &truth, &audio.bank, &mut rng.fork("clips"))
                .map_err(|source| RefereeError::Sounds { episode: truth.episode.clone(), source })?,
            false => Vec::new(),
        };
        let success = SuccessTest::new(&assets, &truth.targets, &rules);
        let schedule = Schedule::new(&rules, goals, &mut rng.fork("schedule"));
        let options = WorldOptions {
            noise: noise(&rules, rng.fork("noise").next_u64()),
            head: audio.head.clone(),
            ..world_options(&rules, &sensors)
        };
        let world = World::new(assets, truth.start, options, sources)
            .map_err(|source| RefereeError::Start { episode: truth.episode.clone(), source })?;
        let mut referee = Self {
            goals: vec![GoalState::Open; goals],
            in_region_at_start: Vec::new(),
            submits_used: 0,
            first: None,
            sounding: None,
            steps: Vec::new(),
            submits: Vec::new(),
            end: None,
            rules,
            sensors,
            mission,
            truth,
            world,
            success,
            schedule,
        };
        referee.in_region_at_start = (0..goals).map(|goal| referee.distance_within(goal).is_some()).collect();
        Ok(referee)
    }

    /// What the agent is told.
    pub fn mission(&self) -> &Mission {
        &self.mission
    }

    /// The rules in force.
    pub fn rules(&self) -> &Rules {
        &self.rules
    }

    /// The sensors that the agent asked for.
    pub fn sensors(&self) -> &Sensors {
        &self.sensors
    }

    /// The goal whose target sounds in the last observation; `None` in silence. Hidden from agents.
    pub fn sounding(&self) -> Option<usize> {
        self.sounding
    }

    /// For each goal: whether it can still be found. Hidden from agents.
    pub fn is_open(&self) -> Vec<bool> {
        self.goals.iter().map(|&state| state == GoalState::Open).collect()
    }

    /// The world, with the body in it. Hidden from agents.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// Why the episode is over, when it is.
    pub fn end(&self) -> Option<EndReason> {
        self.end
    }

    /// Bytes that the episode takes for itself at most, apart from the building: ears, pictures of goals, facts of steps.
    pub fn most_bytes(&self) -> usize {
        let picture = |cue: &GoalCue| match cue {
            GoalCue::Image(image) => image.pixels.len(),
            GoalCue::Category(_) | GoalCue::Description(_) => 0,
        };
        let pictures: usize = self.mission.goals.iter().map(picture).sum();
        self.world.most_bytes() + pictures + self.rules.max_steps as usize * size_of::<StepFacts>()
    }

    /// Steps taken.
    pub fn steps(&self) -> u32 {
        self.steps.len() as u32
    }

    /// The observation before the first action; the same again when asked again.
    pub fn start(&mut self) -> Observation {
        if let Some(first) = &self.first {
            return first.clone();
        }
        let sounding = self.schedule.next(&self.silent(), false);
        self.sounding = sounding;
        let senses = self.world.sense(sounding);
        let first = self.observation(senses, Feedback::None);
        self.first = Some(first.clone());
        first
    }

    /// Carries out one action.
    ///
    /// # Errors
    /// When the episode is over.
    pub fn step(&mut self, action: Action) -> Result<StepOutcome, RefereeError> {
        let (feedback, sounding) = self.act(action)?;
        let senses = self.world.sense(sounding);
        Ok(StepOutcome { observation: self.observation(senses, feedback), end: self.end })
    }

    /// Carries out the actions of an episode that was interrupted, each with the state hash that it led to then. Leads to
    /// where [`Referee::step`] led, and to the same observation; pictures in between are not made. `None` for no action.
    ///
    /// # Errors
    /// When an action leads to another state than it did, or the episode is over before the last of them.
    pub fn replay(&mut self, taken: &[(Action, u64)]) -> Result<Option<StepOutcome>, RefereeError> {
        let Some((&(last, after), before)) = taken.split_last() else { return Ok(None) };
        for &(action, state_hash) in before {
            let (_, sounding) = self.act(action)?;
            self.world.hear(sounding);
            self.check_replayed(state_hash)?;
        }
        let outcome = self.step(last)?;
        self.check_replayed(after)?;
        Ok(Some(outcome))
    }

    fn check_replayed(&self, recorded: u64) -> Result<(), RefereeError> {
        let replayed = self.state_hash();
        if replayed == recorded {
            return Ok(());
        }
        Err(RefereeError::Diverged { step: self.steps(), recorded, replayed })
    }

    /// Moves the body and judges; what sounds next is sensed by the caller, in each step once.
    fn act(&mut self, action: Action) -> Result<(Feedback, Option<usize>), RefereeError> {
        if let Some(reason) = self.end {
            return Err(RefereeError::Over { reason, steps: self.steps() });
        }
        if self.first.is_none() {
            self.start();
        }
        let motion = motion_of(action);
        let moved = self.world.advance(motion);
        let feedback = match action {
            Action::Submit | Action::Stop => self.submit(action),
            _ => Feedback::None,
        };
        let sounding = self.schedule.next(&self.silent(), motion != Motion::Stay);
        self.sounding = sounding;
        self.steps.push(StepFacts {
            action,
            pose: self.world.pose(),
            collided: moved.collided,
            in_region: self.regions_entered(),
            sounding: sounding.map(|goal| goal as u8),
            state_hash: self.state_hash(),
        });
        if self.end.is_none() && self.steps() >= self.rules.max_steps {
            self.end = Some(EndReason::StepLimit);
        }
        Ok((feedback, sounding))
    }

    /// Ends the episode from outside. Nothing happens when it is over already.
    pub fn truncate(&mut self, reason: EndReason) {
        self.end.get_or_insert(reason);
    }

    /// The hidden truth and the facts of the episode. One that is still running counts as abandoned.
    pub fn into_record(mut self) -> (EpisodeTruth, Record) {
        self.truncate(EndReason::Abandoned);
        let goals = self.goals.len();
        let record = Record {
            rules: self.rules.name,
            start: self.truth.start,
            final_distance_m: (0..goals).map(|goal| self.success.walk_m(&self.world, goal)).collect(),
            steps: self.steps,
            submits: self.submits,
            in_region_at_start: self.in_region_at_start,
            end: self.end.unwrap_or(EndReason::Abandoned),
        };
        (self.truth, record)
    }

    /// Judges a Submit or a Stop at the place where the body stands.
    fn submit(&mut self, action: Action) -> Feedback {
        let completed = self.matching_goal();
        let wrong_instance = if completed.is_none() { self.goal_of_a_distractor() } else { None };
        let skipped = match completed {
            None if self.skips_on_failure() => self.open_goals().next(),
            _ => None,
        };
        completed.into_iter().for_each(|goal| self.goals[goal] = GoalState::Found);
        skipped.into_iter().for_each(|goal| self.goals[goal] = GoalState::Skipped);
        let final_submit = self.submits_used >= self.submit_limit();
        self.submits_used += u32::from(action == Action::Submit);
        self.end = match action {
            Action::Stop => Some(EndReason::Stopped),
            _ if final_submit => Some(EndReason::FinalSubmit),
            _ => None,
        };
        let as_goal = |goal: usize| goal as u8;
        let facts = SubmitFacts {
            step: self.steps() + 1,
            completed: completed.map(as_goal),
            skipped: skipped.map(as_goal),
            wrong_instance: wrong_instance.map(as_goal),
        };
        self.submits.push(facts);
        match self.rules.feedback {
            FeedbackRule::None => Feedback::None,
            FeedbackRule::Accepted => Feedback::Accepted,
            FeedbackRule::Verdict => Feedback::Verdict(completed.is_some()),
        }
    }

    /// The open goal that a Submit here completes: the next one, or in any order the nearest one.
    fn matching_goal(&self) -> Option<usize> {
        self.claimable_goals()
            .filter_map(|goal| Some((self.distance_within(goal)?, goal)))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, goal)| goal)
    }

    /// The first goal that a Submit here would complete if a distractor were its target.
    fn goal_of_a_distractor(&self) -> Option<usize> {
        let targets = &self.truth.targets;
        let at_distractor =
            |&goal: &usize| SuccessTest::is_at_distractor(&self.world, &targets[goal], &self.rules);
        self.claimable_goals().find(at_distractor)
    }

    /// The goals that a Submit can complete now: the next one, or in any order all that are open.
    fn claimable_goals(&self) -> impl Iterator<Item = usize> {
        self.open_goals().take(match self.mission.order {
            Order::Ordered => 1,
            Order::Unordered => self.goals.len(),
        })
    }

    fn open_goals(&self) -> impl Iterator<Item = usize> {
        self.goals.iter().enumerate().filter(|(_, state)| **state == GoalState::Open).map(|(goal, _)| goal)
    }

    fn skips_on_failure(&self) -> bool {
        self.mission.order == Order::Ordered && self.rules.wrong_submit == WrongSubmit::SkipsGoal
    }

    fn submit_limit(&self) -> u32 {
        self.goals.len() as u32 - 1
    }

    fn distance_within(&self, goal: usize) -> Option<f64> {
        self.success.distance_within(&self.world, goal, &self.truth.targets[goal], &self.rules)
    }

    fn regions_entered(&self) -> u8 {
        let bit = |goal: usize| u8::from(self.distance_within(goal).is_some()) << goal;
        (0..self.goals.len()).fold(0, |bits, goal| bits | bit(goal))
    }

    /// For each goal: whether its target has fallen silent.
    fn silent(&self) -> Vec<bool> {
        let silences = self.rules.sounding == SoundingRule::UnfinishedInDrawnOrder;
        self.goals.iter().map(|&state| silences && state == GoalState::Found).collect()
    }

    /// Tells this state of body and goals from others: two episodes that agree in it after every step went the same way.
    pub fn state_hash(&self) -> u64 {
        let fold = |hash: u64, state: &GoalState| hash.rotate_left(5) ^ (*state as u64 + 1);
        self.goals.iter().fold(self.world.state_hash(), fold)
    }

    fn observation(&self, senses: Senses, feedback: Feedback) -> Observation {
        let (rgb, depth) = senses.frame.map(|frame| (frame.rgb, frame.depth)).unzip();
        Observation {
            step: self.steps(),
            rgb: rgb.filter(|_| self.sensors.rgb),
            depth: depth.filter(|_| self.sensors.depth).map(|depth| scaled(depth, self.rules.depth_divisor)),
            audio: senses.audio.map(|audio| padded(&audio, self.rules.audio_samples as usize)),
            pose: self.told_pose(),
            remaining_steps: self.rules.max_steps.saturating_sub(self.steps()),
            remaining_submits: self.submit_limit().saturating_sub(self.submits_used),
            feedback,
        }
    }

    fn told_pose(&self) -> Pose {
        let pose = self.world.pose();
        match self.rules.pose_frame {
            PoseFrame::Start => pose.relative_to(&self.truth.start),
            PoseFrame::World => pose,
        }
    }
}

fn motion_of(action: Action) -> Motion {
    match action {
        Action::MoveForward => Motion::Forward,
        Action::TurnLeft => Motion::Left,
        Action::TurnRight => Motion::Right,
        Action::Submit | Action::Stop => Motion::Stay,
    }
}

fn world_options(rules: &Rules, sensors: &Sensors) -> WorldOptions {
    let view = View { width: sensors.width, height: sensors.height, hfov_rad: sensors.hfov_rad };
    WorldOptions {
        forward_m: rules.forward_m,
        turn_deg: rules.turn_deg,
        camera_height_m: rules.camera_height_m,
        ear_height_m: rules.ear_height_m,
        depth_max_m: rules.depth_max_m,
        samples_per_step: rules.samples_per_step() as usize,
        view: (sensors.rgb || sensors.depth).then_some(view),
        audio: sensors.audio,
        head: Head::default(),
        noise: Noise::default(),
    }
}

fn noise(rules: &Rules, seed: u64) -> Noise {
    let depth = match rules.depth_noise {
        episode::DepthNoise::None => DepthNoise::None,
        episode::DepthNoise::Redwood => DepthNoise::Redwood,
    };
    let rgb = match rules.rgb_noise {
        episode::RgbNoise::None => RgbNoise::None,
        episode::RgbNoise::Gaussian => RgbNoise::Gaussian,
    };
    Noise { depth, rgb, seed }
}

fn scaled(mut depth: Vec<f32>, divisor: f32) -> Vec<f32> {
    if divisor != 1.0 {
        depth.iter_mut().for_each(|metres| *metres /= divisor);
    }
    depth
}

/// Each ear's samples followed by silence up to `length`.
fn padded(audio: &[f32], length: usize) -> Vec<f32> {
    let samples = audio.len() / Sensors::AUDIO_CHANNELS as usize;
    let mut out = vec![0.0; length.max(samples) * Sensors::AUDIO_CHANNELS as usize];
    for (ear, heard) in out.chunks_mut(length.max(samples)).zip(audio.chunks(samples.max(1))) {
        ear[..heard.len()].copy_from_slice(heard);
    }
    out
}
