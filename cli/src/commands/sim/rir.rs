use super::hall::SurroundingsArgs;
use super::listen::write_wav;
use super::listen::{HearingArgs, Position, listener};
use super::text;
use super::walk::StartPose;
use crate::output::say;
use avln_acoustics::{BandMeasures, ImpulseResponse, Measures, SURFACE_BANDS, Source, interaural_delay_s};
use avln_arena::Failure;
use clap::Args;
use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};
use std::path::PathBuf;

/// Octave bands, hertz.
const BANDS: [&str; SURFACE_BANDS] = ["125", "250", "500", "1000", "2000", "4000"];

/// Arguments of `avln sim rir`.
#[derive(Debug, Args)]
pub struct RirArgs {
    #[command(flatten)]
    surroundings: SurroundingsArgs,
    /// Omnidirectional point source: x,y,z in metres
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    source: Position,
    /// The centre of the head: x,y,z in metres and the heading in degrees; 0 looks along -Z, left is positive
    #[arg(long, value_name = "X,Y,Z,HEADING", allow_hyphen_values = true)]
    listener: StartPose,
    #[command(flatten)]
    hearing: HearingArgs,
    /// Write the response: 16 kHz, 32-bit float, left and right ear; one channel with --omni. Sample 0 is when the source
    /// sounds, and its pressure 1 m away, without walls, is a pulse of height 1
    #[arg(long, value_name = "RIR.wav")]
    out: Option<PathBuf>,
    /// Print the measures as JSON; null for undefined values
    #[arg(long)]
    json: bool,
}

/// Measures of an impulse response.
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
    /// End of the response.
    length_s: f32,
}

/// A number per octave band.
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

pub(super) fn run(args: &RirArgs) -> Result<(), Failure> {
    let hall = args.surroundings.open()?;
    let listener = listener(&args.listener);
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
    fn new(
        source: &Source,
        listener: &avln_acoustics::Listener,
        response: &ImpulseResponse,
        length_s: f32,
    ) -> Self {
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
        say!(
            "  from           {} degrees to the left",
            shown(self.first_arrival_azimuth_deg.map(f64::from), 1)
        );
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
