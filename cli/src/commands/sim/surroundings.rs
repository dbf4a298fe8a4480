//! Acoustic surroundings: a building or a test room with surfaces.

use crate::commands::{
    scene::open_or_build,
    sim::{numbers, read, unusable},
};
use avln_acoustics::{Acoustics, SURFACE_BANDS, Settings, Surface, Surfaces, expected_reverberation_s};
use avln_arena::Failure;
use avln_geom::{Point3, RayMesh};
use avln_houses::Pool;
use avln_scene::{RoomPlan, Scene};
use clap::Args;
use serde::Deserialize;
use std::{path::PathBuf, str::FromStr, sync::Arc};

const USUAL_ABSORPTION: f32 = 0.1;
const USUAL_SCATTERING: f32 = 0.1;

/// Bounds for the default response length, seconds.
const SHORTEST_S: f32 = 0.5;
const LONGEST_S: f32 = 10.0;

/// Building and surfaces.
#[derive(Debug, Args)]
pub(super) struct SurroundingsArgs {
    #[command(flatten)]
    choice: SurroundingsChoice,
    /// Absorbed energy share for all surfaces, instead of the scene's materials: a value from 0 to 1, or six
    /// for 125, 250, 500, 1000, 2000 and 4000 Hz [default in test rooms: 0.1]
    #[arg(long, value_name = "A[,...]")]
    absorption: Option<Shares>,
    /// Scattered share (Lambert) of reflected energy for all surfaces, a value or six; the rest is mirrored
    /// [default in test rooms: 0.1]
    #[arg(long, value_name = "S[,...]")]
    scattering: Option<Shares>,
}

/// Either a building or a test room.
#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
struct SurroundingsChoice {
    /// Scene file or folder, in any supported layout
    #[arg(long, value_name = "PATH")]
    scene: Option<PathBuf>,
    /// Seed for a procedural house
    #[arg(long)]
    seed: Option<u64>,
    /// Box-shaped test room from the origin: metres in x, z and y
    #[arg(long, value_name = "LxWxH")]
    shoebox: Option<Shoebox>,
    /// Test room with vertical walls and the floor at y = 0: {"vertices": [[x,z],...], "height_m": 2.7} in metres, corners in order
    #[arg(long, value_name = "FILE.json")]
    polygon: Option<PathBuf>,
}

/// Energy shares by octave band.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Shares([f32; SURFACE_BANDS]);

/// Lengths in x, z and y, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Shoebox([f32; 3]);

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Polygon {
    vertices: Vec<[f32; 2]>,
    height_m: f32,
}

pub(super) struct Surroundings {
    scene: Scene,
    surfaces: Surfaces,
    /// Test room plan; `None` for a building.
    plan: Option<RoomPlan>,
}

impl SurroundingsArgs {
    pub(super) fn open(&self) -> Result<Surroundings, Failure> {
        let plan = self.choice.plan()?;
        let scene = match &plan {
            Some(plan) => plan.scene(),
            None => open_or_build(self.choice.scene.as_deref(), self.choice.seed, Pool::default())?,
        };
        let alike = plan.is_some() || self.absorption.is_some() || self.scattering.is_some();
        let surfaces = match alike {
            true => Surfaces::uniform(&scene, self.surface()),
            false => Surfaces::by_material(&scene),
        };
        Ok(Surroundings { scene, surfaces, plan })
    }

    fn surface(&self) -> Surface {
        let shares = |given: Option<Shares>, usual| given.map_or([usual; SURFACE_BANDS], |shares| shares.0);
        Surface {
            absorption: shares(self.absorption, USUAL_ABSORPTION),
            scattering: shares(self.scattering, USUAL_SCATTERING),
            transmission: [0.0; SURFACE_BANDS],
        }
    }
}

impl SurroundingsChoice {
    fn plan(&self) -> Result<Option<RoomPlan>, Failure> {
        if let Some(Shoebox([x_m, z_m, y_m])) = self.shoebox {
            let named = |error| Failure::scene(format!("--shoebox: {error}"));
            return RoomPlan::shoebox(x_m, z_m, y_m).map(Some).map_err(named);
        }
        let Some(file) = &self.polygon else { return Ok(None) };
        let what = r#"{"vertices": [[x,z],...], "height_m": 2.7}, metres"#;
        let polygon: Polygon = read(file, what)?;
        let plan = RoomPlan::new(&polygon.vertices, polygon.height_m);
        plan.map(Some)
            .map_err(|error| unusable(file, error, format!("the file holds {what}; corner 0 is the first")))
    }
}

impl Surroundings {
    /// Expected reverberation time, seconds.
    pub(super) fn response_s(&self) -> f32 {
        expected_reverberation_s(&self.scene, &self.surfaces).clamp(SHORTEST_S, LONGEST_S)
    }

    /// Rejects a position outside a test room. `what` is the name in the message.
    pub(super) fn check(&self, what: &str, place: &Point3<f32>) -> Result<(), Failure> {
        if self.plan.as_ref().is_none_or(|plan| plan.contains(place)) {
            return Ok(());
        }
        let ends = self.scene.bounds().map(|bounds| format!("{:?} to {:?}", bounds.min, bounds.max));
        let message = format!("{what} at {}, {}, {} is outside of the room", place.x, place.y, place.z);
        let hint = format!("the room lies within {} (x, y, z in metres)", ends.unwrap_or_default());
        Err(Failure::scene(message).hinted(hint))
    }

    pub(super) fn acoustics(&self, settings: Settings) -> Acoustics {
        let rays = Arc::new(RayMesh::new(&self.scene.mesh.positions, &self.scene.mesh.triangles));
        Acoustics::new(&self.scene, rays, self.surfaces.clone(), settings)
    }
}

impl FromStr for Shares {
    type Err = String;
    fn from_str(words: &str) -> Result<Self, String> {
        let values: Vec<f32> = numbers(words, &[','])?;
        if let Some(value) = values.iter().find(|value| !(0.0..=1.0).contains(*value)) {
            return Err(format!("{value} is not an energy share; write 0 to 1"));
        }
        match *values.as_slice() {
            [all] => Ok(Self([all; SURFACE_BANDS])),
            _ => values.as_slice().try_into().map(Self).map_err(|_| {
                let count = values.len();
                format!("{count} shares; write one, or six for 125, 250, 500, 1000, 2000 and 4000 Hz")
            }),
        }
    }
}

impl FromStr for Shoebox {
    type Err = String;
    fn from_str(words: &str) -> Result<Self, String> {
        let values = numbers(words, &['x', 'X'])?;
        let count = values.len();
        values.try_into().map(Self).map_err(|_| format!("{count} lengths; write three, such as 6x5x3"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn share_list_has_one_or_six_values() {
        assert_eq!("0.25".parse(), Ok(Shares([0.25; 6])));
        assert_eq!("0,0.1,0.2, 0.3,0.4,1".parse(), Ok(Shares([0.0, 0.1, 0.2, 0.3, 0.4, 1.0])));
        for bad in ["", "1.1", "-0.1", "NaN", "0.1,0.2", "a", "0.1,,0.1"] {
            assert!(bad.parse::<Shares>().is_err(), "{bad}");
        }
    }

    #[test]
    fn boxes_are_three_lengths() {
        assert_eq!("6x5X3".parse(), Ok(Shoebox([6.0, 5.0, 3.0])));
        for bad in ["6x5", "6x5x3x1", "6,5,3", "axbxc", ""] {
            assert!(bad.parse::<Shoebox>().is_err(), "{bad}");
        }
    }
}
