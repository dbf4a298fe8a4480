//! Who listens, where, and to what: as the command line says it.

use super::walk::Start;
use avln_acoustics::{Head, Listener, Settings};
use avln_arena::{Failure, heads};
use avln_geom::Point3;
use clap::Args;
use std::path::PathBuf;
use std::str::FromStr;

/// Farther from the origin no source and no listener may be, metres.
const REACH_M: f32 = 1e6;

/// How sound is computed, and for whom.
#[derive(Debug, Args)]
pub(super) struct Hearing {
    /// Length of the impulse response, seconds from 0.01 to 20 [default: what Sabine's formula expects of the surfaces]
    #[arg(long, value_name = "SECONDS")]
    seconds: Option<Seconds>,
    /// Rays that carry the late sound, 0 (none of it) to 4194304
    #[arg(long, value_name = "COUNT", default_value_t = Settings::default().ray_count as u32, value_parser = clap::value_parser!(u32).range(0..=1 << 22))]
    rays: u32,
    /// Highest order of reflections that are waves of their own, 0 to 3
    #[arg(long, value_name = "ORDER", default_value_t = Settings::default().reflection_order as u8, value_parser = clap::value_parser!(u8).range(0..=3))]
    reflections: u8,
    /// Hear the pressure at the place of the head's centre instead of two ears
    #[arg(long)]
    omni: bool,
    /// Hear with a measured head instead of a sphere: a SOFA file of head-related impulse responses
    #[arg(long, value_name = "FILE.sofa", conflicts_with = "omni")]
    head: Option<PathBuf>,
}

/// A place, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Place(pub(super) Point3<f32>);

#[derive(Clone, Copy, Debug, PartialEq)]
struct Seconds(f32);

impl Hearing {
    /// The settings; responses are `response_s` long unless a length was asked for.
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
        Ok(heads::read(file)?.1)
    }

    /// Channels of what is heard.
    pub(super) fn channels(&self) -> u16 {
        if self.omni { 1 } else { 2 }
    }
}

/// The head that stands as `start` says.
pub(super) fn listener(start: &Start) -> Listener {
    Listener { position: start.position, heading_rad: (start.heading_deg % 360.0).to_radians() as f32 }
}

impl FromStr for Place {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_three_finite_numbers() {
        assert_eq!("1, -2,0.5".parse(), Ok(Place(Point3::new(1.0, -2.0, 0.5))));
        for bad in ["", "1,2", "1,2,3,4", "1,2,NaN", "1,inf,2", "1,2,1e9", "a,b,c"] {
            assert!(bad.parse::<Place>().is_err(), "{bad}");
        }
    }

    #[test]
    fn responses_are_neither_nothing_nor_endless() {
        assert_eq!("2.5".parse(), Ok(Seconds(2.5)));
        for bad in ["0", "-1", "21", "NaN", "inf", "long"] {
            assert!(bad.parse::<Seconds>().is_err(), "{bad}");
        }
    }
}
