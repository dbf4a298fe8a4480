//! Head models: ear responses to a wave by direction and range.

pub(crate) mod filter;
mod measured;
mod sofa;
mod sphere;

pub use measured::MeasuredHead;
pub use sofa::HeadError;

use crate::late::diffuse::HeardField;
use avln_geom::Vector3;
use filter::{EarResponse, FAR_M};
use sphere::{ear_axes, ear_response};
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
}
