//! Distances put together from exits are those of the mesh.

use avln_geom::Rng;
use avln_houses::{HouseOptions, house};
use avln_navmesh::{Body, CornerWays, Exits, NavMesh, NavPoint, Places};

struct Looked {
    mesh: NavMesh,
    points: Vec<NavPoint>,
    exits: Vec<Exits>,
    ways: Vec<CornerWays>,
}

fn look_around() -> Looked {
    let mesh = NavMesh::build(&house("exits", 5, &HouseOptions::default()), &Body::default())
        .expect("a house has a floor");
    let mut rng = Rng::new(9);
    let points: Vec<_> = (0..24).map(|_| mesh.sample(&mut rng, mesh.largest_island())).collect();
    let places = Places::new(&mesh, &points);
    let exits = points.iter().map(|point| mesh.exits(point, &places)).collect();
    let ways = (0..mesh.corner_count() as u32).map(|corner| mesh.corner_ways(corner)).collect();
    Looked { mesh, points, exits, ways }
}

impl Looked {
    fn distance_m(&self, a: usize, b: usize) -> f64 {
        let straight = self.exits[a].places.iter().find(|place| place.0 == b as u32).map(|place| place.1);
        let bent = self.exits[a].corners.iter().flat_map(|out| {
            let ways = &self.ways[out.corner as usize];
            self.exits[b]
                .corners
                .iter()
                .map(move |home| out.distance_m + ways.distance_m(home.corner) + home.distance_m)
        });
        bent.fold(straight.unwrap_or(f64::INFINITY), f64::min)
    }
}

#[test]
fn exits_and_corner_ways_add_up_to_the_geodesic_distance() {
    let looked = look_around();
    for a in 0..looked.points.len() {
        for b in 0..looked.points.len() {
            let exact = looked.mesh.distance_m(&looked.points[a], &looked.points[b]).expect("one island");
            let sum = looked.distance_m(a, b);
            assert!((sum - exact).abs() < 1e-6, "{a} to {b}: {sum} for {exact}");
        }
    }
}

#[test]
fn corner_paths_are_as_long_as_they_say_and_lead_home() {
    let looked = look_around();
    let home = &looked.ways[0];
    for corner in 0..looked.mesh.corner_count() as u32 {
        let path = home.path(&looked.mesh, corner);
        let walked: f32 = path.windows(2).map(|leg| (leg[1] - leg[0]).norm()).sum();
        if home.distance_m(corner).is_infinite() {
            assert!(path.is_empty());
            continue;
        }
        assert!((f64::from(walked) - home.distance_m(corner)).abs() < 1e-3, "{corner}");
        assert_eq!(path.last(), looked.ways[0].path(&looked.mesh, 0).first());
    }
}
