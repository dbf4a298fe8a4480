//! Exact end of a step at a wall: f32 rounding to the inside or outside of the polygon decides between the
//! height of the detail mesh and the straight rim in Detour (`moveAlongSurface`, `getPolyHeight`).

use crate::mesh::NavMesh;
use avln_geom::Point3;

/// A wall segment in Detour's direction.
#[derive(Clone, Copy)]
struct Wall {
    begin: Point3<f32>,
    end: Point3<f32>,
}

impl Wall {
    /// Parameter (0 to 1) of the wall point nearest to `target` in the plane, and the squared distance.
    fn nearest(&self, target: &Point3<f32>) -> (f32, f32) {
        let (along, to) = (self.end - self.begin, target - self.begin);
        let length_squared = along.x * along.x + along.z * along.z;
        let mut share = along.x * to.x + along.z * to.z;
        if length_squared > 0.0 {
            share /= length_squared;
        }
        let share = share.clamp(0.0, 1.0);
        let (x, z) = (self.begin.x + share * along.x - target.x, self.begin.z + share * along.z - target.z);
        (share, x * x + z * z)
    }

    /// Returns true if a ray in x from `place` crosses the wall.
    fn crosses(&self, place: &Point3<f32>) -> bool {
        let (a, b) = (&self.end, &self.begin);
        (a.z > place.z) != (b.z > place.z) && place.x < (b.x - a.x) * (place.z - a.z) / (b.z - a.z) + a.x
    }
}

/// The end of a step to `target` that a wall of `polygon` stopped; `None` for a polygon without walls.
pub(crate) fn stop(mesh: &NavMesh, polygon: u32, target: &Point3<f32>) -> Option<Point3<f32>> {
    let polygons = &mesh.polygons;
    let wall = |edge: u32| {
        let place = |edge: u32| mesh.lattice().corner(polygons.from(edge), polygons.height_m(edge) as f32);
        Wall { begin: place(polygons.next(edge)), end: place(edge) }
    };
    let mut best: Option<(f32, f32, Wall)> = None;
    for edge in polygons.edges(polygon).rev().filter(|&edge| polygons.twin(edge).is_none()) {
        let (share, gap) = wall(edge).nearest(target);
        if best.is_none_or(|(least, ..)| gap < least) {
            best = Some((gap, share, wall(edge)));
        }
    }
    let (_, share, Wall { begin, end }) = best?;
    let mut place = begin + (end - begin) * share;
    let crossed = polygons.edges(polygon).filter(|&edge| wall(edge).crosses(&place)).count();
    if crossed % 2 == 1 {
        place.y = mesh.surface.height_m(polygon, &mesh.lattice().spot(&place));
    }
    Some(place)
}
