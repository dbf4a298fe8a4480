use claxon::FlacReader;
use hound::{SampleFormat, WavReader};
use std::{io, path::Path};

/// Most seconds that are read of a file: more than a clip may have.
const MOST_SECONDS: usize = 61;

/// A recording, mixed to mono.
pub(super) struct Recording {
    pub(super) samples: Vec<f32>,
    pub(super) rate_hz: u32,
}

/// Why a file is no recording.
#[derive(Debug, thiserror::Error)]
pub(super) enum DecodeError {
    #[error("{0}")]
    Wav(#[from] hound::Error),
    #[error("{0}")]
    Flac(#[from] claxon::Error),
    #[error("{0}")]
    File(#[from] io::Error),
    #[error("it has {0} channels; mix it down to 1 or 2")]
    Channels(u32),
    #[error("it ends in the middle of a sample")]
    Torn,
}

/// Returns true for the file names of supported formats.
pub(super) fn is_recording(path: &Path) -> bool {
    path.is_file() && (has_ending(path, "wav") || has_ending(path, "flac"))
}

fn has_ending(path: &Path, ending: &str) -> bool {
    path.extension().is_some_and(|end| end.eq_ignore_ascii_case(ending))
}

/// Reads a WAV or FLAC file; full scale becomes 1.
pub(super) fn decode(path: &Path) -> Result<Recording, DecodeError> {
    if has_ending(path, "flac") { flac(path) } else { wav(path) }
}

fn wav(path: &Path) -> Result<Recording, DecodeError> {
    let mut reader = WavReader::open(path)?;
    let spec = reader.spec();
    let (channels, rate_hz) = (checked(u32::from(spec.channels))?, spec.sample_rate);
    let most = most_samples(rate_hz, channels);
    let samples: Result<Vec<f32>, _> = match spec.sample_format {
        SampleFormat::Float => reader.samples::<f32>().take(most).collect(),
        SampleFormat::Int => {
            let unit = unit(u32::from(spec.bits_per_sample));
            reader.samples::<i32>().take(most).map(|sample| Ok(sample? as f32 * unit)).collect()
        }
    };
    mixed(&samples?, channels, rate_hz)
}

fn flac(path: &Path) -> Result<Recording, DecodeError> {
    let mut reader = FlacReader::open(path)?;
    let info = reader.streaminfo();
    let (channels, unit) = (checked(info.channels)?, unit(info.bits_per_sample));
    let most = most_samples(info.sample_rate, channels);
    let samples: Result<Vec<f32>, claxon::Error> =
        reader.samples().take(most).map(|sample| Ok(sample? as f32 * unit)).collect();
    mixed(&samples?, channels, info.sample_rate)
}

/// One or two channels.
fn checked(channels: u32) -> Result<usize, DecodeError> {
    if (1..=2).contains(&channels) { Ok(channels as usize) } else { Err(DecodeError::Channels(channels)) }
}

fn most_samples(rate_hz: u32, channels: usize) -> usize {
    (rate_hz as usize).saturating_mul(MOST_SECONDS * channels)
}

/// Value of the smallest sample step at `bits` bits.
fn unit(bits: u32) -> f32 {
    1.0 / (1_u64 << bits.clamp(1, 32).saturating_sub(1)) as f32
}

/// The mean over the channels of interleaved samples.
fn mixed(samples: &[f32], channels: usize, rate_hz: u32) -> Result<Recording, DecodeError> {
    if !samples.len().is_multiple_of(channels) {
        return Err(DecodeError::Torn);
    }
    let mean = |frame: &[f32]| frame.iter().sum::<f32>() / channels as f32;
    Ok(Recording { samples: samples.chunks(channels).map(mean).collect(), rate_hz })
}
