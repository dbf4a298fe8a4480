//! The referee.

use crate::{
    Audio, RefereeError, StepOutcome,
    rules::{Schedule, SuccessTest, motion_of, noise, padded, scaled, world_options},
    sounds,
};
use avln_episode::{
    Action, EndReason, ExtraSubmit, Feedback, FeedbackRule, GoalCue, Mission, Observation, Order, PoseFrame,
    Rules, Sensors, StopClaims, WrongSubmit,
};
use avln_truth::{EpisodeTruth, Record, StepFacts, SubmitFacts};
use avln_world::{
    Detail, InstanceId, Motion, NavPoint, Point3, Rng, SceneAssets, Senses, World, WorldOptions,
};
use std::sync::Arc;

/// Referee for an episode: applies the rules to a world, from the first observation to the sealed record. Every step simulates
/// motion, images and sound on the calling thread.
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
    /// Submits beyond the rules, for training.
    added_submits: u32,
    /// Instances in the last image; `None` unless requested.
    instances: Option<Vec<InstanceId>>,
    first: Option<Observation>,
    /// Sounding source: targets, then distractors.
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

impl Referee {
    /// Most goals per mission: the record has one bit per goal.
    const MAX_GOALS: usize = 8;

    /// Places the body at the start pose, without rendering.
    ///
    /// # Errors
    /// If sensors, mission or start pose are invalid, or there are too few clips or distractor sources.
    pub fn new(
        assets: Arc<SceneAssets>,
        mission: Mission,
        mut truth: EpisodeTruth,
        rules: Rules,
        sensors: Sensors,
        audio: &Audio,
    ) -> Result<Self, RefereeError> {
        sensors.validate()?;
        let (goals, targets) = (mission.goals.len(), truth.targets.len());
        if goals != targets || !(1..=Self::MAX_GOALS).contains(&goals) {
            return Err(RefereeError::Mismatch { episode: truth.episode, goals, targets });
        }
        set_distractors(&mut truth, &rules)?;
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
            added_submits: 0,
            instances: None,
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

    /// Returns the mission.
    pub fn mission(&self) -> &Mission {
        &self.mission
    }

    /// Returns the rules.
    pub fn rules(&self) -> &Rules {
        &self.rules
    }

    /// Returns the subscribed sensors.
    pub fn sensors(&self) -> &Sensors {
        &self.sensors
    }

    /// Returns the sounding source in the last observation: a goal, or the goal count plus a distractor's index; `None` for
    /// silence. Hidden from agents.
    pub fn sounding(&self) -> Option<usize> {
        self.sounding
    }

    /// Returns the position of the sounding source in the last observation, world frame. Hidden from agents.
    pub fn sounding_position(&self) -> Option<Point3<f32>> {
        sounds::episode_sources(&self.rules, &self.truth).get(self.sounding?).copied()
    }

    /// Returns the remaining Submits, as in observations.
    pub fn remaining_submits(&self) -> u32 {
        self.submit_limit().saturating_sub(self.submits_used)
    }

    /// Returns per goal whether it is still open. Hidden from agents.
    pub fn is_open(&self) -> Vec<bool> {
        self.goals.iter().map(|&state| state == GoalState::Open).collect()
    }

    /// Returns per goal whether it is found; a skipped goal is neither open nor found. Hidden from agents.
    pub fn is_found(&self) -> Vec<bool> {
        self.goals.iter().map(|&state| state == GoalState::Found).collect()
    }

    /// Returns the facts about all steps so far. Hidden from agents.
    pub fn facts(&self) -> &[StepFacts] {
        &self.steps
    }

    /// Returns the walking distance from the body to a goal's success region, metres; `None` if unreachable. Hidden from agents.
    pub fn walk_m(&self, goal: usize) -> Option<f64> {
        self.success.walk_m(&self.world, goal)
    }

    /// Returns the walking distance from a point to a goal's success region, metres. Hidden from agents.
    pub fn walk_from_m(&self, point: &NavPoint, goal: usize) -> Option<f64> {
        self.success.walk_from_m(self.world.assets(), point, goal)
    }

    /// Returns the corners of the shortest way from the body to a goal's success region, world frame. Hidden from agents.
    pub fn walk(&self, goal: usize) -> Option<Vec<Point3<f32>>> {
        self.success.walk(&self.world, goal)
    }

    /// Returns true if the body is in a goal's success region. Hidden from agents.
    pub fn is_in_region(&self, goal: usize) -> bool {
        self.distance_within(goal).is_some()
    }

    /// Returns the world with the body. Hidden from agents.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// Returns the end reason, if the episode has ended.
    pub fn end(&self) -> Option<EndReason> {
        self.end
    }

    /// Returns the episode's largest memory use in bytes, without the scene: audio state, goal pictures, step facts.
    pub fn most_bytes(&self) -> usize {
        let picture = |cue: &GoalCue| match cue {
            GoalCue::Image(image) => image.pixels.len(),
            GoalCue::Category(_) | GoalCue::Description(_) => 0,
        };
        let pictures: usize = self.mission.goals.iter().map(picture).sum();
        self.world.most_bytes() + pictures + self.rules.max_steps as usize * size_of::<StepFacts>()
    }

    /// Returns the step count.
    pub fn steps(&self) -> u32 {
        self.steps.len() as u32
    }

    /// Returns the first observation; repeated calls return the same one.
    pub fn start(&mut self) -> Observation {
        if let Some(first) = &self.first {
            return first.clone();
        }
        self.sounding = self.schedule.next(&self.found(), false);
        let senses = self.sense();
        let first = self.observation(senses, Feedback::None);
        self.first = Some(first.clone());
        first
    }

    /// Performs an action.
    ///
    /// # Errors
    /// If the episode has ended.
    pub fn step(&mut self, action: Action) -> Result<StepOutcome, RefereeError> {
        let feedback = self.act(action)?;
        let senses = self.sense();
        Ok(StepOutcome { observation: self.observation(senses, feedback), end: self.end })
    }

    fn sense(&mut self) -> Senses {
        let mut senses = self.world.sense(self.sounding);
        if let (Some(kept), Some(frame)) = (&mut self.instances, &mut senses.frame) {
            *kept = std::mem::take(&mut frame.instances);
        }
        senses
    }

    /// Repeats an interrupted episode's actions with recorded state hashes, and returns the outcome of the last action. Only its
    /// picture is rendered.
    ///
    /// # Errors
    /// If a state differs from the record, or the episode ends before the last action.
    pub fn replay(&mut self, taken: &[(Action, u64)]) -> Result<Option<StepOutcome>, RefereeError> {
        let Some((&(last, after), before)) = taken.split_last() else { return Ok(None) };
        for &(action, state_hash) in before {
            self.act(action)?;
            // Sound has a memory, the reverberation, so it is rendered in every step. Pictures have none.
            self.world.hear(self.sounding);
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

    /// Moves the body and applies the rules. The caller must sense exactly once afterwards.
    fn act(&mut self, action: Action) -> Result<Feedback, RefereeError> {
        if let Some(reason) = self.end {
            return Err(RefereeError::Over { reason, steps: self.steps() });
        }
        if self.first.is_none() {
            self.start();
        }
        let motion = motion_of(action);
        let moved = self.world.advance(motion);
        let feedback = match action {
            Action::Submit if self.is_ignored() => Feedback::None,
            Action::Submit | Action::Stop => self.submit(action),
            _ => Feedback::None,
        };
        self.sounding = self.schedule.next(&self.found(), motion != Motion::Stay);
        self.steps.push(StepFacts {
            action,
            pose: self.world.pose(),
            collided: moved.collided,
            in_region: self.regions_entered(),
            sounding: self.sounding.map(|goal| goal as u8),
            state_hash: self.state_hash(),
        });
        if self.end.is_none() && self.steps() >= self.rules.max_steps {
            self.end = Some(EndReason::StepLimit);
        }
        Ok(feedback)
    }

    /// Ends the episode from outside. No effect after the end.
    pub fn truncate(&mut self, reason: EndReason) {
        self.end.get_or_insert(reason);
    }

    /// Returns truth and record. A running episode ends as abandoned.
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

    /// Evaluates a Submit or Stop at the current position.
    fn submit(&mut self, action: Action) -> Feedback {
        let completed = self.matching_goal(action);
        // Also after a right Submit, so that the time does not reveal the result. Before a goal is found or skipped: the fact is
        // about the goal claimed now.
        let distractor = self.goal_of_a_distractor(action);
        // A claim that completes a goal is not wrong, even with a distractor nearby.
        let wrong_instance = if completed.is_some() { None } else { distractor };
        let mut skipped = None;
        if let Some(goal) = completed {
            self.goals[goal] = GoalState::Found;
        } else if self.mission.order == Order::Ordered && self.rules.wrong_submit == WrongSubmit::SkipsGoal {
            skipped = self.open_goals().next();
        }
        if let Some(goal) = skipped {
            self.goals[goal] = GoalState::Skipped;
        }
        // The paper allows N - 1 Submits and a Stop. The N-th Submit is ignored, or ends the episode and can complete a goal.
        let is_final = self.remaining_submits() == 0;
        if action == Action::Submit {
            self.submits_used += 1;
        }
        if action == Action::Stop {
            self.end = Some(EndReason::Stopped);
        } else if is_final {
            self.end = Some(EndReason::FinalSubmit);
        }
        let as_goal = |goal: usize| goal as u8;
        self.submits.push(SubmitFacts {
            step: self.steps() + 1,
            completed: completed.map(as_goal),
            skipped: skipped.map(as_goal),
            wrong_instance: wrong_instance.map(as_goal),
        });
        match self.rules.feedback {
            FeedbackRule::None => Feedback::None,
            FeedbackRule::Accepted => Feedback::Accepted,
            FeedbackRule::Verdict => Feedback::Verdict(completed.is_some()),
        }
    }

    /// Returns true if a Submit now is not judged.
    fn is_ignored(&self) -> bool {
        self.rules.extra_submit == ExtraSubmit::Ignored && self.remaining_submits() == 0
    }

    /// Returns the goal that a claim completes here: the next one, or the nearest in an unordered mission.
    fn matching_goal(&self, action: Action) -> Option<usize> {
        self.claimable_goals(action)
            .filter_map(|goal| Some((self.distance_within(goal)?, goal)))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, goal)| goal)
    }

    /// Returns the first goal that would match with a distractor as target. Tests all goals, so that the time does not depend on
    /// the result.
    fn goal_of_a_distractor(&self, action: Action) -> Option<usize> {
        self.claimable_goals(action).fold(None, |first, goal| {
            let target = &self.truth.targets[goal];
            let is_there = SuccessTest::is_at_distractor(&self.world, target, &self.rules);
            first.or(is_there.then_some(goal))
        })
    }

    /// Returns the goals open to a claim: the next one, or all open ones in an unordered mission.
    fn claimable_goals(&self, action: Action) -> impl Iterator<Item = usize> {
        let claims_last_only = action == Action::Stop && self.rules.stop_claims == StopClaims::LastOnly;
        self.open_goals().take(match self.mission.order {
            _ if claims_last_only && self.open_goals().count() > 1 => 0,
            Order::Ordered => 1,
            Order::Unordered => self.goals.len(),
        })
    }

    fn open_goals(&self) -> impl Iterator<Item = usize> {
        self.goals.iter().enumerate().filter(|(_, state)| **state == GoalState::Open).map(|(goal, _)| goal)
    }

    fn submit_limit(&self) -> u32 {
        self.goals.len() as u32 - 1 + self.added_submits
    }

    fn distance_within(&self, goal: usize) -> Option<f64> {
        self.success.distance_within(&self.world, goal, &self.truth.targets[goal], &self.rules)
    }

    fn regions_entered(&self) -> u8 {
        let bit = |goal: usize| u8::from(self.distance_within(goal).is_some()) << goal;
        (0..self.goals.len()).fold(0, |bits, goal| bits | bit(goal))
    }

    /// Returns per goal whether it is found, so that its target falls silent by the rules.
    fn found(&self) -> Vec<bool> {
        self.goals.iter().map(|&state| state == GoalState::Found).collect()
    }

    /// Returns a hash over body and goal state. Episodes with equal hashes after every step are equal.
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
            pose: match self.rules.pose_frame {
                PoseFrame::Start => self.world.pose().relative_to(&self.truth.start),
                PoseFrame::World => self.world.pose(),
            },
            remaining_steps: self.rules.max_steps.saturating_sub(self.steps()),
            remaining_submits: self.remaining_submits(),
            feedback,
        }
    }
}

