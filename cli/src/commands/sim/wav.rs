//! Sound files.

use avln_acoustics::SAMPLE_RATE_HZ;
use avln_arena::{Failure, FailureKind};
use hound::{SampleFormat, WavSpec, WavWriter};
use std::path::Path;

/// Writes channels of equal or unequal length, the shorter ones followed by silence: 32-bit float, 16 kHz.
pub(super) fn write(file: &Path, channels: &[&[f32]]) -> Result<(), Failure> {
    let failed = |error: hound::Error| {
        Failure::new(FailureKind::Data, format!("cannot write {}: {error}", file.display()))
            .hinted("name a file in a folder that exists and has room")
    };
    let spec = WavSpec {
        channels: channels.len() as u16,
        sample_rate: SAMPLE_RATE_HZ,
        bits_per_sample: 32,
        sample_format: SampleFormat::Float,
    };
    let mut writer = WavWriter::create(file, spec).map_err(failed)?;
    let length = channels.iter().map(|channel| channel.len()).max().unwrap_or(0);
    for index in 0..length {
        for channel in channels {
            writer.write_sample(channel.get(index).copied().unwrap_or(0.0)).map_err(failed)?;
        }
    }
    writer.finalize().map_err(failed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_come_back_as_they_were() {
        let folder = tempfile::tempdir().expect("a folder for temporary files");
        let file = folder.path().join("two.wav");
        write(&file, &[&[0.5, -0.25, 1e-9], &[1.0]]).expect("written");
        let mut reader = hound::WavReader::open(&file).expect("a sound file");
        assert_eq!((reader.spec().channels, reader.spec().sample_rate), (2, 16_000));
        let samples: Vec<f32> = reader.samples().map(|sample| sample.expect("a sample")).collect();
        assert_eq!(samples, [0.5, 1.0, -0.25, 0.0, 1e-9, 0.0]);
        let nowhere = write(&folder.path().join("none/two.wav"), &[&[0.0]]).expect_err("no such folder");
        assert_eq!(nowhere.kind(), FailureKind::Data);
    }
}
