//! `avln sim listen`: the sound at the ears along a walk.

use super::hall::{Surroundings, SurroundingsArgs};
use super::walk::StartPose;
use super::{read, unusable};
use crate::output::say;
use avln_acoustics::{Bank, Clip, Ears, Emitter, Head, Listener, SAMPLE_RATE_HZ, Settings};
use avln_arena::{Failure, FailureKind, audio};
use avln_geom::{Point3, Vector3};
use clap::Args;
use hound::{SampleFormat, WavSpec, WavWriter};
use serde::Deserialize;
use std::{
    path::{Path, PathBuf},
    str::FromStr,
};

/// Samples of a step: 0.25 s.
const STEP_SAMPLES: usize = SAMPLE_RATE_HZ as usize / 4;

/// Steps of a walk.
const MOST_STEPS: usize = 4000;

/// Arguments of `avln sim listen`.
#[derive(Debug, Args)]
pub struct ListenArgs {
    #[command(flatten)]
    surroundings: SurroundingsArgs,
    /// Omnidirectional point source: x,y,z in metres. Several sources take turns
    #[arg(long = "source", value_name = "X,Y,Z", allow_hyphen_values = true, required = true)]
    sources: Vec<Position>,
    /// Steps per turn
    #[arg(long, value_name = "STEPS", default_value_t = 25, value_parser = clap::value_parser!(u32).range(1..))]
    turn: u32,
    /// Clip of the sources: the name of a synthetic clip, or a WAV or FLAC file. One for all sources, or one per source
    #[arg(long = "clip", value_name = "NAME|FILE", default_value = "pink-bursts-0")]
    clips: Vec<String>,
    /// Poses of the body per step of 0.25 s: [[x,y,z,heading],...] in metres and degrees, or the output of
    /// `avln sim walk --json`; at most 4000
    #[arg(long, value_name = "FILE.json")]
    poses: PathBuf,
    /// Height of the ears above the poses, metres
    #[arg(long, value_name = "METRES", default_value_t = 1.0, allow_hyphen_values = true)]
    ear_height: f32,
    #[command(flatten)]
    hearing: HearingArgs,
    /// Output file: 16 kHz, 32-bit float, left and right ear; one channel with --omni. The reverberation follows the last step
    #[arg(long, value_name = "WALK.wav")]
    out: PathBuf,
}

/// A file of poses.
#[derive(Deserialize)]
#[serde(untagged)]
enum PoseFile {
    Walked { poses: Vec<[f64; 4]> },
    Plain(Vec<[f64; 4]>),
}

pub(super) fn run(args: &ListenArgs) -> Result<(), Failure> {
    let walk = args.walk()?;
    let hall = args.surroundings.open()?;
    args.sources.iter().try_for_each(|source| hall.check("the source", &source.0))?;
    walk.iter().try_for_each(|listener| hall.check("the listener", &listener.position))?;
    let settings = args.hearing.settings(hall.response_s())?;
    let ringing_steps = (settings.response_s * SAMPLE_RATE_HZ as f32) as usize / STEP_SAMPLES + 2;
    let mut ears = Ears::new(args.emitters(&hall, settings)?, STEP_SAMPLES);
    let sounding = |step: usize| Some(step / args.turn as usize % args.sources.len());
    let turns = walk.iter().enumerate().map(|(step, listener)| (*listener, sounding(step)));
    let ringing = std::iter::repeat_n((walk[walk.len() - 1], None), ringing_steps);
    let mut heard = [Vec::new(), Vec::new()];
    for (listener, sounding) in turns.chain(ringing) {
        let step = ears.hear(&listener, sounding);
        heard
            .iter_mut()
            .zip(step.chunks_exact(STEP_SAMPLES))
            .for_each(|(all, ear)| all.extend_from_slice(ear));
    }
    let channels = heard.each_ref().map(Vec::as_slice);
    write_wav(&args.out, &channels[..usize::from(args.hearing.channels())])?;
    say!("{} steps in {}", walk.len(), args.out.display());
    Ok(())
}

