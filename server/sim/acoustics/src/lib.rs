//! Sound propagation through a building, ears and sound clips.
//!
//! Entry points: [`Acoustics`] (a building), [`Source`] (precomputed paths from a position) and [`Ears`]
//! (signals per step). A source reaches an ear through an [`ImpulseResponse`]; every propagation effect adds
//! taps to it.
//!
//! The crate never pans, normalises, or reads files and clocks. Equal inputs give equal bits.

mod air;
mod bands;
mod building;
mod clip;
mod ears;
mod geodesic;
mod head;
mod images;
mod impulse;
mod late;
mod measure;
mod meter;
mod planes;
mod source;
mod surfaces;
mod transform;
mod unreflected;

pub use building::{BuildingCache, Settings, SoundCache};
pub use clip::{Bank, Clip, ClipPool, RecordingError};
pub use ears::{Ears, Emitter};
pub use head::{Head, HeadError, MeasuredHead};
pub use impulse::{ImpulseResponse, Listener};
pub use measure::{BandMeasures, Measures, expected_reverberation_s, interaural_delay_s};
pub use meter::{ClipLevels, FirstSound, HeardLevels, LEVEL_BANDS, LevelMeter};
pub use source::{Acoustics, FirstWave, Source};
pub use surfaces::{SURFACE_BANDS, Surface, SurfaceError, Surfaces};

/// Sample rate of all signals, hertz.
pub const SAMPLE_RATE_HZ: u32 = 16_000;

/// Speed of sound in air at 20 degrees Celsius, metres per second.
pub const SPEED_OF_SOUND_M_S: f32 = 343.0;

#[cfg(test)]
mod tests;
