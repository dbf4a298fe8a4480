use super::read_folder;
use crate::{Failure, FailureKind, secret};
use avln_acoustics::{Bank, Clip, SAMPLE_RATE_HZ};
use hound::{SampleFormat, WavReader, WavSpec, WavWriter};
use std::{
    fs, io,
    path::{Path, PathBuf},
};

/// A folder of recorded sound banks, named by sample digest.
pub struct SoundFolder {
    folder: PathBuf,
}

/// Mono at the rate of all sounds, in numbers that need no rounding.
const SPEC: WavSpec = WavSpec {
    channels: 1,
    sample_rate: SAMPLE_RATE_HZ,
    bits_per_sample: 32,
    sample_format: SampleFormat::Float,
};

impl SoundFolder {
    /// The banks in `folder`, which is created on first use.
    pub fn at(folder: &Path) -> Self {
        Self { folder: folder.to_owned() }
    }

    /// Imports the recordings in `source` as a bank and returns its digest.
    ///
    /// # Errors
    /// If a recording is not a valid clip, or the bank is not writable.
    pub fn adopt(&self, source: &Path) -> Result<String, Failure> {
        let clips = read_folder(source)?;
        let digest = digest(&clips);
        if self.bank(&digest).is_err() {
            self.write(&digest, &clips).map_err(|error| {
                Failure::new(
                    FailureKind::Data,
                    format!("cannot keep sounds in {}: {error}", self.folder.display()),
                )
                .hinted("give the folder write permission and space")
            })?;
        }
        Ok(digest)
    }

    /// The bank with this digest.
    ///
    /// # Errors
    /// If it is missing or modified.
    pub fn bank(&self, wanted: &str) -> Result<Bank, Failure> {
        let path = self.folder.join(wanted);
        let failed = |error: String| {
            Failure::new(FailureKind::Data, format!("cannot play the sounds in {}: {error}", path.display()))
                .hinted("restore the folder from a backup, or open the phase again with --sounds FOLDER")
        };
        let clips = kept_clips(&path).map_err(|error| failed(error.to_string()))?;
        let found = digest(&clips);
        if found != wanted {
            return Err(failed(format!("their digest is {found}, somebody has changed them")));
        }
        Ok(Bank::from_clips(clips))
    }

    /// Writes a bank under another name and moves it into place when it is complete.
    fn write(&self, digest: &str, clips: &[Clip]) -> Result<(), hound::Error> {
        let random = secret::random_hex().map_err(|error| hound::Error::IoError(io::Error::other(error)))?;
        let (unfinished, place) = (self.folder.join(format!("{random}.part")), self.folder.join(digest));
        fs::create_dir_all(&unfinished)?;
        for (number, clip) in clips.iter().enumerate() {
            let mut writer = WavWriter::create(unfinished.join(format!("{number:04}.wav")), SPEC)?;
            clip.samples.iter().try_for_each(|&sample| writer.write_sample(sample))?;
            writer.finalize()?;
        }
        if place.exists() {
            fs::remove_dir_all(&place)?;
        }
        Ok(fs::rename(&unfinished, &place)?)
    }
}

/// The clips of a kept bank, in their order.
fn kept_clips(folder: &Path) -> Result<Vec<Clip>, hound::Error> {
    let entries: Result<Vec<_>, _> =
        fs::read_dir(folder)?.map(|entry| entry.map(|entry| entry.path())).collect();
    let mut paths = entries?;
    paths.sort();
    paths.iter().map(|path| kept_clip(path)).collect()
}

fn kept_clip(path: &Path) -> Result<Clip, hound::Error> {
    let samples: Result<Vec<f32>, _> = WavReader::open(path)?.samples::<f32>().collect();
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Ok(Clip { name, samples: samples?.into() })
}

/// BLAKE3 over the lengths and the bits of the samples of all clips, hex.
fn digest(clips: &[Clip]) -> String {
    let mut hasher = blake3::Hasher::new();
    for clip in clips {
        hasher.update(&(clip.samples.len() as u64).to_le_bytes());
        let bytes: Vec<u8> = clip.samples.iter().flat_map(|sample| sample.to_le_bytes()).collect();
        hasher.update(&bytes);
    }
    hasher.finalize().to_hex().to_string()
}
