//! `avln sim listen` and `avln sim rir`: sound on a walk, and impulse responses.

use crate::{
    commands::sim::{
        StartPose, numbers, read,
        surroundings::{Surroundings, SurroundingsArgs},
        text, unusable,
    },
    output::{cannot_write, say},
};
use avln_acoustics::{
    BandMeasures, Bank, Clip, Ears, Emitter, Head, ImpulseResponse, Listener, Measures, SAMPLE_RATE_HZ,
    SURFACE_BANDS, Settings, Source, interaural_delay_s,
};
use avln_arena::{Failure, audio};
use avln_geom::{Point3, Vector3};
use clap::Args;
use hound::{SampleFormat, WavSpec, WavWriter};
use serde::{Deserialize, Serialize, Serializer, ser::SerializeMap};
use std::{
    path::{Path, PathBuf},
    str::FromStr,
};

/// Samples per step: 0.25 s.
const STEP_SAMPLES: usize = SAMPLE_RATE_HZ as usize / 4;

const MOST_STEPS: usize = 4000;

#[derive(Debug, Args)]
pub(crate) struct ListenArgs {
    #[command(flatten)]
    surroundings: SurroundingsArgs,
    /// Omnidirectional point source: x,y,z in metres. Several sources take turns
    #[arg(long = "source", value_name = "X,Y,Z", allow_hyphen_values = true, required = true)]
    sources: Vec<Position>,
    /// Steps per turn
    #[arg(long, value_name = "STEPS", default_value_t = 25, value_parser = clap::value_parser!(u32).range(1..))]
    turn: u32,
    /// Source clip: a synthetic clip's name, or a WAV or FLAC file. Either for all sources, or per source
    #[arg(long = "clip", value_name = "NAME|FILE", default_value = "pink-bursts-0")]
    clips: Vec<String>,
    /// Body poses per 0.25 s step: [[x,y,z,heading],...] in metres and degrees, or the output from `avln sim
    /// walk --json`; at most 4000
    #[arg(long, value_name = "FILE.json")]
    poses: PathBuf,
    /// Ear height above the poses, metres
    #[arg(long, value_name = "METRES", default_value_t = 1.0, allow_hyphen_values = true)]
    ear_height: f32,
    #[command(flatten)]
    hearing: HearingArgs,
    /// Output file: 16 kHz, 32-bit float, left and right ear; a single channel with --omni. The reverberation
    /// follows the last step
    #[arg(long, value_name = "WALK.wav")]
    out: PathBuf,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum PoseFile {
    Walked { poses: Vec<[f64; 4]> },
    Plain(Vec<[f64; 4]>),
}

pub(super) fn run_listen(args: &ListenArgs) -> Result<(), Failure> {
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
        for (all, ear) in heard.iter_mut().zip(step.chunks_exact(STEP_SAMPLES)) {
            all.extend_from_slice(ear);
        }
    }
    let channels = heard.each_ref().map(Vec::as_slice);
    write_wav(&args.out, &channels[..usize::from(args.hearing.channels())])?;
    say!("{} steps in {}", walk.len(), args.out.display());
    Ok(())
}

impl ListenArgs {
    /// Returns the listener per step; never empty.
    fn walk(&self) -> Result<Vec<Listener>, Failure> {
        let what = "an array of [x,y,z,heading], or what `avln sim walk --json` prints";
        let (PoseFile::Walked { poses } | PoseFile::Plain(poses)) = read(&self.poses, what)?;
        if !(1..=MOST_STEPS).contains(&poses.len()) {
            let why = format!("it contains {} poses", poses.len());
            let hint = format!("write 1 to {MOST_STEPS} poses, one for each step");
            return Err(unusable(&self.poses, why, hint));
        }
        let head = |(index, pose): (usize, &[f64; 4])| {
            let [x, y, z, heading_deg] = *pose;
            if !pose.iter().all(|value| value.abs() < 1e6) {
                let why = format!("pose {index} is out of reach");
                return Err(unusable(&self.poses, why, "write metres and degrees"));
            }
            let base = Point3::new(x as f32, y as f32, z as f32);
            Ok(listener_at(&StartPose { position: base + Vector3::y() * self.ear_height, heading_deg }))
        };
        poses.iter().enumerate().map(head).collect()
    }

    fn emitters(&self, hall: &Surroundings, settings: Settings) -> Result<Vec<Emitter>, Failure> {
        if self.clips.len() != 1 && self.clips.len() != self.sources.len() {
            let counts = format!("{} clips for {} sources", self.clips.len(), self.sources.len());
            return Err(Failure::data(counts).hinted("name one clip for all sources, or one for each"));
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
        Failure::data(format!("no clip is called '{name}'")).hinted(hint)
    })
}

/// Largest distance from the origin, metres.
const REACH_M: f32 = 1e6;

#[derive(Debug, Args)]
pub(super) struct HearingArgs {
    /// Impulse response length, seconds from 0.01 to 20 [default: by Sabine's formula]
    #[arg(long, value_name = "SECONDS")]
    seconds: Option<Seconds>,
    /// Rays for late reverberation, 0 (none) to 4194304
    #[arg(long, value_name = "COUNT", default_value_t = Settings::default().ray_count as u32, value_parser = clap::value_parser!(u32).range(0..=1 << 22))]
    rays: u32,
    /// Highest early reflection order, 0 to 3
    #[arg(long, value_name = "ORDER", default_value_t = Settings::default().reflection_order as u8, value_parser = clap::value_parser!(u8).range(0..=3))]
    reflections: u8,
    /// Output the pressure at the head's centre instead of two ears
    #[arg(long)]
    omni: bool,
    /// SOFA file with a measured head, instead of a sphere
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

