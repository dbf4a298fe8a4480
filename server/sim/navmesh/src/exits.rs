use crate::field::{Next, spread};
use crate::mesh::{NavMesh, NavPoint};
use crate::plane::Spot;
use avln_geom::Point3;

/// Points of a mesh for repeated distance queries, identified by index.
pub struct Places {
    /// Polygon, index, spot and height, ordered by polygon.
    places: Vec<(u32, u32, Spot, f64)>,
}

/// Exits of a mesh point: the first corners of shortest paths, and the points in straight reach.
///
/// With the [`CornerWays`] of the mesh, distances between points with known exits are sums: the straight
/// distance, or the minimum over exit, path between corners, and exit.
#[derive(Clone, Debug, Default)]
pub struct Exits {
    /// Corners in view that a shortest way can bend around, ascending by corner, each once.
    pub corners: Vec<Exit>,
    /// Points in straight reach with distances in metres, ascending by index.
    pub places: Vec<(u32, f64)>,
}

/// A corner in straight reach.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exit {
    /// Corner index, below [`NavMesh::corner_count`].
    pub corner: u32,
    /// Distance, metres.
    pub distance_m: f64,
}

/// Shortest paths from all corners of a mesh to a corner.
pub struct CornerWays {
    home: u32,
    corners: Vec<(f64, Next)>,
}

impl Places {
    /// Stores `points` of `mesh` for visibility queries.
    pub fn new(mesh: &NavMesh, points: &[NavPoint]) -> Self {
        let place = |(point, index): (&NavPoint, u32)| {
            let eye = mesh.eye(point);
            (eye.polygon, index, eye.spot, f64::from(point.position().y))
        };
        let mut places: Vec<_> = points.iter().zip(0..).map(place).collect();
        places.sort_unstable_by_key(|place| (place.0, place.1));
        Self { places }
    }

    fn on(&self, polygon: u32) -> impl Iterator<Item = &(u32, u32, Spot, f64)> {
        let first = self.places.partition_point(|place| place.0 < polygon);
        self.places[first..].iter().take_while(move |place| place.0 == polygon)
    }
}

impl NavMesh {
    /// Corner count.
    pub fn corner_count(&self) -> usize {
        self.corners.len()
    }

    /// Exits of `point`: corners, and the visible `places`.
    pub fn exits(&self, point: &NavPoint, places: &Places) -> Exits {
        let outlook = self.outlook(point);
        let exit = |link: &crate::corners::Link| Exit { corner: link.to, distance_m: link.metres };
        let mut exits = Exits { corners: outlook.links().iter().map(exit).collect(), places: Vec::new() };
        for (polygon, view) in outlook.views() {
            let here = places.on(*polygon).filter(|(_, _, spot, _)| view.holds(spot));
            let apart_m = |spot, height_m| self.lattice().apart_m((spot, height_m), outlook.place());
            exits.places.extend(here.map(|(_, index, spot, height_m)| (*index, apart_m(spot, *height_m))));
        }
        exits.places.sort_unstable_by_key(|place| place.0);
        exits.places.dedup_by_key(|place| place.0);
        exits.corners.sort_unstable_by_key(|exit| exit.corner);
        exits.corners.dedup_by_key(|exit| exit.corner);
        exits
    }

    /// Shortest paths from all corners to `corner`.
    ///
    /// # Panics
    /// If `corner` is out of range.
    pub fn corner_ways(&self, corner: u32) -> CornerWays {
        let mut corners = vec![(f64::INFINITY, Next::Nowhere); self.corners.len()];
        corners[corner as usize] = (0.0, Next::Nowhere);
        spread(&self.corners, &mut corners);
        CornerWays { home: corner, corners }
    }
}

impl CornerWays {
    /// Path length from `corner`, metres; infinite without a path.
    ///
    /// # Panics
    /// If `corner` is out of range.
    pub fn distance_m(&self, corner: u32) -> f64 {
        self.corners[corner as usize].0
    }

    /// Bends of the path from `corner`: `corner` first, the target corner last; empty without a path.
    ///
    /// # Panics
    /// If `corner` is out of range, or `mesh` is a different, smaller mesh.
    pub fn path(&self, mesh: &NavMesh, corner: u32) -> Vec<Point3<f32>> {
        if self.corners[corner as usize].0.is_infinite() {
            return Vec::new();
        }
        let mut path = vec![mesh.corner_position(corner)];
        let mut at = corner;
        while at != self.home
            && let Next::Corner(next) = self.corners[at as usize].1
        {
            path.push(mesh.corner_position(next));
            at = next;
        }
        path
    }
}
