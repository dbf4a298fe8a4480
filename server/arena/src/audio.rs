//! Recordings and measured heads: decoding of WAV, FLAC and SOFA files, and storage by digest.

use crate::{Failure, ids};
use avln_acoustics::{Bank, Clip, Head, MeasuredHead, SAMPLE_RATE_HZ};
use claxon::FlacReader;
use hound::{SampleFormat, WavReader, WavSpec, WavWriter};
use std::{
    fs, io,
    path::{Path, PathBuf},
    sync::Arc,
};

/// Largest bank, files.
const MAX_FILES: usize = 1000;
/// Largest bank, seconds: 115 MB in memory.
const MAX_BANK_SECONDS: usize = 30 * 60;
/// Largest decoded duration, seconds; clips are shorter.
const MAX_FILE_SECONDS: usize = 61;
/// Largest SOFA file, bytes: ten times a fine-grained set of responses.
const MAX_HEAD_BYTES: u64 = 256 << 20;

/// Reads all `.wav` and `.flac` files in `folder`, sorted by name. Stereo is mixed to mono.
pub fn read_recordings(folder: &Path) -> Result<Vec<Clip>, Failure> {
    let paths = recordings(folder)?;
    let mut clips = Vec::with_capacity(paths.len());
    let mut samples = 0;
    for path in &paths {
        let clip = read_recording(path)?;
        samples += clip.samples.len();
        if samples > MAX_BANK_SECONDS * SAMPLE_RATE_HZ as usize {
            let message = format!("the recordings in {} exceed 30 minutes in total", folder.display());
            return Err(Failure::data(message).hinted("remove or shorten some of them"));
        }
        clips.push(clip);
    }
    Ok(clips)
}

/// Reads a recording as a clip.
pub fn read_recording(path: &Path) -> Result<Clip, Failure> {
    let wrong = |error: String| Failure::file("use recording", path, error);
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let recording = decode(path).map_err(|error| wrong(error.to_string()))?;
    Clip::recorded(&name, &recording.samples, recording.rate_hz).map_err(|error| wrong(error.to_string()))
}

/// Lists the recordings in `folder` by name.
fn recordings(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let failed = |error: io::Error| {
        Failure::file("read recordings in", folder, error)
            .hinted("name a folder with .wav or .flac files, or one of: all, train, validation, test")
    };
    let mut paths = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if path.is_file() && (has_extension(&path, "wav") || has_extension(&path, "flac")) {
            paths.push(path);
        }
    }
    paths.sort();
    if (1..=MAX_FILES).contains(&paths.len()) {
        return Ok(paths);
    }
    let (count, folder) = (paths.len(), folder.display());
    Err(Failure::data(format!(
        "folder {folder} has {count} .wav and .flac files; a bank needs 1 to {MAX_FILES}"
    )))
}

/// Recorded sound banks, named by sample digest.
pub struct SoundFolder {
    folder: PathBuf,
}

/// Clip file format: mono float samples, so that nothing is rounded.
const CLIP_FORMAT: WavSpec = WavSpec {
    channels: 1,
    sample_rate: SAMPLE_RATE_HZ,
    bits_per_sample: 32,
    sample_format: SampleFormat::Float,
};

impl SoundFolder {
    /// Opens the banks in `folder`, which is created on first use.
    pub fn at(folder: &Path) -> Self {
        Self { folder: folder.to_owned() }
    }

    /// Imports the recordings in `source` as a bank; returns the digest.
    pub fn import(&self, source: &Path) -> Result<String, Failure> {
        let clips = read_recordings(source)?;
        let digest = bank_digest(&clips);
        if self.bank(&digest).is_err() {
            self.write(&digest, &clips).map_err(|error| cannot_store("sounds", &self.folder, error))?;
        }
        Ok(digest)
    }