impl ListenArgs {
    /// The listener per step; at least one.
    fn walk(&self) -> Result<Vec<Listener>, Failure> {
        let what = "an array of [x,y,z,heading], or what `avln sim walk --json` prints";
        let (PoseFile::Walked { poses } | PoseFile::Plain(poses)) = read(&self.poses, what)?;
        if !(1..=MOST_STEPS).contains(&poses.len()) {
            let why = format!("it contains {} poses", poses.len());
            return Err(unusable(
                &self.poses,
                why,
                format!("write 1 to {MOST_STEPS} poses, one for each step"),
            ));
        }
        let head = |(index, pose): (usize, &[f64; 4])| {
            let [x, y, z, heading_deg] = *pose;
            if !pose.iter().all(|value| value.abs() < 1e6) {
                return Err(unusable(
                    &self.poses,
                    format!("pose {index} is out of reach"),
                    "write metres and degrees",
                ));
            }
            let base = Point3::new(x as f32, y as f32, z as f32);
            Ok(listener(&StartPose { position: base + Vector3::y() * self.ear_height, heading_deg }))
        };
        poses.iter().enumerate().map(head).collect()
    }

    fn emitters(&self, hall: &Surroundings, settings: Settings) -> Result<Vec<Emitter>, Failure> {
        if self.clips.len() != 1 && self.clips.len() != self.sources.len() {
            let counts = format!("{} clips for {} sources", self.clips.len(), self.sources.len());
            return Err(Failure::new(FailureKind::Data, counts)
                .hinted("name one clip for all sources, or one for each"));
        }
        let clips: Vec<Clip> = self.clips.iter().map(|name| clip(name)).collect::<Result<_, _>>()?;
        let acoustics = hall.acoustics(settings);
        let emitter = |(source, clip): (&Position, &Clip)| Emitter {
            source: acoustics.source(&source.0),
            clip: clip.clone(),
            offset_samples: 0,
        };
        Ok(self.sources.iter().zip(clips.iter().cycle()).map(emitter).collect())
    }
}

/// Returns the clip called `name`. A name with an extension is a file.
fn clip(name: &str) -> Result<Clip, Failure> {
    if Path::new(name).extension().is_some() {
        return audio::read_recording(Path::new(name));
    }
    let bank = Bank::default();
    let names = bank.names();
    let place = names.iter().position(|other| other == name);
    place.and_then(|index| bank.clip(index)).ok_or_else(|| {
        let hint = format!("name a .wav or .flac file, or one of {}", names.join(", "));
        Failure::new(FailureKind::Data, format!("no clip is called '{name}'")).hinted(hint)
    })
}

/// Largest distance of sources and listeners from the origin, metres.
const REACH_M: f32 = 1e6;

/// Arguments of the sound simulation and the head.
#[derive(Debug, Args)]
pub(super) struct HearingArgs {
    /// Length of the impulse response, seconds from 0.01 to 20 [default: by Sabine's formula]
    #[arg(long, value_name = "SECONDS")]
    seconds: Option<Seconds>,
    /// Number of rays for late reverberation, 0 (none) to 4194304
    #[arg(long, value_name = "COUNT", default_value_t = Settings::default().ray_count as u32, value_parser = clap::value_parser!(u32).range(0..=1 << 22))]
    rays: u32,
    /// Highest order of early reflections, 0 to 3
    #[arg(long, value_name = "ORDER", default_value_t = Settings::default().reflection_order as u8, value_parser = clap::value_parser!(u8).range(0..=3))]
    reflections: u8,
    /// Output the pressure at the centre of the head instead of two ears
    #[arg(long)]
    omni: bool,
    /// SOFA file of a measured head, instead of a sphere
    #[arg(long, value_name = "FILE.sofa", conflicts_with = "omni")]
    head: Option<PathBuf>,
}

