//! Sound pressure: `2 × samples` values, left ear first.

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
