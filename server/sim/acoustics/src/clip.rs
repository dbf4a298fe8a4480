//! Sound clips: synthesised, with equal bits on every machine, or from recordings.
//!
//! Every synthesised clip is localisable: broadband, with several onsets per second and no long gap. All
//! clips are equally loud, so that level depends on distance only.

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

/// A seamless sound loop.
#[derive(Clone, Debug, PartialEq)]
pub struct Clip {
    /// Family and number, `pink-bursts-0`, or the name of a recording.
    pub name: String,
    /// Pressure at 1 m, mono, at [`SAMPLE_RATE_HZ`](crate::SAMPLE_RATE_HZ); the first sample follows the
    /// last.
    pub samples: Arc<[f32]>,
}

#[cfg(test)]
mod tests;
