//! Recordings as the bank of a phase: read from a folder of WAV and FLAC files, and kept as they are played.

use crate::{Failure, FailureKind};
use avln_acoustics::{Clip, SAMPLE_RATE_HZ};
use std::{
    fs, io,
    path::{Path, PathBuf},
};

mod decode;
mod kept;

pub use kept::SoundFolder;

/// Most files of a bank.
const MOST_FILES: usize = 1000;

/// Most seconds of all files of a bank together: 115 MB in memory.
const MOST_SECONDS: usize = 30 * 60;

/// Reads all `.wav` and `.flac` files in `folder`, sorted by name. Stereo is mixed to mono.
///
/// # Errors
/// If there are none, too many or too long ones, or a file is not a valid clip.
pub fn read_folder(folder: &Path) -> Result<Vec<Clip>, Failure> {
    let paths = recordings(folder)?;
    let mut clips = Vec::with_capacity(paths.len());
    let mut samples = 0;
    for path in &paths {
        clips.push(read(path)?);
        samples += clips.last().map_or(0, |clip| clip.samples.len());
        if samples > MOST_SECONDS * SAMPLE_RATE_HZ as usize {
            let message =
                format!("the recordings in {} are longer than 30 minutes together", folder.display());
            return Err(Failure::new(FailureKind::Data, message).hinted("take some out, or shorten them"));
        }
    }
    Ok(clips)
}

/// Reads a recording as a clip.
///
/// # Errors
/// If the file is no recording, or too short or too long.
pub fn read(path: &Path) -> Result<Clip, Failure> {
    let wrong = |error: String| {
        Failure::new(FailureKind::Data, format!("cannot use recording {}: {error}", path.display()))
    };
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let recording = decode::decode(path).map_err(|error| wrong(error.to_string()))?;
    Clip::recorded(&name, &recording.samples, recording.rate_hz).map_err(|error| wrong(error.to_string()))
}

/// The sound files in `folder`, by name.
fn recordings(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let failed = |error: io::Error| {
        Failure::new(FailureKind::Data, format!("cannot read recordings in {}: {error}", folder.display()))
            .hinted("name a folder with .wav or .flac files, or one of: all, train, validation, test")
    };
    let entries = fs::read_dir(folder).map_err(failed)?;
    let mut paths = Vec::new();
    for entry in entries {
        let path = entry.map_err(failed)?.path();
        if decode::is_recording(&path) {
            paths.push(path);
        }
    }
    paths.sort();
    if (1..=MOST_FILES).contains(&paths.len()) {
        return Ok(paths);
    }
    let (count, folder) = (paths.len(), folder.display());
    let message =
        format!("folder {folder} holds {count} .wav and .flac files; 1 to {MOST_FILES} are possible");
    Err(Failure::new(FailureKind::Data, message))
}

#[cfg(test)]
mod tests;
