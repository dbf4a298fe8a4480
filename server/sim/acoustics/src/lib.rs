//! Sound: propagation through a building, the ears of a listener, and the clips that sources play.
//!
//! Start reading at [`Acoustics`] (a building), [`Source`] (its cached answer for one place) and [`Ears`]
//! (what a listener hears, step by step). Everything that a source does to a listener is one impulse response
//! per ear and pose ([`ImpulseResponse`]); whatever else reaches the ears only adds taps to it.
//!
//! *Never*: pans, normalises, reads files or clocks, or knows which source is a goal. Equal inputs give equal bits.

mod air;
mod bands;
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
mod settings;
mod shelf;
mod source;
mod sphere;
mod stored;
mod surfaces;
mod taut;
#[cfg(test)]
mod testing;
mod transform;
mod visibility;
mod ways;

pub use clip::{Bank, Clip, ClipPool, RecordingError};
pub use ears::{Ears, Emitter, Listener};
pub use head::{Head, HeadError, MeasuredHead};
pub use impulse::ImpulseResponse;
pub use measure::{BandMeasures, Measures, expected_reverberation_s, interaural_delay_s};
pub use settings::Settings;
pub use shelf::{SoundPlace, SoundShelf};
pub use source::{Acoustics, FirstWave, Source};
pub use surfaces::{SURFACE_BANDS, Surface, SurfaceError, Surfaces};

/// Samples a second of everything that is heard.
pub const SAMPLE_RATE_HZ: u32 = 16_000;

/// Speed of sound in air of 20 degrees Celsius, metres a second.
pub const SPEED_OF_SOUND_M_S: f32 = 343.0;
