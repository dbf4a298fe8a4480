//! A building prepared for sound, and the simulation settings.

use crate::air::Air;
use crate::cache::VERSION;
use crate::head::Head;
use crate::late::cells::Cells;
use crate::planes::Planes;
use crate::surfaces::Surfaces;
use crate::{SAMPLE_RATE_HZ, SPEED_OF_SOUND_M_S};
use avln_geom::{RayMesh, Vector3};
use avln_scene::Scene;
use std::sync::Arc;

/// Simulation scope and resolution. Equal settings give equal bits.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Impulse response length, seconds; later sound is dropped.
    pub response_s: f32,
    /// Rays per source for late energy.
    pub ray_count: usize,
    /// Highest order of discrete reflections, 0 to 3; all others are late energy.
    pub reflection_order: usize,
    /// Head model; [`Source::with_head`](crate::Source::with_head) replaces it.
    pub head: Head,
}

impl Default for Settings {
    fn default() -> Self {
        Self { response_s: 1.0, ray_count: 8192, reflection_order: 2, head: Head::Sphere }
    }
}

impl Settings {
    pub(crate) fn response_samples(&self) -> usize {
        (self.response_s.max(0.0) * SAMPLE_RATE_HZ as f32) as usize
    }

    /// Cache name for the source at a position (as bits) in the building named `building`.
    pub(crate) fn source_name(&self, building: &str, [x, y, z]: [u32; 3]) -> String {
        let (samples, rays, order) = (self.response_samples(), self.ray_count, self.reflection_order);
        format!("{building}-{x:08x}{y:08x}{z:08x}-{samples}-{rays}-{order}-{VERSION}")
    }

    /// Longest path within a response, metres.
    pub(crate) fn reach_m(&self) -> f32 {
        self.response_s.max(0.0) * SPEED_OF_SOUND_M_S
    }
}

#[derive(Clone)]
pub(crate) struct Building {
    pub(crate) air: Arc<Air>,
    pub(crate) planes: Arc<Planes>,
    pub(crate) surfaces: Arc<Surfaces>,
    pub(crate) settings: Settings,
    /// Per triangle: unit normal; 0 for degenerate triangles.
    pub(crate) normals: Arc<[Vector3<f32>]>,
    pub(crate) cells: Arc<Cells>,
}

impl Building {
    pub(crate) fn new(scene: &Scene, rays: Arc<RayMesh>, surfaces: Surfaces, settings: Settings) -> Self {
        let air = Air::new(scene, rays);
        let cells = Cells::new(&air, settings.response_s);
        let normal = |triangle: usize| {
            let [a, b, c] = scene.corners(triangle);
            (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_default()
        };
        let normals = (0..scene.mesh.triangles.len()).map(normal).collect();
        Self {
            air: Arc::new(air),
            planes: Arc::new(Planes::new(scene)),
            surfaces: Arc::new(surfaces),
            settings,
            normals,
            cells: Arc::new(cells),
        }
    }

    /// Returns the same building with settings for levels.
    pub(crate) fn for_levels(&self) -> Self {
        let head = self.settings.head.clone();
        let settings = Settings { response_s: 0.5, ray_count: 2048, reflection_order: 0, head };
        Self { settings, cells: Arc::new(self.cells.larger(&self.air)), ..self.clone() }
    }

    pub(crate) fn byte_count(&self) -> usize {
        self.air.byte_count()
            + self.planes.byte_count()
            + self.cells.byte_count()
            + size_of_val(&*self.normals)
    }
}
