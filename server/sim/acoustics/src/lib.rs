//! Sound: propagation through a building, the ears of a listener, and sound clips.
//!
//! Start reading at [`Acoustics`] (a building), [`Source`] (cached acoustics of a position) and [`Ears`] (the
//! received signal, step by step). The effect of a source on a listener is an impulse response per ear and
//! pose ([`ImpulseResponse`]); every further propagation effect adds taps to it.
//!
//! *Never*: pans, normalises, reads files or clocks, or depends on goals. Equal inputs give equal bits.

mod air;
mod bands;
mod building;
mod cache;
mod clip;
mod convolver;
mod ears;
mod geodesic;
mod head;
mod images;
mod impulse;
mod late;
mod measure;
mod planes;
mod source;
mod surfaces;
mod transform;
mod unreflected;

pub use building::Settings;
pub use cache::{BuildingCache, SoundCache};
pub use clip::{Bank, Clip, ClipPool, RecordingError};
pub use ears::{Ears, Emitter};
pub use head::{Head, HeadError, MeasuredHead};
pub use impulse::{ImpulseResponse, Listener};
pub use measure::{BandMeasures, Measures, expected_reverberation_s, interaural_delay_s};
pub use source::{Acoustics, FirstWave, Source};
pub use surfaces::{SURFACE_BANDS, Surface, SurfaceError, Surfaces};

/// Sample rate of all signals, hertz.
pub const SAMPLE_RATE_HZ: u32 = 16_000;

/// Speed of sound in air of 20 degrees Celsius, metres per second.
pub const SPEED_OF_SOUND_M_S: f32 = 343.0;

#[cfg(test)]
mod tests;