    /// Reads the bank `digest`.
    pub fn bank(&self, digest: &str) -> Result<Bank, Failure> {
        let path = self.folder.join(digest);
        let failed = |error: String| {
            Failure::file("play the sounds in", &path, error)
                .hinted("restore the folder from a backup, or open the phase again with --sounds FOLDER")
        };
        let clips = stored_clips(&path).map_err(|error| failed(error.to_string()))?;
        let found = bank_digest(&clips);
        if found != digest {
            return Err(failed(format!("the files were changed: their digest is {found}")));
        }
        Ok(Bank::from_clips(clips))
    }

    fn write(&self, digest: &str, clips: &[Clip]) -> Result<(), hound::Error> {
        // Another process may import the same bank: a complete folder is renamed into place.
        let unfinished = temporary(&self.folder)?;
        let path = self.folder.join(digest);
        fs::create_dir_all(&unfinished)?;
        for (number, clip) in clips.iter().enumerate() {
            let mut writer = WavWriter::create(unfinished.join(format!("{number:04}.wav")), CLIP_FORMAT)?;
            clip.samples.iter().try_for_each(|&sample| writer.write_sample(sample))?;
            writer.finalize()?;
        }
        if path.exists() {
            fs::remove_dir_all(&path)?;
        }
        Ok(fs::rename(&unfinished, &path)?)
    }
}

fn stored_clips(folder: &Path) -> Result<Vec<Clip>, hound::Error> {
    let entries = fs::read_dir(folder)?.map(|entry| entry.map(|entry| entry.path()));
    let mut paths = entries.collect::<Result<Vec<_>, _>>()?;
    paths.sort();
    let mut clips = Vec::with_capacity(paths.len());
    for path in paths {
        let samples: Result<Vec<f32>, _> = WavReader::open(&path)?.samples::<f32>().collect();
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        clips.push(Clip { name, samples: samples?.into() });
    }
    Ok(clips)
}

/// Returns the BLAKE3 digest over clip lengths and sample bits, hexadecimal.
fn bank_digest(clips: &[Clip]) -> String {
    let mut hasher = blake3::Hasher::new();
    for clip in clips {
        hasher.update(&(clip.samples.len() as u64).to_le_bytes());
        let bytes: Vec<u8> = clip.samples.iter().flat_map(|sample| sample.to_le_bytes()).collect();
        hasher.update(&bytes);
    }
    hasher.finalize().to_hex().to_string()
}

/// A decoded recording, mixed to mono.
struct Recording {
    samples: Vec<f32>,
    rate_hz: u32,
}

#[derive(Debug, thiserror::Error)]
enum DecodeError {
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

fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|found| found.eq_ignore_ascii_case(extension))
}

/// Decodes a WAV or FLAC file; full scale becomes 1.
fn decode(path: &Path) -> Result<Recording, DecodeError> {
    if has_extension(path, "flac") { decode_flac(path) } else { decode_wav(path) }
}

fn decode_wav(path: &Path) -> Result<Recording, DecodeError> {
    let mut reader = WavReader::open(path)?;
    let spec = reader.spec();
    let (channels, rate_hz) = (check_channels(u32::from(spec.channels))?, spec.sample_rate);
    let most = max_samples(rate_hz, channels);
    let samples: Result<Vec<f32>, _> = match spec.sample_format {
        SampleFormat::Float => reader.samples::<f32>().take(most).collect(),
        SampleFormat::Int => {
            let unit = sample_unit(u32::from(spec.bits_per_sample));
            reader.samples::<i32>().take(most).map(|sample| Ok(sample? as f32 * unit)).collect()
        }
    };
    mix(&samples?, channels, rate_hz)
}

fn decode_flac(path: &Path) -> Result<Recording, DecodeError> {
    let mut reader = FlacReader::open(path)?;
    let info = reader.streaminfo();
    let (channels, unit) = (check_channels(info.channels)?, sample_unit(info.bits_per_sample));
    let most = max_samples(info.sample_rate, channels);
    let samples: Result<Vec<f32>, claxon::Error> =
        reader.samples().take(most).map(|sample| Ok(sample? as f32 * unit)).collect();
    mix(&samples?, channels, info.sample_rate)
}

