//! Tensor encodings.
//!
//! Start at [`offered`], then read [`rgb`], [`depth`] and [`audio`]. `PROTOCOL.md` defines the layouts byte by byte.
//!
//! | encoding | sensor | decoded values |
//! |---|---|---|
//! | `RAW` | all | exact |
//! | `PACKED` | colour, depth | exact |
//! | `PNG`, `QOI` | colour | exact |
//! | `DEPTH_U16_MM`, `DEPTH_U16_MM_PACKED` | depth | rounded to a millimetre |
//! | `AUDIO_I16` | sound | rounded to one part in 32767 |
//!
//! Decoders never allocate more than the agreed size and never panic on foreign bytes. Results do not depend
//! on the processor, since predictions use only additions, multiplications and divisions with IEEE 754
//! rounding.

mod blocks;
pub mod depth;
pub mod rgb;

pub use crate::v1::{Encoding, SensorKind};
use bytes::Bytes;

/// Picture size, pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl Size {
    /// Returns the pixel count.
    pub fn pixels(self) -> usize {
        self.width as usize * self.height as usize
    }
}

/// Returns a sensor's encodings, best for a network first.
pub fn offered(kind: SensorKind) -> &'static [Encoding] {
    match kind {
        SensorKind::Rgb => &[Encoding::Packed, Encoding::Png, Encoding::Qoi, Encoding::Raw],
        SensorKind::Depth => {
            &[Encoding::Packed, Encoding::Raw, Encoding::DepthU16MmPacked, Encoding::DepthU16Mm]
        }
        SensorKind::Audio => &[Encoding::Raw, Encoding::AudioI16],
        SensorKind::Unspecified => &[],
    }
}

/// Returns whether decoded values are bit-identical.
pub fn is_lossless(encoding: Encoding) -> bool {
    matches!(encoding, Encoding::Raw | Encoding::Packed | Encoding::Png | Encoding::Qoi)
}

/// Returns an upper bound for `raw_bytes` in any encoding.
pub const fn most_bytes(raw_bytes: u64) -> u64 {
    raw_bytes / 3 * 4 + 1024
}

fn not_offered<T>(kind: SensorKind, encoding: Encoding) -> Result<T, CodecError> {
    Err(CodecError::NotOffered { kind, encoding })
}

/// Codec error.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CodecError {
    /// The sensor has no such encoding.
    #[error("{} is not an encoding of {}; use an encoding from `offered`", encoding.as_str_name(), kind.as_str_name())]
    NotOffered {
        /// Sensor.
        kind: SensorKind,
        /// Encoding.
        encoding: Encoding,
    },
    /// Wrong length.
    #[error("{what}: expected {expected} {unit}, got {found}")]
    Length {
        /// Data name.
        what: &'static str,
        /// Counted unit.
        unit: &'static str,
        /// Actual number.
        found: usize,
        /// Required number.
        expected: usize,
    },
    /// The bytes do not follow their encoding.
    #[error("invalid {}: {detail}", encoding.as_str_name())]
    Broken {
        /// Expected encoding.
        encoding: Encoding,
        /// Problem.
        detail: String,
    },
}

impl CodecError {
    pub(super) fn broken(encoding: Encoding, detail: impl ToString) -> Self {
        Self::Broken { encoding, detail: detail.to_string() }
    }

    pub(super) fn check_length(
        what: &'static str,
        unit: &'static str,
        found: usize,
        expected: usize,
    ) -> Result<(), Self> {
        if found == expected { Ok(()) } else { Err(Self::Length { what, unit, found, expected }) }
    }
}

/// Encodes values as `RAW`, little-endian.
pub fn raw_floats(values: Vec<f32>) -> Bytes {
    struct Owner(Vec<f32>);
    impl AsRef<[u8]> for Owner {
        fn as_ref(&self) -> &[u8] {
            bytemuck::cast_slice(&self.0)
        }
    }
    // Moved, not copied: an observation of 512 x 512 has a megabyte of depth.
    if cfg!(target_endian = "little") {
        return Bytes::from_owner(Owner(values));
    }
    copy_floats(&values)
}

fn copy_floats(values: &[f32]) -> Bytes {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// Decodes little-endian values; ignores an incomplete last value.
fn floats_from(bytes: &[u8]) -> Vec<f32> {
    let words = bytes.as_chunks().0;
    words.iter().map(|word| f32::from_le_bytes(*word)).collect()
}

/// Sound pressure: `2 × samples` values, left ear first.
pub mod audio {
    use super::{CodecError, Encoding, SensorKind, copy_floats, floats_from, not_offered};
    use bytes::Bytes;

    /// Integer for a pressure of 1.
    const FULL_SCALE: f32 = 32_767.0;

    /// Encodes both ears' samples. `AUDIO_I16` rounds to nearest and clamps to -1 to 1.
    ///
    /// # Errors
    /// If sound has no such encoding.
    pub fn encode(encoding: Encoding, samples: &[f32]) -> Result<Bytes, CodecError> {
        let whole = |sample: &f32| ((sample * FULL_SCALE).round() as i16).max(-i16::MAX);
        match encoding {
            Encoding::Raw => Ok(copy_floats(samples)),
            Encoding::AudioI16 => Ok(samples.iter().flat_map(|sample| whole(sample).to_le_bytes()).collect()),
            other => not_offered(SensorKind::Audio, other),
        }
    }

    /// Decodes `count` samples, counted over both ears.
    ///
    /// # Errors
    /// If `bytes` are not `count` samples in this encoding.
    pub fn decode(encoding: Encoding, count: usize, bytes: &[u8]) -> Result<Vec<f32>, CodecError> {
        let check = |each: usize| CodecError::check_length("sound", "bytes", bytes.len(), each * count);
        match encoding {
            Encoding::Raw => check(4).map(|()| floats_from(bytes)),
            Encoding::AudioI16 => {
                check(2)?;
                let words = bytes.as_chunks().0.iter();
                Ok(words.map(|word| f32::from(i16::from_le_bytes(*word)) / FULL_SCALE).collect())
            }
            other => not_offered(SensorKind::Audio, other),
        }
    }
}
