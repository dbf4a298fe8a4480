//! Small scenes for unit tests.

use crate::building::{Building, Settings};
use crate::surfaces::{Surface, Surfaces};
use avln_geom::{Point3, RayMesh, angle};
use avln_scene::{InstanceId, Lighting, Mesh, Scene};
use std::sync::Arc;

/// Triangles with separate corners.
#[derive(Clone, Default)]
pub(crate) struct Soup {
    pub(crate) corners: Vec<[f32; 3]>,
}

impl Soup {
    /// The inside of a box with a corner at the origin, each wall cut into `pieces` times `pieces`.
    pub(crate) fn room(size: [f32; 3], pieces: usize) -> Self {
        let mut soup = Self::default();
        for axis in 0..3 {
            for side in [0.0, size[axis]] {
                soup.wall(size, axis, side, pieces);
            }
        }
        soup
    }

    fn wall(&mut self, size: [f32; 3], axis: usize, side: f32, pieces: usize) {
        let across = [(axis + 1) % 3, (axis + 2) % 3];
        let at = |u: usize, v: usize| {
            let mut corner = [side; 3];
            corner[across[0]] = size[across[0]] * u as f32 / pieces as f32;
            corner[across[1]] = size[across[1]] * v as f32 / pieces as f32;
            corner
        };
        for (u, v) in (0..pieces).flat_map(|u| (0..pieces).map(move |v| (u, v))) {
            self.quad([at(u, v), at(u + 1, v), at(u + 1, v + 1), at(u, v + 1)]);
        }
    }

    /// Adds two triangles.
    pub(crate) fn quad(&mut self, [a, b, c, d]: [[f32; 3]; 4]) {
        self.corners.extend([a, b, c, a, c, d]);
    }

    /// Rotates everything about the vertical axis.
    pub(crate) fn rotated(mut self, heading_rad: f32) -> Self {
        let (sin, cos) = angle::sin_cos(heading_rad);
        self.corners.iter_mut().for_each(|[x, _, z]| (*x, *z) = (cos * *x + sin * *z, cos * *z - sin * *x));
        self
    }

    /// Moves all corners; coincident corners stay together.
    pub(crate) fn shake(&mut self, mut offset: impl FnMut() -> f32) {
        let mut moved = std::collections::BTreeMap::new();
        for corner in &mut self.corners {
            let key = corner.map(f32::to_bits);
            let place = *corner;
            *corner = *moved.entry(key).or_insert_with(|| place.map(|at| at + offset()));
        }
    }
}

/// The soup as a scene without materials.
pub(crate) fn scene(soup: &Soup) -> Scene {
    let count = soup.corners.len();
    let mesh = Mesh {
        positions: soup.corners.iter().map(|corner| Point3::from(*corner)).collect(),
        uvs: vec![Default::default(); count],
        colors: vec![[255; 3]; count],
        triangles: (0..count as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
        material_of: vec![0; count / 3],
        instance_of: vec![InstanceId::NONE; count / 3],
    };
    Scene {
        name: "test".into(),
        mesh,
        materials: Vec::new(),
        textures: Vec::new(),
        regions: Vec::new(),
        objects: Vec::new(),
        lighting: Lighting::Painted,
    }
}

/// Hard and smooth.
pub(crate) const HARD: Surface =
    Surface { absorption: [0.1; 6], scattering: [0.1; 6], transmission: [0.0; 6] };

/// A building with a single kind of surface.
pub(crate) fn building(soup: &Soup, surface: Surface, settings: Settings) -> Building {
    let scene = scene(soup);
    let rays = Arc::new(RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles));
    Building::new(&scene, rays, Surfaces::uniform(&scene, surface), settings)
}

impl Soup {
    /// Adds the six sides of a block between two opposite corners.
    pub(crate) fn block(&mut self, low: [f32; 3], high: [f32; 3]) {
        let mut shape = Self::room([0, 1, 2].map(|axis| high[axis] - low[axis]), 1);
        shape.corners.iter_mut().for_each(|corner| *corner = [0, 1, 2].map(|axis| corner[axis] + low[axis]));
        self.corners.extend(shape.corners);
    }
}
