//! Acoustic surface properties.

mod table;

use avln_scene::{InstanceId, Scene};

/// Octave bands: 125, 250, 500, 1000, 2000 and 4000 Hz. The last also applies to higher bands.
pub const SURFACE_BANDS: usize = 6;

/// Band names in messages, hertz.
const BAND_NAMES: [&str; SURFACE_BANDS] = ["125", "250", "500", "1000", "2000", "4000"];

/// Energy shares at a surface by octave band, 0 to 1. `1 - absorption - transmission` is reflected, partly
/// diffuse (Lambert's law), partly specular.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Energy share converted into heat.
    pub absorption: [f32; SURFACE_BANDS],
    /// Diffuse share in the reflected energy.
    pub scattering: [f32; SURFACE_BANDS],
    /// Transmitted energy share.
    pub transmission: [f32; SURFACE_BANDS],
}

/// Surface value errors.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SurfaceError {
    /// A share outside 0 to 1.
    #[error("{what} at {band_hz} Hz is {value}; a share of energy must lie between 0 and 1")]
    Share {
        /// `absorption`, `scattering` or `transmission`.
        what: &'static str,
        /// Octave band centre, hertz.
        band_hz: &'static str,
        /// The share.
        value: f32,
    },
    /// Absorption plus transmission above 1.
    #[error(
        "absorption and transmission at {band_hz} Hz are {sum} together; lower one of them, so that the sum is at most 1"
    )]
    Sum {
        /// Octave band centre, hertz.
        band_hz: &'static str,
        /// The sum.
        sum: f32,
    },
}

impl Surface {
    /// Creates a surface with these shares by band.
    ///
    /// # Errors
    /// If a share is outside 0 to 1, or absorption plus transmission exceeds 1.
    pub fn new(
        absorption: [f32; SURFACE_BANDS],
        scattering: [f32; SURFACE_BANDS],
        transmission: [f32; SURFACE_BANDS],
    ) -> Result<Self, SurfaceError> {
        check_shares("absorption", &absorption)?;
        check_shares("scattering", &scattering)?;
        check_shares("transmission", &transmission)?;
        for (band, (absorbed, through)) in absorption.iter().zip(&transmission).enumerate() {
            // Decimal fractions with the sum 1 may exceed 1 slightly in binary.
            let sum = absorbed + through;
            if sum > 1.0 + 1e-6 {
                return Err(SurfaceError::Sum { band_hz: BAND_NAMES[band], sum });
            }
        }
        Ok(Self { absorption, scattering, transmission })
    }

    /// Reflected energy share in `band`, 0 to 1.
    pub fn reflected(&self, band: usize) -> f32 {
        (1.0 - self.absorption[band] - self.transmission[band]).max(0.0)
    }
}

fn check_shares(what: &'static str, shares: &[f32; SURFACE_BANDS]) -> Result<(), SurfaceError> {
    match shares.iter().position(|share| !(0.0..=1.0).contains(share)) {
        Some(band) => Err(SurfaceError::Share { what, band_hz: BAND_NAMES[band], value: shares[band] }),
        None => Ok(()),
    }
}

/// A building's surfaces.
#[derive(Clone, Debug, PartialEq)]
pub struct Surfaces {
    kinds: Vec<Surface>,
    /// Per triangle: index into `kinds`.
    kind_of: Vec<u16>,
}

impl Surfaces {
    /// Assigns `surface` to every triangle.
    pub fn uniform(scene: &Scene, surface: Surface) -> Self {
        Self { kinds: vec![surface], kind_of: vec![0; scene.mesh.triangles.len()] }
    }

    /// Assigns kinds by name: triangle material, object material, object category, in this order; otherwise
    /// the mean of a furnished flat.
    pub fn by_material(scene: &Scene) -> Self {
        let kind_of_material: Vec<_> =
            scene.materials.iter().map(|material| table::find(&material.name)).collect();
        let kind_of_triangle = |triangle: usize| {
            let material = scene.mesh.material_of.get(triangle).map_or(usize::MAX, |m| usize::from(*m));
            let named = kind_of_material.get(material).copied().flatten();
            named.or_else(|| kind_of_object(scene, triangle)).unwrap_or(table::UNKNOWN)
        };
        let kind_of = (0..scene.mesh.triangles.len()).map(|triangle| kind_of_triangle(triangle) as u16);
        Self { kind_of: kind_of.collect(), kinds: table::surfaces() }
    }

    /// Returns a triangle's surface.
    pub fn of(&self, triangle: u32) -> &Surface {
        &self.kinds[usize::from(self.kind_of[triangle as usize])]
    }
}

fn kind_of_object(scene: &Scene, triangle: usize) -> Option<usize> {
    let id = *scene.mesh.instance_of.get(triangle)?;
    let object = (id != InstanceId::NONE).then(|| scene.object(id)).flatten()?;
    table::find(&object.attributes.material).or_else(|| table::find(&object.category))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_outside_of_their_range_are_refused_by_name() {
        let fine = [0.5; SURFACE_BANDS];
        let with = |band: usize, value: f32| {
            let mut shares = fine;
            shares[band] = value;
            shares
        };
        assert!(Surface::new(fine, fine, fine).is_ok());
        let message = |result: Result<Surface, SurfaceError>| result.expect_err("refused").to_string();
        let text = message(Surface::new(with(2, 1.5), fine, [0.0; SURFACE_BANDS]));
        assert_eq!(text, "absorption at 500 Hz is 1.5; a share of energy must lie between 0 and 1");
        assert!(message(Surface::new(fine, with(0, -0.1), fine)).starts_with("scattering at 125 Hz"));
        assert!(message(Surface::new(fine, fine, with(5, f32::NAN))).contains("4000 Hz is NaN"));
        assert!(message(Surface::new(fine, fine, with(1, 0.75))).contains("at 250 Hz are 1.25 together"));
    }
}
