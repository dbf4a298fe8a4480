//! What surfaces do to sound.

use avln_scene::Scene;

/// Octave bands of the tables: 125, 250, 500, 1000, 2000 and 4000 Hz. The last holds for all that is above it, too.
pub const SURFACE_BANDS: usize = 6;

/// Shares of the energy that meets a surface, by octave band (125 to 4000 Hz), each 0 to 1.
///
/// `1 - absorption - transmission` comes back; of that, `scattering` in all directions (Lambert's law) and the rest
/// as from a mirror.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Turned into heat.
    pub absorption: [f32; SURFACE_BANDS],
    /// Of what comes back: thrown in all directions.
    pub scattering: [f32; SURFACE_BANDS],
    /// Goes through.
    pub transmission: [f32; SURFACE_BANDS],
}

/// Painted plaster on masonry, and whatever has no known name.
const PLASTER: Surface = Surface {
    absorption: [0.02, 0.02, 0.03, 0.03, 0.04, 0.05],
    scattering: [0.1; SURFACE_BANDS],
    transmission: [0.0; SURFACE_BANDS],
};

/// The surfaces of a building.
#[derive(Clone, Debug, PartialEq)]
pub struct Surfaces {
    kinds: Vec<Surface>,
    /// Per triangle: index into `kinds`.
    kind_of: Vec<u16>,
}

impl Surfaces {
    /// Every triangle of `scene` of the same kind.
    pub fn uniform(scene: &Scene, surface: Surface) -> Self {
        Self { kinds: vec![surface], kind_of: vec![0; scene.mesh.triangles.len()] }
    }

    /// What the names of the materials of `scene` say.
    pub fn by_material(scene: &Scene) -> Self {
        Self::uniform(scene, PLASTER)
    }

    /// The kind of a triangle.
    pub fn of(&self, triangle: u32) -> &Surface {
        &self.kinds[usize::from(self.kind_of[triangle as usize])]
    }
}