/// A position, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Position(pub(super) Point3<f32>);

#[derive(Clone, Copy, Debug, PartialEq)]
struct Seconds(f32);

impl HearingArgs {
    /// Returns the settings. `response_s` is the default length.
    pub(super) fn settings(&self, response_s: f32) -> Result<Settings, Failure> {
        Ok(Settings {
            response_s: self.seconds.map_or(response_s, |seconds| seconds.0),
            ray_count: self.rays as usize,
            reflection_order: usize::from(self.reflections),
            head: self.head()?,
        })
    }

    fn head(&self) -> Result<Head, Failure> {
        let Some(file) = &self.head else {
            return Ok(if self.omni { Head::Omni } else { Head::Sphere });
        };
        Ok(audio::read_head(file)?.1)
    }

    /// Number of output channels.
    pub(super) fn channels(&self) -> u16 {
        if self.omni { 1 } else { 2 }
    }
}

/// The listener at a start pose.
pub(super) fn listener(start: &StartPose) -> Listener {
    Listener { position: start.position, heading_rad: (start.heading_deg % 360.0).to_radians() as f32 }
}

impl FromStr for Position {
    type Err = String;

    fn from_str(words: &str) -> Result<Self, String> {
        let values: Vec<f32> = words
            .split(',')
            .map(|word| word.trim().parse().map_err(|error| format!("'{word}': {error}")))
            .collect::<Result<_, _>>()?;
        match *values.as_slice() {
            [x, y, z] if values.iter().all(|value| value.abs() < REACH_M) => Ok(Self(Point3::new(x, y, z))),
            _ => Err(format!("three numbers are needed: x,y,z in metres, each below {REACH_M}")),
        }
    }
}

impl FromStr for Seconds {
    type Err = String;

    fn from_str(word: &str) -> Result<Self, String> {
        let seconds = word.parse().ok().filter(|seconds| (0.01..=20.0).contains(seconds));
        seconds.map(Self).ok_or_else(|| "write seconds from 0.01 to 20".to_owned())
    }
}

/// Writes channels of equal or unequal length, the shorter ones followed by silence: 32-bit float, 16 kHz.
pub(super) fn write_wav(file: &Path, channels: &[&[f32]]) -> Result<(), Failure> {
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
    fn places_are_three_finite_numbers() {
        assert_eq!("1, -2,0.5".parse(), Ok(Position(Point3::new(1.0, -2.0, 0.5))));
        for bad in ["", "1,2", "1,2,3,4", "1,2,NaN", "1,inf,2", "1,2,1e9", "a,b,c"] {
            assert!(bad.parse::<Position>().is_err(), "{bad}");
        }
    }

    #[test]
    fn responses_are_neither_nothing_nor_endless() {
        assert_eq!("2.5".parse(), Ok(Seconds(2.5)));
        for bad in ["0", "-1", "21", "NaN", "inf", "long"] {
            assert!(bad.parse::<Seconds>().is_err(), "{bad}");
        }
    }

    #[test]
    fn samples_come_back_as_they_were() {
        let folder = tempfile::tempdir().expect("a folder for temporary files");
        let file = folder.path().join("two.wav");
        write_wav(&file, &[&[0.5, -0.25, 1e-9], &[1.0]]).expect("written");
        let mut reader = hound::WavReader::open(&file).expect("a sound file");
        assert_eq!((reader.spec().channels, reader.spec().sample_rate), (2, 16_000));
        let samples: Vec<f32> = reader.samples().map(|sample| sample.expect("a sample")).collect();
        assert_eq!(samples, [0.5, 1.0, -0.25, 0.0, 1e-9, 0.0]);
        let nowhere = write_wav(&folder.path().join("none/two.wav"), &[&[0.0]]).expect_err("no such folder");
        assert_eq!(nowhere.kind(), FailureKind::Data);
    }
}
