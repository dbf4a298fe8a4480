//! Figures of Recast 1.6 and Detour, run as in habitat-sim, for a shared house; and synthetic Detour files.

use crate::scenes::shared;
use avln_geom::{Point3, Vector3, angle};
use avln_navmesh::{Body, DetourError, NavMesh, NavMeshSettings};

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
fn real_house_has_recast_polygons_and_detour_paths() {
    let Some(mesh) = house("real_house_has_recast_polygons_and_detour_paths") else { return };
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
fn walk_in_a_real_house_matches_habitat() {
    let Some(mesh) = house("walk_in_a_real_house_matches_habitat") else { return };
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
fn arena_mesh_covers_the_same_floor() {
    let Some(path) = shared("arena_mesh_covers_the_same_floor", "aws_small_house/combined/small_house.glb")
    else {
        return;
    };
    let scene = avln_formats::open::open(&path).expect("a readable scene");
    let own = NavMesh::build(&scene, &Body::default()).expect("a house to walk in");
    let habitats = NavMesh::build_with(&scene, &NavMeshSettings::default()).expect("a house to walk in");
    let ratio = own.island_area_m2(0) / habitats.island_area_m2(0);
    assert!((0.95..1.05).contains(&ratio), "{ratio}");
}

/// A tile of three squares with sides of 2 m: two adjacent at height 0, one 3 m above the first.
struct File {
    version: i32,
    tiles: i32,
    tile_version: i32,
    flags: [u16; 3],
    corner: [u16; 6],
    neighbour: u16,
    cells_per_m: f32,
}

impl Default for File {
    fn default() -> Self {
        let corner = [1, 4, 5, 2, 0, 0];
        Self { version: 1, tiles: 1, tile_version: 7, flags: [1; 3], corner, neighbour: 1, cells_per_m: 20.0 }
    }
}

#[derive(Default)]
struct Bytes(Vec<u8>);

impl Bytes {
    fn ints(&mut self, values: &[i32]) {
        values.iter().for_each(|value| self.0.extend(value.to_le_bytes()));
    }

    fn floats(&mut self, values: &[f32]) {
        values.iter().for_each(|value| self.0.extend(value.to_le_bytes()));
    }

    fn shorts(&mut self, values: &[u16]) {
        values.iter().for_each(|value| self.0.extend(value.to_le_bytes()));
    }
}

const CORNERS: [[f32; 3]; 10] = [
    [-1.0, 0.0, 5.0],
    [1.0, 0.0, 5.0],
    [1.0, 0.0, 7.0],
    [-1.0, 0.0, 7.0],
    [3.0, 0.0, 5.0],
    [3.0, 0.0, 7.0],
    [-1.0, 3.0, 5.0],
    [1.0, 3.0, 5.0],
    [1.0, 3.0, 7.0],
    [-1.0, 3.0, 7.0],
];

impl File {
    fn tile(&self) -> Vec<u8> {
        let mut tile = Bytes::default();
        tile.0.extend(b"VAND");
        // Version, place, user, then the counts: polygons, corners, links, detail meshes, corners and triangles, tree,
        // off-mesh connections and the first of them.
        tile.ints(&[self.tile_version, 0, 0, 0, 0, 3, 10, 2, 3, 1, 8, 0, 0, 3]);
        tile.floats(&[1.5, 0.1, 0.2, -1.0, 0.0, 5.0, 3.0, 3.0, 7.0, self.cells_per_m]);
        CORNERS.iter().for_each(|corner| tile.floats(corner));
        let outlines = [[0, 1, 2, 3, 0, 0], self.corner, [6, 7, 8, 9, 0, 0]];
        let neighbours = [[0, 2, 0, 0, 0, 0], [0, 0, 0, self.neighbour, 0, 0], [0; 6]];
        for ((outline, neighbours), flags) in outlines.iter().zip(&neighbours).zip(self.flags) {
            tile.ints(&[-1]);
            tile.shorts(outline);
            tile.shorts(neighbours);
            tile.shorts(&[flags]);
            tile.0.extend([4, 0]);
        }
        tile.0.extend([0; 24]);
        // The second square has a detail corner in the centre.
        for (corners, first, triangles) in [(0, 0, 2), (1, 2, 4), (0, 6, 2)] {
            tile.ints(&[0, first]);
            tile.0.extend([corners, triangles, 0, 0]);
        }
        tile.floats(&[2.0, 0.5, 6.0]);
        let fan = [[0, 1, 2, 0], [0, 2, 3, 0]];
        let star = [[0, 1, 4, 0], [1, 2, 4, 0], [2, 3, 4, 0], [3, 0, 4, 0]];
        fan.iter().chain(&star).chain(&fan).for_each(|triangle| tile.0.extend(triangle));
        tile.0
    }

    fn bytes(&self) -> Vec<u8> {
        let mut file = Bytes::default();
        file.0.extend(b"TESM");
        file.ints(&[self.version, self.tiles]);
        file.floats(&[-1.0, 0.0, 5.0, 4.0, 2.0]);
        file.ints(&[1, 3]);
        if self.version == 2 {
            file.floats(&[0.05, 0.2, 1.5, 0.1, 0.2, 45.0, 20.0, 20.0, 12.0, 1.3, 6.0, 6.0, 1.0]);
            file.0.extend([1, 1, 1, 0]);
        }
        let tile = self.tile();
        file.ints(&[4096, tile.len() as i32]);
        file.0.extend(tile);
        file.0
    }

    fn refusal(&self) -> DetourError {
        NavMesh::from_detour(&self.bytes()).err().expect("a file that cannot be read")
    }
}

#[test]
fn both_set_versions_are_read() {
    for version in [1, 2] {
        let mesh = NavMesh::from_detour(&File { version, ..File::default() }.bytes()).expect("a good file");
        assert_eq!((mesh.island_count(), mesh.polygons().len()), (2, 3));
        assert!((mesh.area_m2() - 12.0).abs() < 1e-5 && (mesh.island_area_m2(0) - 8.0).abs() < 1e-5);
        let (a, b) = (Point3::new(-0.5, 0.0, 5.5), Point3::new(2.5, 0.0, 5.5));
        assert!((mesh.geodesic_m(&a, &b).expect("a way") - 3.0).abs() < 1e-6);
        assert_eq!(mesh.geodesic_m(&a, &Point3::new(0.0, 3.0, 6.0)), None);
        // The centre of the second square rises to 0.5 m; a point above it is projected there.
        let top = mesh.project(&Point3::new(2.0, 1.0, 6.0)).expect("a polygon below");
        assert!((top.position() - Point3::new(2.0, 0.5, 6.0)).norm() < 1e-5, "{top:?}");
        assert_eq!(mesh.project(&Point3::new(9.0, 0.0, 6.0)), None);
    }
}

#[test]
fn steps_follow_the_heights_and_slide() {
    let mesh = NavMesh::from_detour(&File::default().bytes()).expect("a good file");
    let up = mesh.try_step(&Point3::new(0.75, 0.0, 6.0), &Point3::new(1.5, 0.0, 6.0), true);
    assert!((up - Point3::new(1.5, 0.25, 6.0)).norm() < 1e-5, "{up}");
    let slid = mesh.try_step(&Point3::new(0.0, 0.0, 5.1), &Point3::new(0.2, 0.0, 4.8), true);
    assert!((slid - Point3::new(0.2, 0.0, 5.0)).norm() < 1e-5, "{slid}");
    let stopped = mesh.try_step(&Point3::new(0.0, 0.0, 5.1), &Point3::new(0.2, 0.0, 4.9), false);
    assert!((stopped - Point3::new(0.1, 0.0, 5.0)).norm() < 1e-5, "{stopped}");
    // Nearer to the upper square, or off the mesh: neither is a step.
    for end in [Point3::new(0.0, 3.0, 6.0), Point3::new(50.0, 0.0, 6.0)] {
        assert_eq!(mesh.try_step(&Point3::new(0.0, 0.0, 6.0), &end, true), Point3::new(0.0, 0.0, 6.0));
    }
}

#[test]
fn unwalkable_polygons_are_omitted() {
    let mesh =
        NavMesh::from_detour(&File { flags: [1, 4, 4], ..File::default() }.bytes()).expect("one square");
    assert!((mesh.area_m2() - 4.0).abs() < 1e-5);
    let error = File { flags: [4; 3], ..File::default() }.refusal();
    assert!(matches!(error, DetourError::NoFloor { polygons: 3 }), "{error}");
}

#[test]
fn truncated_files_are_refused_with_offset() {
    for version in [1, 2] {
        let bytes = File { version, ..File::default() }.bytes();
        for length in 0..bytes.len() {
            let error = NavMesh::from_detour(&bytes[..length]).err().expect("a cut file");
            let DetourError::Truncated { offset, needed, .. } = error else { panic!("{length}: {error}") };
            assert!(offset <= length && offset + needed > length, "{length}: {error}");
        }
    }
}

#[test]
fn invalid_values_are_named_with_offset() {
    let pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 1\n";
    let error = NavMesh::from_detour(pointer).err().expect("a pointer").to_string();
    assert!(error.contains("git lfs pull"), "{error}");
    let cases = [
        (File { version: 3, ..File::default() }, "byte 4 is 3"),
        (File { tiles: 2, ..File::default() }, "byte 8 is 2"),
        (File { tile_version: 6, ..File::default() }, "byte 52 is 6"),
        (File { corner: [1, 4, 99, 2, 0, 0], ..File::default() }, "one with corner 99"),
        (File { corner: [1, 5, 4, 2, 0, 0], ..File::default() }, "not convex"),
        (File { neighbour: 0x8001, ..File::default() }, "leads to another tile"),
        (File { cells_per_m: f32::NAN, ..File::default() }, "NaN"),
        (File { cells_per_m: 0.0, ..File::default() }, "0.01 to 10000"),
    ];
    for (file, words) in cases {
        let error = file.refusal().to_string();
        assert!(error.contains(words), "{words}: {error}");
    }
    let mut bytes = File::default().bytes();
    bytes[72..76].copy_from_slice(&i32::MAX.to_le_bytes());
    let error = NavMesh::from_detour(&bytes).err().expect("too many polygons").to_string();
    assert!(error.contains("polygon count"), "{error}");
    // The first corner is at byte 148: a tile kilometres wide, and a corner before its start.
    for (x, words) in [(9e5_f32, "the corner extent"), (-50.0, "a corner at byte 148 is (-50, 0, 5)")] {
        let mut bytes = File::default().bytes();
        bytes[148..152].copy_from_slice(&x.to_le_bytes());
        let error = NavMesh::from_detour(&bytes).err().expect("a corner far away").to_string();
        assert!(error.contains(words), "{error}");
    }
}

#[test]
fn damaged_bytes_never_panic() {
    let bytes = File::default().bytes();
    let mut rng = avln_geom::Rng::new(61);
    for _ in 0..20_000 {
        let mut damaged = bytes.clone();
        for _ in 0..1 + rng.below(4) {
            let place = rng.below(damaged.len());
            damaged[place] = rng.next_u64() as u8;
        }
        if let Ok(mesh) = NavMesh::from_detour(&damaged) {
            let end = Point3::new(2.5, 0.0, 5.5);
            let step = mesh.try_step(&Point3::new(-0.5, 0.0, 5.5), &end, true);
            assert!(step.coords.iter().all(|value| value.is_finite()), "{step}");
        }
    }
}
