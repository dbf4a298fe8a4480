//! Numbers that Recast 1.6 and Detour, run as habitat-sim runs them, gave for the same house.

use crate::houses::shared;
use avln_geom::{Point3, Vector3, angle};
use avln_navmesh::{Body, NavMesh, NavMeshSettings};

type Place = [f32; 3];

/// From, to, metres; infinite without a path.
const PATHS: [(Place, Place, f64); 12] = [
    ([-2.05, 0.2, -4.87], [-0.82, 0.2, 3.96], 8.9152565),
    ([-2.46, 0.2, 1.33], [7.8, 0.2, 4.31], 11.1869297),
    ([3.83, 0.2, -2.92], [0.39, 0.2, 1.8], 5.85563278),
    ([8.18, 0.2, 2.81], [5.51, 0.2, -2.28], 6.01829004),
    ([-6.15, 0.62, -1.17], [1.01, 0.2, -0.16], f64::INFINITY),
    ([-1.48, 0.2, 5.12], [-2.81, 0.2, 2.07], 3.35251999),
    ([0.04, 0.2, -1.93], [1.01, 0.2, -2.18], 1.00169861),
    ([1.41, 0.2, 3.32], [4.47, 0.2, 4.6], 3.31692624),
    ([5.83, 0.21, 0.38], [-7.9, 0.2, -2.21], 14.6055775),
    ([6.52, 0.2, 4.6], [-7.47, 0.2, 2.77], 14.2084761),
    ([7.19, 0.2, 1.15], [-7.12, 0.2, 3.11], 14.7755108),
    ([-7.45, 0.2, -0.4], [-8.72, 0.2, 3.72], 4.39155006),
];

/// Forward, left and right by 30 degrees, from the first place above.
const ACTIONS: &str = "LFRFRRRLFFFRFFFFFFFLFLFFRFFFFF";
const COLLIDED: &str = "000000001110000000001011011111";
/// Action count, pose after it.
const POSES: [(usize, Place, f32); 6] = [
    (6, [-2.175, 0.19865, -5.3365065], -60.0),
    (11, [-1.525482, 0.19865, -5.350_004], -60.0),
    (16, [-0.525482, 0.19865, -5.350_004], -90.0),
    (21, [0.4410244, 0.19865, -5.350_004], -60.0),
    (26, [0.9075307, 0.19865, -5.350_004], -60.0),
    (30, [1.7735562, 0.19865, -5.350_004], -60.0),
];

fn house(test: &str) -> Option<NavMesh> {
    let path = shared(test, "aws_small_house/combined/small_house.glb")?;
    let scene = avln_formats::open::open(&path).expect("a readable scene");
    Some(NavMesh::build_with(&scene, &NavMeshSettings::default()).expect("a house to walk in"))
}

#[test]
fn a_real_house_has_recasts_polygons_and_detours_paths() {
    let Some(mesh) = house("a_real_house_has_recasts_polygons_and_detours_paths") else { return };
    assert_eq!((mesh.polygons().len(), mesh.island_count()), (146, 4));
    for (a, b, metres) in PATHS {
        let [a, b] = [a, b].map(Point3::from);
        let geodesic = mesh.geodesic_m(&a, &b).unwrap_or(f64::INFINITY);
        assert!(
            geodesic == metres || (geodesic - metres).abs() < 1e-4,
            "{geodesic} {metres} from {a} to {b}"
        );
        let shortest = mesh.shortest_m(&a, &b).unwrap_or(f64::INFINITY);
        assert!(shortest <= geodesic + 1e-6 && shortest > 0.7 * geodesic || geodesic.is_infinite());
    }
}

#[test]
fn a_walk_through_a_real_house_goes_where_habitats_does() {
    let Some(mesh) = house("a_walk_through_a_real_house_goes_where_habitats_does") else { return };
    let (mut at, mut heading_deg) = (Point3::from(PATHS[0].0), 0.0_f32);
    let mut poses = POSES.iter();
    for (count, (action, collided)) in (1..).zip(ACTIONS.bytes().zip(COLLIDED.bytes())) {
        match action {
            b'L' => heading_deg += 30.0,
            b'R' => heading_deg -= 30.0,
            _ => {
                let (sin, cos) = angle::sin_cos(heading_deg.to_radians());
                let asked = Vector3::new(-sin, 0.0, -cos) * 0.25;
                let end = mesh.try_step(&at, &(at + asked), true);
                let short = (end - at).norm_squared() + 1e-5 < asked.norm_squared();
                assert_eq!(short, collided == b'1', "action {count}");
                at = end;
            }
        }
        if let Some((_, place, heading)) = poses.as_slice().first().filter(|pose| pose.0 == count) {
            assert!((at - Point3::from(*place)).norm() < 1e-4, "{at} after {count} actions");
            assert_eq!(heading_deg, *heading);
            poses.next();
        }
    }
    assert_eq!(poses.len(), 0);
}

#[test]
fn the_arenas_own_mesh_covers_the_same_floor() {
    let Some(path) =
        shared("the_arenas_own_mesh_covers_the_same_floor", "aws_small_house/combined/small_house.glb")
    else {
        return;
    };
    let scene = avln_formats::open::open(&path).expect("a readable scene");
    let own = NavMesh::build(&scene, &Body::default()).expect("a house to walk in");
    let habitats = NavMesh::build_with(&scene, &NavMeshSettings::default()).expect("a house to walk in");
    let ratio = own.island_area_m2(0) / habitats.island_area_m2(0);
    assert!((0.95..1.05).contains(&ratio), "{ratio}");
}
