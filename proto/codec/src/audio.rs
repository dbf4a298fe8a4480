//! Sound pressure: `2 × samples` numbers, the left ear's first.

use crate::{CodecError, floats, not_offered};
use avln_proto::v1::{Encoding, SensorKind};
use bytes::Bytes;

/// What a pressure of 1 is as a whole number.
const FULL_SCALE: f32 = 32_767.0;

/// Packs samples of both ears. `AUDIO_I16` rounds to nearest and clamps to -1 to 1.
///
/// # Errors
/// When the encoding is not one of sound.
pub fn encode(encoding: Encoding, samples: &[f32]) -> Result<Bytes, CodecError> {
    let whole = |sample: &f32| ((sample * FULL_SCALE).round() as i16).max(-i16::MAX);
    match encoding {
        Encoding::Raw => Ok(floats::copy(samples)),
        Encoding::AudioI16 => Ok(samples.iter().flat_map(|sample| whole(sample).to_le_bytes()).collect()),
        other => not_offered(SensorKind::Audio, other),
    }
}

/// Unpacks `count` samples, those of both ears together.
///
/// # Errors
/// When `bytes` are not so many samples in this encoding.
pub fn decode(encoding: Encoding, count: usize, bytes: &[u8]) -> Result<Vec<f32>, CodecError> {
    let check = |each: usize| CodecError::check_length("a sound", "bytes", bytes.len(), each * count);
    match encoding {
        Encoding::Raw => check(4).map(|()| floats::from_bytes(bytes)),
        Encoding::AudioI16 => {
            check(2)?;
            let words = bytes.as_chunks().0.iter();
            Ok(words.map(|word| f32::from(i16::from_le_bytes(*word)) / FULL_SCALE).collect())
        }
        other => not_offered(SensorKind::Audio, other),
    }
}
