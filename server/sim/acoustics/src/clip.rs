//! The sounds that sources play: made by rule, the same on every machine, or taken from recordings.
//!
//! Every clip that is made can be placed by ear: broadband, with several onsets a second and no long gap. All are
//! equally loud, so that level tells distance and nothing else.

use std::sync::Arc;

mod bank;
mod families;
mod finish;
mod loudness;
mod made;
mod recording;
mod resample;
mod synth;
mod tones;

pub use bank::{Bank, ClipPool};
pub use recording::RecordingError;

/// A sound that repeats without a seam.
#[derive(Clone, Debug, PartialEq)]
pub struct Clip {
    /// Family and number, `pink-bursts-0`, or the name of a recording.
    pub name: String,
    /// Pressure at 1 m, mono, at [`SAMPLE_RATE_HZ`](crate::SAMPLE_RATE_HZ); the last sample is followed by the first.
    pub samples: Arc<[f32]>,
}

#[cfg(test)]
mod tests;
