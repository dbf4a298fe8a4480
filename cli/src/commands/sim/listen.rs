use super::hall::{Hall, Surroundings};
use super::listener::{Hearing, Place, listener};
use super::walk::Start;
use super::{read, unusable, wav};
use crate::output::say;
use avln_acoustics::{Bank, Clip, Ears, Emitter, Listener, SAMPLE_RATE_HZ, Settings};
use avln_arena::{Failure, FailureKind, sounds};
use avln_geom::{Point3, Vector3};
use clap::Args;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Samples of a step: 0.25 s.
const STEP_SAMPLES: usize = SAMPLE_RATE_HZ as usize / 4;

/// Steps of a walk.
const MOST_STEPS: usize = 4000;

/// A building, what sounds in it, and a walk through it.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    surroundings: Surroundings,
    /// A source, a point that sounds alike in all directions: x,y,z in metres. Several take turns in their order
    #[arg(long = "source", value_name = "X,Y,Z", allow_hyphen_values = true, required = true)]
    sources: Vec<Place>,
    /// Steps that a source sounds before the next one does
    #[arg(long, value_name = "STEPS", default_value_t = 25, value_parser = clap::value_parser!(u32).range(1..))]
    turn: u32,
    /// What sources play: the name of a clip that the program makes, or a WAV or FLAC file. One for all of them, or one for
    /// each
    #[arg(long = "clip", value_name = "NAME|FILE", default_value = "pink-bursts-0")]
    clips: Vec<String>,
    /// Where the body stands in each step of 0.25 s: [[x,y,z,heading],...], metres and degrees, or what
    /// `avln sim walk --json` prints; at most 4000
    #[arg(long, value_name = "FILE.json")]
    poses: PathBuf,
    /// How far the ears are above these places, metres
    #[arg(long, value_name = "METRES", default_value_t = 1.0, allow_hyphen_values = true)]
    ear_height: f32,
    #[command(flatten)]
    hearing: Hearing,
    /// Write what is heard: 16 kHz, 32-bit float, left and right ear; one channel with --omni. The last step is followed by
    /// what still rings
    #[arg(long, value_name = "WALK.wav")]
    out: PathBuf,
}

/// A file of poses.
#[derive(Deserialize)]
#[serde(untagged)]
enum Poses {
    Walked { poses: Vec<[f64; 4]> },
    Plain(Vec<[f64; 4]>),
}

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    let walk = options.walk()?;
    let hall = options.surroundings.open()?;
    options.sources.iter().try_for_each(|source| hall.check("the source", &source.0))?;
    walk.iter().try_for_each(|listener| hall.check("the listener", &listener.position))?;
    let settings = options.hearing.settings(hall.response_s())?;
    let ringing_steps = (settings.response_s * SAMPLE_RATE_HZ as f32) as usize / STEP_SAMPLES + 2;
    let mut ears = Ears::new(options.emitters(&hall, settings)?, STEP_SAMPLES);
    let sounding = |step: usize| Some(step / options.turn as usize % options.sources.len());
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
    wav::write(&options.out, &channels[..usize::from(options.hearing.channels())])?;
    say!("{} steps in {}", walk.len(), options.out.display());
    Ok(())
}

impl Options {
    /// The head in each step; at least one.
    fn walk(&self) -> Result<Vec<Listener>, Failure> {
        let what = "an array of [x,y,z,heading], or what `avln sim walk --json` prints";
        let (Poses::Walked { poses } | Poses::Plain(poses)) = read(&self.poses, what)?;
        if !(1..=MOST_STEPS).contains(&poses.len()) {
            let why = format!("it holds {} poses", poses.len());
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
            Ok(listener(&Start { position: base + Vector3::y() * self.ear_height, heading_deg }))
        };
        poses.iter().enumerate().map(head).collect()
    }

    fn emitters(&self, hall: &Hall, settings: Settings) -> Result<Vec<Emitter>, Failure> {
        if self.clips.len() != 1 && self.clips.len() != self.sources.len() {
            let counts = format!("{} clips for {} sources", self.clips.len(), self.sources.len());
            return Err(Failure::new(FailureKind::Data, counts)
                .hinted("name one clip for all sources, or one for each"));
        }
        let clips: Vec<Clip> = self.clips.iter().map(|name| clip(name)).collect::<Result<_, _>>()?;
        let acoustics = hall.acoustics(settings);
        let emitter = |(source, clip): (&Place, &Clip)| Emitter {
            source: acoustics.source(&source.0),
            clip: clip.clone(),
            offset_samples: 0,
        };
        Ok(self.sources.iter().zip(clips.iter().cycle()).map(emitter).collect())
    }
}

/// The clip called `name`; with an ending it is a file.
fn clip(name: &str) -> Result<Clip, Failure> {
    if Path::new(name).extension().is_some() {
        return sounds::read(Path::new(name));
    }
    let bank = Bank::default();
    let names = bank.names();
    let place = names.iter().position(|other| other == name);
    place.and_then(|index| bank.clip(index)).ok_or_else(|| {
        let hint = format!("name a .wav or .flac file, or one of {}", names.join(", "));
        Failure::new(FailureKind::Data, format!("no clip is called '{name}'")).hinted(hint)
    })
}