/// Additions for training in process. No server uses them.
impl Referee {
    /// Adds Submits to those of the rules. For training only: scores of such episodes are not comparable.
    #[must_use]
    pub fn with_added_submits(self, added_submits: u32) -> Self {
        Self { added_submits, ..self }
    }

    /// Sets the detail of images. For training only: servers send exact images.
    #[must_use]
    pub fn with_detail(mut self, detail: Detail) -> Self {
        self.world.set_detail(detail);
        self
    }

    /// Stores the instances in images, for training.
    #[must_use]
    pub fn with_instances(self) -> Self {
        Self { instances: Some(Vec::new()), ..self }
    }

    /// Returns the instances in the last image, row-major; `None` without [`Self::with_instances`], empty without an image.
    /// Hidden from agents.
    pub fn instances(&self) -> Option<&[InstanceId]> {
        self.instances.as_deref()
    }

    /// Returns the goal that a Submit or Stop would complete now. Hidden from agents.
    pub fn completes(&self, action: Action) -> Option<usize> {
        match action {
            Action::Submit if self.is_ignored() => None,
            Action::Submit | Action::Stop => self.matching_goal(action),
            _ => None,
        }
    }
}

/// Keeps the distractor sources required by the rules.
fn set_distractors(truth: &mut EpisodeTruth, rules: &Rules) -> Result<(), RefereeError> {
    let needed = rules.distractor_sources.count(truth.targets.len());
    let found = truth.distractor_sources.len();
    if found < needed {
        let (episode, rules) = (truth.episode.clone(), rules.name.clone());
        return Err(RefereeError::Distractors { episode, rules, needed, found });
    }
    truth.distractor_sources.truncate(needed);
    Ok(())
}