fn check_channels(channels: u32) -> Result<usize, DecodeError> {
    if (1..=2).contains(&channels) { Ok(channels as usize) } else { Err(DecodeError::Channels(channels)) }
}

// A limit on decoded samples, not on bytes: small FLAC files can unpack to gigabytes.
fn max_samples(rate_hz: u32, channels: usize) -> usize {
    (rate_hz as usize).saturating_mul(MAX_FILE_SECONDS * channels)
}

/// Returns the smallest sample step at `bits` bits.
fn sample_unit(bits: u32) -> f32 {
    1.0 / (1_u64 << bits.clamp(1, 32).saturating_sub(1)) as f32
}

fn mix(samples: &[f32], channels: usize, rate_hz: u32) -> Result<Recording, DecodeError> {
    if !samples.len().is_multiple_of(channels) {
        return Err(DecodeError::Torn);
    }
    let mean = |frame: &[f32]| frame.iter().sum::<f32>() / channels as f32;
    Ok(Recording { samples: samples.chunks(channels).map(mean).collect(), rate_hz })
}

/// Measured heads, named by digest.
pub struct HeadFolder {
    folder: PathBuf,
}

impl HeadFolder {
    /// Opens the heads in `folder`, which is created on first use.
    pub fn at(folder: &Path) -> Self {
        Self { folder: folder.to_owned() }
    }

    /// Copies the head in the SOFA file `source`; returns the digest.
    pub fn import(&self, source: &Path) -> Result<String, Failure> {
        let (bytes, _) = read_head(source)?;
        let digest = blake3::hash(&bytes).to_hex().to_string();
        if self.head(&digest).is_err() {
            self.write(&digest, &bytes).map_err(|error| cannot_store("the head", &self.folder, error))?;
        }
        Ok(digest)
    }

    /// Reads the head `digest`.
    pub fn head(&self, digest: &str) -> Result<Head, Failure> {
        let path = self.path(digest);
        let hint = "restore the file from a backup, or open the phase again with --head FILE.sofa";
        let (bytes, head) = read_head(&path).map_err(|failure| failure.hinted(hint))?;
        let found = blake3::hash(&bytes).to_hex();
        if found.as_str() == digest {
            return Ok(head);
        }
        Err(Failure::file("use head", &path, format!("the file was changed: its digest is {found}"))
            .hinted(hint))
    }

    fn path(&self, digest: &str) -> PathBuf {
        self.folder.join(format!("{digest}.sofa"))
    }

    fn write(&self, digest: &str, bytes: &[u8]) -> io::Result<()> {
        fs::create_dir_all(&self.folder)?;
        let unfinished = temporary(&self.folder)?;
        fs::write(&unfinished, bytes)?;
        fs::rename(&unfinished, self.path(digest))
    }
}

/// Reads the head in a SOFA file; returns the file's bytes too.
pub fn read_head(path: &Path) -> Result<(Vec<u8>, Head), Failure> {
    let bytes =
        head_bytes(path).map_err(|error| Failure::file("use", path, error).hinted("check the path"))?;
    let head = MeasuredHead::from_sofa(&bytes).map_err(|error| {
        Failure::file("use", path, error).hinted("the sphere, without --head, needs no file")
    })?;
    Ok((bytes, Head::Measured(Arc::new(head))))
}

fn head_bytes(path: &Path) -> io::Result<Vec<u8>> {
    let bytes = fs::metadata(path)?.len();
    if bytes > MAX_HEAD_BYTES {
        return Err(io::Error::other(format!("the file has {bytes} bytes, more than {MAX_HEAD_BYTES}")));
    }
    fs::read(path)
}

/// Returns a free path for an unfinished file.
fn temporary(folder: &Path) -> io::Result<PathBuf> {
    Ok(folder.join(format!("{}.part", ids::random_hex().map_err(io::Error::other)?)))
}

fn cannot_store(what: &str, folder: &Path, error: impl std::fmt::Display) -> Failure {
    Failure::file(&format!("store {what} in"), folder, error).hinted("check write permission and free space")
}

#[cfg(test)]
mod tests;