    pub(super) fn channels(&self) -> u16 {
        if self.omni { 1 } else { 2 }
    }
}

pub(super) fn listener_at(start: &StartPose) -> Listener {
    Listener { position: start.position, heading_rad: (start.heading_deg % 360.0).to_radians() as f32 }
}

impl FromStr for Position {
    type Err = String;
    fn from_str(words: &str) -> Result<Self, String> {
        let values: Vec<f32> = numbers(words, &[','])?;
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

/// Writes channels, padded with silence to equal length: 32-bit float, 16 kHz.
pub(super) fn write_wav(file: &Path, channels: &[&[f32]]) -> Result<(), Failure> {
    let failed = |error: hound::Error| cannot_write(file, error);
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

/// Octave bands, hertz.
const BANDS: [&str; SURFACE_BANDS] = ["125", "250", "500", "1000", "2000", "4000"];

#[derive(Debug, Args)]
pub(crate) struct RirArgs {
    #[command(flatten)]
    surroundings: SurroundingsArgs,
    /// Omnidirectional point source: x,y,z in metres
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    source: Position,
    /// Head centre: x,y,z in metres and the heading in degrees; 0 looks along -Z, left is positive
    #[arg(long, value_name = "X,Y,Z,HEADING", allow_hyphen_values = true)]
    listener: StartPose,
    #[command(flatten)]
    hearing: HearingArgs,
    /// Write the response: 16 kHz, 32-bit float, left and right ear; a single channel with --omni. The source
    /// sounds at sample 0. At 1 m, without walls, the pressure is a pulse with height 1
    #[arg(long, value_name = "RIR.wav")]
    out: Option<PathBuf>,
    /// Print the measures as JSON; null for undefined values
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Serialize)]
struct RirReport {
    /// Until the first wave passes the head's centre.
    direct_delay_s: Option<f64>,
    drr_db: Option<f64>,
    /// Positive to the left, 0 ahead.
    first_arrival_azimuth_deg: Option<f32>,
    /// Positive when the left ear leads.
    itd_us: Option<f64>,
    level_db: ByBand,
    t20_s: ByBand,
    t30_s: ByBand,
    edt_s: ByBand,
    c50_db: ByBand,
    ild_db: ByBand,
    /// Response length.
    length_s: f32,
}

#[derive(Debug)]
struct ByBand([Option<f64>; SURFACE_BANDS]);

impl Serialize for ByBand {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(SURFACE_BANDS))?;
        for (band, value) in BANDS.iter().zip(self.0) {
            map.serialize_entry(band, &value)?;
        }
        map.end()
    }
}

pub(super) fn run_rir(args: &RirArgs) -> Result<(), Failure> {
    let hall = args.surroundings.open()?;
    let listener = listener_at(&args.listener);
    hall.check("the source", &args.source.0)?;
    hall.check("the listener", &listener.position)?;
    let settings = args.hearing.settings(hall.response_s())?;
    let length_s = settings.response_s;
    let source = hall.acoustics(settings).source(&args.source.0);
    let response = source.impulse_response(&listener);
    if let Some(file) = &args.out {
        let channels: [&[f32]; 2] = [&response.left, &response.right];
        write_wav(file, &channels[..usize::from(args.hearing.channels())])?;
    }
    let report = RirReport::new(&source, &listener, &response, length_s);
    match args.json {
        true => say!("{}", text(&report)?),
        false => report.print(),
    }
    Ok(())
}

impl RirReport {
    fn new(source: &Source, listener: &Listener, response: &ImpulseResponse, length_s: f32) -> Self {
        let first = source.first_wave(listener);
        let delay_s = first.as_ref().map(|first| first.delay_s);
        let measures = Measures::of(response, delay_s.unwrap_or(0.0), f64::from(length_s));
        let by_band = |value: fn(&BandMeasures) -> Option<f64>| ByBand(measures.bands.each_ref().map(value));
        Self {
            direct_delay_s: delay_s,
            drr_db: measures.drr_db,
            first_arrival_azimuth_deg: first.as_ref().map(|first| first.azimuth_rad.to_degrees()),
            itd_us: first.and_then(|first| interaural_delay_s(&first.response)).map(|lead_s| lead_s * 1e6),
            level_db: by_band(|band| band.level_db),
            t20_s: by_band(|band| band.t20_s),
            t30_s: by_band(|band| band.t30_s),
            edt_s: by_band(|band| band.edt_s),
            c50_db: by_band(|band| band.c50_db),
            ild_db: by_band(|band| band.ild_db),
            length_s,
        }
    }

    fn print(&self) {
        let shown = |value: Option<f64>, digits: usize| {
            value.map_or_else(|| format!("{:>9}", "-"), |value| format!("{value:>9.digits$}"))
        };
        say!("first wave       {} ms", shown(self.direct_delay_s.map(|delay_s| delay_s * 1e3), 3));
        let azimuth_deg = self.first_arrival_azimuth_deg.map(f64::from);
        say!("  from           {} degrees to the left", shown(azimuth_deg, 1));
        say!("  left ear leads {} us", shown(self.itd_us, 0));
        say!("direct over rest {} dB", shown(self.drr_db, 1));
        say!("{:<17}{}", "Hz", BANDS.map(|band| format!("{band:>9}")).concat());
        for (name, values, digits) in [
            ("level, dB", &self.level_db, 1),
            ("T20, s", &self.t20_s, 3),
            ("T30, s", &self.t30_s, 3),
            ("EDT, s", &self.edt_s, 3),
            ("C50, dB", &self.c50_db, 1),
            ("ILD, dB", &self.ild_db, 1),
        ] {
            say!("{name:<17}{}", values.0.map(|value| shown(value, digits)).concat());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_arena::FailureKind;

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
