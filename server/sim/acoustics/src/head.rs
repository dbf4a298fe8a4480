//! Head models: ear responses to a wave by direction and range.

pub(crate) mod filter;
mod measured;
mod sofa;
mod sphere;

pub use measured::MeasuredHead;
pub use sofa::HeadError;

use crate::bands::BANDS;
use crate::late::diffuse::{HeardField, band_energies};
use avln_geom::Vector3;
use filter::{EarResponse, FAR_M};
use sphere::{ear_axes, ear_energy, ear_response, onset_delay_s};
use std::sync::{Arc, OnceLock};

/// A head model.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Head {
    /// A rigid sphere with a radius of 8.75 cm and ears at 100 degrees.
    #[default]
    Sphere,
    /// No head: both ears receive the pressure at the head centre.
    Omni,
    /// A measured head, without distance dependence.
    Measured(Arc<MeasuredHead>),
}

impl Head {
    /// Computes the response to diffuse sound in advance; otherwise the first late energy takes 0.1 s longer.
    pub fn prepare(&self) {
        self.heard_field();
    }

    /// Returns the response to diffuse sound, computed on first use.
    pub(crate) fn heard_field(&self) -> &HeardField {
        static SPHERE: OnceLock<HeardField> = OnceLock::new();
        static OMNI: OnceLock<HeardField> = OnceLock::new();
        let field = match self {
            Self::Sphere => &SPHERE,
            Self::Omni => &OMNI,
            Self::Measured(measured) => &measured.heard_field,
        };
        field.get_or_init(|| HeardField::new(|direction| self.ears(direction, 0.0, FAR_M)))
    }

    /// Returns both ear responses to a wave from `direction` (unit vector, world frame) at `range_m`, at
    /// least 0.1.
    pub(crate) fn ears(&self, direction: &Vector3<f32>, heading_rad: f32, range_m: f32) -> [EarResponse; 2] {
        match self {
            Self::Sphere => ear_axes(heading_rad).map(|axis| ear_response(axis.dot(direction), range_m)),
            Self::Omni => [EarResponse::free_field(), EarResponse::free_field()],
            Self::Measured(measured) => measured.ears(direction, heading_rad),
        }
    }

    /// Returns the energy of [`Head::ears`] by band, relative to the free field.
    pub(crate) fn energies(
        &self,
        direction: &Vector3<f32>,
        heading_rad: f32,
        range_m: f32,
    ) -> [[f32; BANDS]; 2] {
        match self {
            Self::Sphere => ear_axes(heading_rad).map(|axis| ear_energy(axis.dot(direction), range_m)),
            Self::Omni => [[1.0; BANDS]; 2],
            Self::Measured(measured) => {
                measured.ears(direction, heading_rad).map(|ear| band_energies(&ear.filter))
            }
        }
    }

    /// Returns the interaural delay of a wave, seconds; positive if the left ear leads.
    pub(crate) fn lead_s(&self, direction: &Vector3<f32>, heading_rad: f32, range_m: f32) -> f64 {
        let [left, right] = match self {
            Self::Sphere => ear_axes(heading_rad)
                .map(|axis| onset_delay_s(f64::from(axis.dot(direction)), f64::from(range_m))),
            Self::Omni => [0.0; 2],
            Self::Measured(measured) => measured.ears(direction, heading_rad).map(|ear| ear.delay_s),
        };
        right - left
    }
}
