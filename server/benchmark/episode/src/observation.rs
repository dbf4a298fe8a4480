use crate::Encodings;
use avln_geom::Pose;
use serde::{Deserialize, Serialize};

/// What the agent's sensors deliver after one step. Sensors that were not asked for are `None`.
#[derive(Clone, Debug, PartialEq)]
pub struct Observation {
    /// Steps taken so far; 0 is the observation before the first action.
    pub step: u32,
    /// `height × width × 3` bytes, row-major from the top-left pixel, RGB.
    pub rgb: Option<Vec<u8>>,
    /// `height × width` metres along the optical axis, row-major from the top-left pixel;
    /// 0 where nothing was hit within the range.
    pub depth: Option<Vec<f32>>,
    /// `2 × samples_per_step`: the left ear's samples, then the right ear's.
    pub audio: Option<Vec<f32>>,
    /// Base of the body, in the frame that the rules name.
    pub pose: Pose,
    /// Steps that are left, this one taken off.
    pub remaining_steps: u32,
    /// Submits that are left before one is final.
    pub remaining_submits: u32,
    /// What the rules let the agent know about a Submit made in this step.
    pub feedback: Feedback,
}

/// What the agent learns from a Submit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Feedback {
    /// Nothing: no Submit was made, or the rules are silent.
    #[default]
    None,
    /// The Submit was counted; nothing is said about the match.
    Accepted,
    /// Whether the Submit completed a goal.
    Verdict(bool),
}

/// Which sensors an agent asks for, and how they are set up.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sensors {
    /// Whether colour pictures are rendered and sent.
    pub rgb: bool,
    /// Whether depth pictures are rendered and sent.
    pub depth: bool,
    /// Whether sound is rendered and sent.
    pub audio: bool,
    /// Pixels in a row, 64 to 1024.
    pub width: u32,
    /// Rows, 64 to 1024.
    pub height: u32,
    /// Horizontal field of view, radians.
    pub hfov_rad: f32,
    /// How the numbers travel. In a phase's sensors: an encoding that changes values may be asked for where one stands here.
    #[serde(default)]
    pub encodings: Encodings,
}

/// A wish for sensors that the limits do not allow.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SensorsError {
    /// The picture's size is outside of the limits.
    #[error("camera of {width} x {height} pixels is outside of {min} to {max} a side; ask for another size", min = Sensors::MIN_SIDE, max = Sensors::MAX_SIDE)]
    Size {
        /// Pixels in a row, as asked.
        width: u32,
        /// Rows, as asked.
        height: u32,
    },
    /// The field of view is outside of the limits.
    #[error("hfov of {hfov_rad} rad is outside of 0.35 to 2.4 rad (20 to 137 degrees); ask for another")]
    FieldOfView {
        /// Radians, as asked.
        hfov_rad: f32,
    },
}

impl Sensors {
    /// Fewest pixels a side.
    pub const MIN_SIDE: u32 = 64;
    /// Most pixels a side.
    pub const MAX_SIDE: u32 = 1024;
    /// Samples a second of the audio sensor.
    pub const SAMPLE_RATE_HZ: u32 = 16_000;
    /// Ears.
    pub const AUDIO_CHANNELS: u32 = 2;

    /// All sensors at `width × height` with 90 degrees of view.
    pub fn all(width: u32, height: u32) -> Self {
        let hfov_rad = std::f32::consts::FRAC_PI_2;
        let encodings = Encodings::default();
        Self { rgb: true, depth: true, audio: true, width, height, hfov_rad, encodings }
    }

    /// Checks the limits.
    ///
    /// # Errors
    /// When the size or the field of view is outside of them.
    pub fn validate(&self) -> Result<(), SensorsError> {
        let side = Self::MIN_SIDE..=Self::MAX_SIDE;
        if !side.contains(&self.width) || !side.contains(&self.height) {
            return Err(SensorsError::Size { width: self.width, height: self.height });
        }
        if !(0.35..=2.4).contains(&self.hfov_rad) {
            return Err(SensorsError::FieldOfView { hfov_rad: self.hfov_rad });
        }
        Ok(())
    }
}

/// Why an episode ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EndReason {
    /// The agent chose Stop.
    Stopped,
    /// The agent used its last Submit.
    FinalSubmit,
    /// The agent took as many steps as the rules allow.
    StepLimit,
    /// The agent thought for longer than its time allowed, or the wall time of its run was over.
    TimeBudget,
    /// The agent gave the episode up.
    Abandoned,
    /// The agent went away and did not come back in time.
    Disconnected,
    /// The server failed; the episode does not count.
    ServerFault,
}

impl EndReason {
    /// All reasons.
    pub const ALL: [Self; 7] = [
        Self::Stopped,
        Self::FinalSubmit,
        Self::StepLimit,
        Self::TimeBudget,
        Self::Abandoned,
        Self::Disconnected,
        Self::ServerFault,
    ];

    /// Whether the task itself defines this end; otherwise the episode was truncated.
    pub fn is_terminated(self) -> bool {
        matches!(self, Self::Stopped | Self::FinalSubmit)
    }

    /// The word used in files and URLs.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Stopped => "stopped",
            Self::FinalSubmit => "final_submit",
            Self::StepLimit => "step_limit",
            Self::TimeBudget => "time_budget",
            Self::Abandoned => "abandoned",
            Self::Disconnected => "disconnected",
            Self::ServerFault => "server_fault",
        }
    }
}
