//! Observations, sensors and end reasons.

use avln_geom::Pose;
use serde::{Deserialize, Serialize};
use std::{fmt, str::FromStr};

/// Sensor data after a step. Sensors without a subscription are `None`.
#[derive(Clone, Debug, PartialEq)]
pub struct Observation {
    /// Steps taken; 0 before the first action.
    pub step: u32,
    /// `height × width × 3` bytes, row-major from the top-left pixel, RGB.
    pub rgb: Option<Vec<u8>>,
    /// `height × width` metres along the optical axis, row-major from the top-left pixel; 0 for no hit within range.
    pub depth: Option<Vec<f32>>,
    /// `2 × samples_per_step`: left ear, then right ear.
    pub audio: Option<Vec<f32>>,
    /// Base pose in the frame set by the rules.
    pub pose: Pose,
    /// Remaining steps after this one.
    pub remaining_steps: u32,
    /// Remaining Submits before a final one.
    pub remaining_submits: u32,
    /// Feedback to a Submit in this step, as far as the rules allow.
    pub feedback: Feedback,
}

/// Feedback to a Submit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Feedback {
    /// No Submit in this step, or no feedback by the rules.
    #[default]
    None,
    /// The Submit was counted; the result is hidden.
    Accepted,
    /// True if the Submit completed a goal.
    Verdict(bool),
}

/// An agent's sensor subscription.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Sensors {
    /// Enables colour pictures.
    pub rgb: bool,
    /// Enables depth pictures.
    pub depth: bool,
    /// Enables sound.
    pub audio: bool,
    /// Pixels per row, 64 to 1024.
    pub width: u32,
    /// Rows, 64 to 1024.
    pub height: u32,
    /// Horizontal view angle, radians.
    pub hfov_rad: f32,
    /// Encodings. In phase sensors, a lossy encoding permits agents to request it.
    // Databases of earlier versions contain sensors without encodings.
    #[serde(default)]
    pub encodings: Encodings,
}

/// Sensor subscription outside the limits.
#[expect(missing_docs, reason = "the messages explain the fields")]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SensorsError {
    /// Picture size outside the limits.
    #[error("a camera with {width} x {height} pixels is outside the limits of {min} to {max} per side; request another size", min = Sensors::MIN_SIDE, max = Sensors::MAX_SIDE)]
    Size { width: u32, height: u32 },
    /// Field of view outside the limits.
    #[error(
        "hfov {hfov_rad} rad is outside the limits of 0.35 to 2.4 rad (20 to 137 degrees); request another"
    )]
    FieldOfView { hfov_rad: f32 },
}

impl Sensors {
    /// Least pixels per side.
    pub const MIN_SIDE: u32 = 64;
    /// Most pixels per side.
    pub const MAX_SIDE: u32 = 1024;
    /// Audio sample rate.
    pub const SAMPLE_RATE_HZ: u32 = 16_000;
    /// Audio channels: two ears.
    pub const AUDIO_CHANNELS: u32 = 2;

    /// Returns all sensors at `width × height` with a 90 degree view.
    pub fn all(width: u32, height: u32) -> Self {
        let hfov_rad = std::f32::consts::FRAC_PI_2;
        let encodings = Encodings::default();
        Self { rgb: true, depth: true, audio: true, width, height, hfov_rad, encodings }
    }

    /// Returns whether picture size and kinds are within `most`, the limits of a phase.
    pub fn is_within(&self, most: &Self) -> bool {
        let fits = self.width <= most.width && self.height <= most.height;
        let kinds = [(self.rgb, most.rgb), (self.depth, most.depth), (self.audio, most.audio)];
        fits && kinds.into_iter().all(|(wanted, allowed)| allowed || !wanted)
    }

    /// Checks the limits.
    ///
    /// # Errors
    /// If the size or the field of view is outside the limits.
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

impl fmt::Display for Sensors {
    /// Writes size and kinds, like `600 x 600, RGB + DEPTH`; other view angles than 90 degrees, and encodings, follow.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} x {}", self.width, self.height)?;
        // Exactly, so that two subscriptions that differ look different.
        if self.hfov_rad.to_bits() != std::f32::consts::FRAC_PI_2.to_bits() {
            write!(f, ", hfov {} rad", self.hfov_rad)?;
        }
        let Encodings { rgb, depth, audio } = self.encodings;
        let kinds = [(self.rgb, "RGB", rgb), (self.depth, "DEPTH", depth), (self.audio, "AUDIO", audio)];
        let mut separator = ", ";
        for (_, name, encoding) in kinds.into_iter().filter(|(wanted, ..)| *wanted) {
            write!(f, "{separator}{name}")?;
            if encoding != Encoding::Raw {
                write!(f, " ({})", encoding.as_str())?;
            }
            separator = " + ";
        }
        if separator == ", " { f.write_str(", pose only") } else { Ok(()) }
    }
}

