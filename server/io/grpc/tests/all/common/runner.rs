use avln_episode::{
    Action, EndReason, Feedback, GoalCue, Mission, Observation, Order, Point3, Pose, RgbImage, Rules, Sensors,
};
use avln_grpc::Episode;
use avln_referee::{RefereeError, StepOutcome};
use std::sync::mpsc;

/// Oddity of an episode.
pub(crate) enum Quirk {
    None,
    /// The simulator panics when the agent submits.
    Fragile,
    /// The simulator panics at the start.
    Stillborn,
    /// A step lasts until the test sends a message.
    Slow(mpsc::Receiver<()>),
    /// The first observation lasts until the test sends a message.
    SlowStart(mpsc::Receiver<()>),
}

/// A world of one number: the count of forward steps.
pub(crate) struct ToyRunner {
    mission: Mission,
    rules: Rules,
    sensors: Sensors,
    quirk: Quirk,
    walked: u32,
    steps: u32,
    end: Option<EndReason>,
}

impl ToyRunner {
    pub(crate) fn new(max_steps: u32, sensors: Sensors, quirk: Quirk) -> Self {
        let picture = RgbImage { width: 2, height: 2, pixels: (0..12).collect() };
        let goals = vec![
            GoalCue::Category("chair".into()),
            GoalCue::Description("the lamp by the bed".into()),
            GoalCue::Image(picture),
        ];
        let rules = Rules { max_steps, ..Rules::paper() };
        let mission = Mission { order: Order::Unordered, goals };
        Self { mission, rules, sensors, quirk, walked: 0, steps: 0, end: None }
    }

    fn sense(&self) -> Observation {
        let pixels = (self.sensors.width * self.sensors.height) as usize;
        let value = self.steps as f32;
        Observation {
            step: self.steps,
            rgb: self.sensors.rgb.then(|| vec![self.steps as u8; pixels * 3]),
            depth: self.sensors.depth.then(|| vec![value; pixels]),
            audio: self.sensors.audio.then(|| vec![value / 100.0; 2 * self.rules.audio_samples as usize]),
            pose: Pose { position: Point3::new(0.0, 0.0, self.walked as f32 * -0.25), heading_rad: 0.0 },
            remaining_steps: self.rules.max_steps - self.steps,
            remaining_submits: 2,
            feedback: Feedback::None,
        }
    }
}

impl Episode for ToyRunner {
    fn mission(&self) -> &Mission {
        &self.mission
    }
    fn rules(&self) -> &Rules {
        &self.rules
    }
    fn start(&mut self) -> Observation {
        assert!(!matches!(self.quirk, Quirk::Stillborn), "the secret of this episode");
        if let Quirk::SlowStart(release) = &self.quirk {
            let _ = release.recv();
        }
        self.sense()
    }
    fn step(&mut self, action: Action) -> Result<StepOutcome, RefereeError> {
        if let Quirk::Slow(release) = &self.quirk {
            release.recv().expect("the test releases the step");
        }
        if matches!(self.quirk, Quirk::Fragile) && action == Action::Submit {
            panic!("the secret of this episode");
        }
        self.steps += 1;
        self.walked += u32::from(action == Action::MoveForward);
        if action == Action::Stop {
            self.end = Some(EndReason::Stopped);
        } else if self.steps >= self.rules.max_steps {
            self.end = Some(EndReason::StepLimit);
        }
        Ok(StepOutcome { observation: self.sense(), end: self.end })
    }
    fn truncate(&mut self, reason: EndReason) {
        self.end.get_or_insert(reason);
    }
    fn end(&self) -> Option<EndReason> {
        self.end
    }
    fn steps(&self) -> u32 {
        self.steps
    }
    fn state_hash(&self) -> u64 {
        u64::from(self.steps) << 32 | u64::from(self.walked)
    }
}
