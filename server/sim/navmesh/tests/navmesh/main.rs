//! Navmesh tests against hand-computed distances and brute force.

mod distances;
mod flat;
mod habitat;
mod scenes;

use avln_geom::{Point2, Point3};
use avln_navmesh::{Body, NavMesh};
use avln_scene::{InstanceId, Lighting, Material, Mesh, Scene};

pub(crate) type Corner = [f32; 3];

/// A scene under construction.
#[derive(Default)]
pub(crate) struct Builder {
    mesh: Mesh,
}

impl Builder {
    /// A rectangle that faces upwards between two corners of equal height.
    pub(crate) fn floor(self, low: Corner, high: Corner) -> Self {
        let y = low[1];
        self.quad([[low[0], y, low[2]], [low[0], y, high[2]], [high[0], y, high[2]], [high[0], y, low[2]]])
    }

    /// A closed box between two corners.
    pub(crate) fn block(self, low: Corner, high: Corner) -> Self {
        let ([x0, y0, z0], [x1, y1, z1]) = (low, high);
        self.floor([x0, y1, z0], [x1, y1, z1])
            .quad([[x0, y0, z0], [x1, y0, z0], [x1, y0, z1], [x0, y0, z1]])
            .quad([[x0, y0, z1], [x1, y0, z1], [x1, y1, z1], [x0, y1, z1]])
            .quad([[x1, y0, z0], [x0, y0, z0], [x0, y1, z0], [x1, y1, z0]])
            .quad([[x1, y0, z1], [x1, y0, z0], [x1, y1, z0], [x1, y1, z1]])
            .quad([[x0, y0, z0], [x0, y0, z1], [x0, y1, z1], [x0, y1, z0]])
    }

    /// Four walls, 0.2 m thick and 2.5 m high, around a rectangle of floor at height 0.
    pub(crate) fn walls_around(self, [x0, z0]: [f32; 2], [x1, z1]: [f32; 2]) -> Self {
        self.block([x0 - 0.2, 0.0, z0 - 0.2], [x1 + 0.2, 2.5, z0])
            .block([x0 - 0.2, 0.0, z1], [x1 + 0.2, 2.5, z1 + 0.2])
            .block([x0 - 0.2, 0.0, z0], [x0, 2.5, z1])
            .block([x1, 0.0, z0], [x1 + 0.2, 2.5, z1])
    }

    fn quad(mut self, corners: [Corner; 4]) -> Self {
        let first = self.mesh.positions.len() as u32;
        self.mesh.positions.extend(corners.map(Point3::from));
        self.mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        self
    }

    pub(crate) fn scene(mut self) -> Scene {
        let (corners, triangles) = (self.mesh.positions.len(), self.mesh.triangles.len());
        self.mesh.uvs = vec![Point2::origin(); corners];
        self.mesh.colors = vec![[255; 3]; corners];
        self.mesh.material_of = vec![0; triangles];
        self.mesh.instance_of = vec![InstanceId::NONE; triangles];
        let material =
            Material { name: "plaster".into(), base_color: [200; 4], texture: None, alpha_cutoff: None };
        Scene {
            name: "blocks".into(),
            mesh: self.mesh,
            materials: vec![material],
            textures: Vec::new(),
            regions: Vec::new(),
            objects: Vec::new(),
            lighting: Lighting::Painted,
        }
    }

    pub(crate) fn build(self) -> NavMesh {
        NavMesh::build(&self.scene(), &Body::default()).expect("a floor to stand on")
    }
}

/// A hall of 10 x 6 m, divided at x = 5 m by a wall of 0.1 m with a doorway between z = 2.5 m and z = 3.5 m.
pub(crate) fn two_rooms() -> NavMesh {
    hall().block([4.95, 0.0, 0.0], [5.05, 2.5, 2.5]).block([4.95, 0.0, 3.5], [5.05, 2.5, 6.0]).build()
}

/// The hall without the dividing wall.
pub(crate) fn hall() -> Builder {
    Builder::default().floor([0.0; 3], [10.0, 0.0, 6.0]).walls_around([0.0, 0.0], [10.0, 6.0])
}