/// An episode's end reason.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum EndReason {
    /// The agent chose Stop.
    Stopped,
    /// The agent used its last Submit.
    FinalSubmit,
    /// The agent reached the step limit.
    StepLimit,
    /// The agent exceeded its thinking time, or the run its wall time.
    TimeBudget,
    /// The agent abandoned the episode.
    Abandoned,
    /// The agent disconnected and did not return in time.
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

    /// Returns whether the task defines this end; otherwise the episode was truncated.
    pub fn is_terminated(self) -> bool {
        matches!(self, Self::Stopped | Self::FinalSubmit)
    }

    /// Returns the name in files and URLs.
    pub fn as_str(self) -> &'static str {
        match self {
            // Databases and run logs contain these words, so they never change.
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

impl FromStr for EndReason {
    type Err = UnknownEndReason;

    fn from_str(word: &str) -> Result<Self, UnknownEndReason> {
        let found = Self::ALL.into_iter().find(|reason| reason.as_str() == word);
        found.ok_or_else(|| UnknownEndReason(word.to_owned()))
    }
}

/// Unknown end reason.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("end reason '{0}' does not exist")]
pub struct UnknownEndReason(pub String);

/// Sensor value encoding for transport.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Encoding {
    /// Uncompressed.
    #[default]
    Raw,
    /// Compressed prediction residuals, lossless.
    Packed,
    /// PNG file, lossless.
    Png,
    /// QOI file, lossless.
    Qoi,
    /// Depth in integer millimetres.
    Millimetres,
    /// Depth in integer millimetres, compressed.
    PackedMillimetres,
    /// Sound as 16-bit integers.
    Int16,
}

impl Encoding {
    /// Returns whether the encoding is lossless.
    pub fn is_lossless(self) -> bool {
        match self {
            Self::Raw | Self::Packed | Self::Png | Self::Qoi => true,
            Self::Millimetres | Self::PackedMillimetres | Self::Int16 => false,
        }
    }

    /// Returns the display name.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Raw => "raw",
            Self::Packed => "packed",
            Self::Png => "PNG",
            Self::Qoi => "QOI",
            Self::Millimetres => "whole millimetres",
            Self::PackedMillimetres => "whole millimetres, packed",
            Self::Int16 => "16-bit samples",
        }
    }
}

/// Encodings per sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Encodings {
    /// Colours.
    pub rgb: Encoding,
    /// Distances.
    pub depth: Encoding,
    /// Sound.
    pub audio: Encoding,
}

impl Encodings {
    /// Returns whether all encodings are lossless.
    pub fn are_lossless(&self) -> bool {
        [self.rgb, self.depth, self.audio].into_iter().all(Encoding::is_lossless)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sensors_are_written_with_their_differences() {
        let mut sensors = Sensors { audio: false, ..Sensors::all(600, 480) };
        assert_eq!(sensors.to_string(), "600 x 480, RGB + DEPTH");
        sensors.hfov_rad = 1.2;
        sensors.encodings.depth = Encoding::Packed;
        assert_eq!(sensors.to_string(), "600 x 480, hfov 1.2 rad, RGB + DEPTH (packed)");
        let blind = Sensors { rgb: false, depth: false, audio: false, ..Sensors::all(64, 64) };
        assert_eq!(blind.to_string(), "64 x 64, pose only");
    }

    #[test]
    fn phase_limits_apply_to_size_and_kinds() {
        let most = Sensors { audio: false, ..Sensors::all(512, 256) };
        assert!(most.is_within(&most));
        assert!(Sensors { rgb: false, hfov_rad: 2.0, ..most.clone() }.is_within(&most));
        assert!(!Sensors { width: 513, ..most.clone() }.is_within(&most));
        assert!(!Sensors { height: 257, ..most.clone() }.is_within(&most));
        assert!(!Sensors { audio: true, ..most.clone() }.is_within(&most));
    }

    #[test]
    fn stored_sensors_without_encodings_are_raw() {
        let stored = r#"{"rgb":true,"depth":false,"audio":true,"width":64,"height":64,"hfov_rad":1.5}"#;
        let sensors: Sensors = serde_json::from_str(stored).unwrap();
        assert_eq!(sensors.encodings, Encodings::default());
        assert!(sensors.encodings.are_lossless());
        let rounded = Encodings { depth: Encoding::Millimetres, ..Encodings::default() };
        let again: Encodings = serde_json::from_str(&serde_json::to_string(&rounded).unwrap()).unwrap();
        assert_eq!(again, rounded);
        assert!(!again.are_lossless());
    }
}
