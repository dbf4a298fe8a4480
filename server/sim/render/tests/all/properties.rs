//! Properties of every image; invalid scenes: their invalid parts are omitted or plain; golden images, which
//! `AVLN_BLESS=1 cargo test -p avln-render --test all` rewrites.
//!
//! Filters may change slightly: grey levels of golden images may differ by [`MEAN`] on average, and by more than
//! [`MOST`] in one channel per hundred.

use crate::compare::check;
use crate::scenes::{
    add, camera, closed_room, direction, empty, painted, procedural, renderer, shoot, textured, tumbled,
};
use avln_geom::{Point3, Rng, UnitQuaternion, Vector3, angle};
use avln_render::{Camera, CameraImage};
use avln_scene::{InstanceId, Material, Scene, Texture};
use std::fs::{self, File};
use std::io::{BufReader, BufWriter};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Pixel count with a different instance, or a depth difference above 1 mm and 0.1 %.
fn differences(a: &CameraImage, b: &CameraImage) -> usize {
    let same = |pixel: &usize| {
        let (depth, other) = (a.depth[*pixel], b.depth[*pixel]);
        (depth - other).abs() <= (1e-3 * depth).max(1e-3) && a.instances[*pixel] == b.instances[*pixel]
    };
    (0..a.depth.len()).filter(|pixel| !same(pixel)).count()
}

#[test]
fn turning_camera_equals_turning_building_backwards() {
    let scene = painted(procedural(3));
    let mut rng = Rng::new(12);
    let (mut pixels, mut different) = (0, 0);
    for room in scene.regions.iter().take(8) {
        let camera = camera(room.bounds.center(), tumbled(&mut rng));
        let mut turned = scene.clone();
        for point in &mut turned.mesh.positions {
            *point = Point3::from(camera.world_from_camera.inverse() * (*point - camera.eye));
        }
        let level = Camera { eye: Point3::origin(), world_from_camera: UnitQuaternion::identity(), ..camera };
        let (a, b) = (shoot(scene.clone(), &camera), shoot(turned, &level));
        pixels += a.depth.len();
        different += differences(&a, &b);
    }
    assert!(different * 200 <= pixels, "{different} of {pixels} pixels differ");
}

#[test]
fn steps_towards_a_wall_reduce_its_depth() {
    let mut scene = empty();
    let corner = |x: f32, y: f32| Point3::new(x, y, -5.0);
    add(&mut scene, [corner(-200.0, -200.0), corner(200.0, -200.0), corner(0.0, 400.0)], 1);
    let scene = Arc::new(scene);
    let (renderer, _) = renderer(&scene);
    for step in 0..100 {
        let walked_m = 0.0499 * step as f32;
        let eye = Point3::new(0.3, 1.1, -walked_m);
        let frame = renderer.render(&camera(eye, UnitQuaternion::identity()));
        let depth_m = 5.0 - walked_m;
        assert!(
            frame.depth.iter().all(|depth| (depth - depth_m).abs() <= 2e-6 * depth_m.max(1.0)),
            "{walked_m}"
        );
    }
}

#[test]
fn closed_rooms_have_no_holes() {
    let mut rng = Rng::new(31);
    for cells in [1, 2, 3, 5, 9, 16, 33] {
        let scene = Arc::new(closed_room(&mut rng, cells));
        let (renderer, _) = renderer(&scene);
        for _ in 0..60 {
            let place = [rng.range(-2.99, 2.99), rng.range(0.01, 2.99), rng.range(-2.49, 2.49)];
            let hfov_rad = rng.range(0.2, 2.6);
            let camera = Camera { hfov_rad, ..camera(Point3::from(place), tumbled(&mut rng)) };
            let frame = renderer.render(&camera);
            let holes = frame.depth.iter().filter(|depth| !(**depth > 0.0 && **depth < 9.0)).count();
            assert_eq!(holes, 0, "{holes} holes with {cells} cells from {camera:?}");
            assert!(!frame.instances.contains(&InstanceId::NONE));
        }
    }
}

#[test]
fn cameras_on_edges_see_no_holes() {
    // Diagonal and head-on lattice views: pixel rays pass exactly through corners and edges.
    let scene = Arc::new(closed_room(&mut Rng::new(1), 1));
    let (renderer, _) = renderer(&scene);
    for (quarter, height) in (0..4).flat_map(|quarter| [(quarter, 0.5), (quarter, 1.5), (quarter, 2.0)]) {
        let heading = angle::about_up(quarter as f32 * std::f32::consts::FRAC_PI_2);
        for side in [31, 32, 64] {
            let camera =
                Camera { width: side, height: side, ..camera(Point3::new(0.0, height, 0.0), heading) };
            assert!(renderer.render(&camera).depth.iter().all(|depth| *depth > 0.0), "{camera:?}");
        }
    }
}

#[test]
fn images_do_not_depend_on_thread_count() {
    let scene = Arc::new(painted(procedural(5)));
    let (renderer, _) = renderer(&scene);
    let mut rng = Rng::new(4);
    let rooms = scene.regions.iter().cycle().take(16);
    let cameras: Vec<Camera> = rooms.map(|room| camera(room.bounds.center(), tumbled(&mut rng))).collect();
    let alone: Vec<CameraImage> = cameras.iter().map(|camera| renderer.render(camera)).collect();
    for threads in [1, 2, 8] {
        let take = |first: usize| {
            let own = cameras.iter().enumerate().skip(first).step_by(threads);
            own.map(|(index, camera)| (index, renderer.render(camera))).collect::<Vec<_>>()
        };
        std::thread::scope(|scope| {
            let workers: Vec<_> = (0..threads).map(|first| scope.spawn(move || take(first))).collect();
            for (index, frame) in workers.into_iter().flat_map(|worker| worker.join().expect("no panic")) {
                assert!(frame == alone[index], "picture {index} with {threads} threads");
            }
        });
    }
}

#[test]
fn triangles_across_the_camera_plane_are_clipped() {
    let mut rng = Rng::new(77);
    for reach_m in [1.0, 30.0, 1000.0] {
        let mut scene = empty();
        for instance in 1..40 {
            let middle = direction(&mut rng) * rng.range(0.1, 4.0);
            let corners = std::array::from_fn(|_| Point3::from(middle + direction(&mut rng) * reach_m));
            add(&mut scene, corners, instance);
        }
        let mut poses = Rng::new(5);
        check(scene, |_, _| {
            let place = |rng: &mut Rng| Point3::from(direction(rng) * 0.5);
            (0..60).map(|_| camera(place(&mut poses), tumbled(&mut poses))).collect()
        });
    }
}

#[test]
fn triangles_behind_the_camera_are_invisible() {
    let mut scene = empty();
    let corner = |x: f32, y: f32, z: f32| Point3::new(x, y, z);
    add(&mut scene, [corner(-9.0, -9.0, 2.0), corner(9.0, -9.0, 2.0), corner(0.0, 9.0, 2.0)], 1);
    let ahead = camera(Point3::origin(), UnitQuaternion::identity());
    let frame = shoot(scene.clone(), &ahead);
    assert!(
        frame.depth.iter().all(|depth| *depth == 0.0)
            && frame.instances.iter().all(|id| *id == InstanceId::NONE)
    );
    let back = Camera {
        world_from_camera: UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f32::consts::PI),
        ..ahead
    };
    assert_eq!(shoot(scene, &back).instances[18 * 48 + 24], InstanceId(1));
}

fn ahead() -> Camera {
    camera(Point3::new(0.0, 1.2, 0.0), UnitQuaternion::identity())
}

#[test]
fn degenerate_triangles_are_omitted() {
    let clean = textured();
    let mut scene = clean.clone();
    let (a, b) = (Point3::new(0.1, 1.0, -1.0), Point3::new(0.2, 1.3, -1.1));
    for corners in [[a, a, a], [a, a, b], [a, b, b], [a, b, a], [a, a + (b - a) * 0.5, b]] {
        add(&mut scene, corners, 99);
    }
    assert_eq!(shoot(scene, &ahead()), shoot(clean, &ahead()));
}

/// Adds triangles with an invalid corner around `eye`.
fn add_nowhere(scene: &mut Scene, eye: Point3<f32>, bad: f32) {
    let (a, b) = (eye, eye + Vector3::repeat(0.4));
    for axis in 0..3 {
        let mut corner = eye;
        corner[axis] = bad;
        add(scene, [a, b, corner], 99);
    }
    add(scene, [Point3::from([bad; 3]); 3], 99);
}

#[test]
fn triangles_with_invalid_corners_are_omitted() {
    let lit = procedural(6);
    let eye = lit.regions[0].bounds.center();
    let camera = Camera { eye, ..ahead() };
    let painted = painted(lit.clone());
    for (clean, has_lamps) in [(lit, true), (painted, false)] {
        let expected = shoot(clean.clone(), &camera);
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let mut scene = clean.clone();
            add_nowhere(&mut scene, eye, bad);
            let frame = shoot(scene, &camera);
            assert!(!frame.instances.contains(&InstanceId(99)), "{bad}: an invalid triangle is visible");
            assert_eq!((&frame.depth, &frame.instances), (&expected.depth, &expected.instances), "{bad}");
            assert!(has_lamps || frame.rgb == expected.rgb, "{bad}: other colours changed");
        }
    }
}

#[test]
fn scene_without_triangles_shows_the_backdrop() {
    let scene = empty();
    let backdrop = scene.lighting.backdrop_rgb();
    let frame = shoot(scene, &ahead());
    assert_eq!(frame.rgb, backdrop.repeat(48 * 36));
    assert!(frame.depth.iter().all(|depth| *depth == 0.0));
    assert!(frame.instances.iter().all(|id| *id == InstanceId::NONE));
}

/// A wall across the whole view, in the first material.
fn wall(materials: Vec<Material>, textures: Vec<Texture>) -> Scene {
    let mut scene = Scene { materials, textures, ..empty() };
    let corner = |x: f32, y: f32| Point3::new(x, y, -2.0);
    add(&mut scene, [corner(-90.0, -90.0), corner(90.0, -90.0), corner(0.0, 90.0)], 5);
    scene
}

fn paint(texture: Option<u16>) -> Material {
    Material { name: "paint".into(), base_color: [10, 200, 90, 255], texture, alpha_cutoff: None }
}

/// Checks for a wall with a single colour.
fn is_plain(scene: Scene, rgb: [u8; 3]) {
    let frame = shoot(scene, &ahead());
    assert!(frame.depth.iter().all(|depth| (depth - 2.0).abs() < 1e-5));
    assert!(frame.instances.iter().all(|id| *id == InstanceId(5)));
    assert!(frame.rgb.as_chunks::<3>().0.iter().all(|pixel| *pixel == rgb), "{:?}", &frame.rgb[..3]);
}

#[test]
fn surfaces_with_unknown_material_are_white() {
    is_plain(wall(vec![], vec![]), [255; 3]);
    let mut scene = wall(vec![paint(None)], vec![]);
    scene.mesh.material_of[0] = u16::MAX;
    is_plain(scene, [255; 3]);
}

#[test]
fn invalid_textures_are_ignored() {
    is_plain(wall(vec![paint(Some(7))], vec![]), [10, 200, 90]);
    for (width, height, bytes) in
        [(0, 0, 0), (4, 4, 63), (4, 4, 0), (4, 4, 128), (u32::MAX, u32::MAX, 4), (3, 0, 12)]
    {
        let texture = Texture { width, height, pixels: vec![77; bytes] };
        is_plain(wall(vec![paint(Some(0))], vec![texture]), [10, 200, 90]);
    }
}

#[test]
fn invalid_cameras_return_images_with_their_size() {
    let scene = textured();
    for eye in [f32::NAN, f32::INFINITY, f32::MAX, -f32::MAX] {
        let frame = shoot(scene.clone(), &Camera { eye: Point3::new(eye, 1.0, 0.0), ..ahead() });
        assert_eq!((frame.depth.len(), frame.rgb.len()), (48 * 36, 48 * 36 * 3));
    }
    for hfov_rad in [0.0, -1.0, 4.0, f32::NAN, f32::INFINITY] {
        assert_eq!(shoot(scene.clone(), &Camera { hfov_rad, ..ahead() }).depth.len(), 48 * 36);
    }
    for depth_max_m in [0.0, -1.0, f32::NAN] {
        let frame = shoot(scene.clone(), &Camera { depth_max_m, ..ahead() });
        assert!(frame.depth.iter().all(|depth| *depth == 0.0), "{depth_max_m}");
        assert!(frame.instances.iter().any(|id| *id != InstanceId::NONE));
    }
    for (width, height) in [(0, 0), (0, 9), (9, 0), (1, 1), (1, 300), (300, 1)] {
        assert_eq!(
            shoot(scene.clone(), &Camera { width, height, ..ahead() }).depth.len() as u32,
            width * height
        );
    }
}

/// Mean channel difference, grey levels.
const MEAN: f64 = 2.0;
/// Difference exceeded by at most 1 % of the channels, grey levels.
const MOST: u8 = 24;

fn path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(format!("{name}.png"))
}

fn write(path: &Path, frame: &CameraImage) {
    fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
    let out = BufWriter::new(File::create(path).expect("a file that can be written"));
    let mut encoder = png::Encoder::new(out, frame.width, frame.height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header().and_then(|mut out| out.write_image_data(&frame.rgb)).expect("a picture");
}

fn read(path: &Path) -> (u32, u32, Vec<u8>) {
    let file = File::open(path)
        .unwrap_or_else(|error| panic!("{}: {error}; write it with AVLN_BLESS=1", path.display()));
    let mut reader = png::Decoder::new(BufReader::new(file)).read_info().expect("a picture");
    let mut rgb = vec![0; reader.output_buffer_size().expect("a size")];
    let info = reader.next_frame(&mut rgb).expect("a picture");
    (info.width, info.height, rgb)
}

fn compare(name: &str, frame: &CameraImage) {
    let path = path(name);
    if std::env::var_os("AVLN_BLESS").is_some() {
        write(&path, frame);
    }
    let (width, height, golden) = read(&path);
    assert_eq!((width, height), (frame.width, frame.height), "{name}");
    let differences: Vec<u8> = golden.iter().zip(&frame.rgb).map(|(a, b)| a.abs_diff(*b)).collect();
    let mean = differences.iter().map(|&by| f64::from(by)).sum::<f64>() / differences.len() as f64;
    let far = differences.iter().filter(|by| **by > MOST).count();
    let largest = differences.iter().max().copied().unwrap_or_default();
    assert!(
        mean <= MEAN && far * 100 <= differences.len(),
        "{name}: the image differs by {mean:.2} grey levels on average and {largest} at most; {far} of {} channels \
         differ by more than {MOST}. Check the image, then rewrite it with AVLN_BLESS=1",
        differences.len()
    );
}

/// A view from a room centre, 1.2 m above the floor.
fn in_room(seed: u64, room: usize, [heading_rad, pitch_rad]: [f32; 2]) -> CameraImage {
    let scene = procedural(seed);
    let bounds = scene.regions[room].bounds;
    let eye = Point3::new(bounds.center().x, bounds.min.y + 1.2, bounds.center().z);
    let held = angle::about_up(heading_rad) * angle::about_right(pitch_rad);
    shoot(scene, &Camera { width: 96, height: 72, ..camera(eye, held) })
}

#[test]
fn procedural_house_matches_golden_images() {
    compare("house-21-room-0", &in_room(21, 0, [0.6, -0.2]));
    compare("house-9-room-2", &in_room(9, 2, [2.4, -0.35]));
}

#[test]
fn textures_bars_and_tints_match_golden_images() {
    let held = angle::about_up(0.25) * angle::about_right(-0.15);
    let camera = Camera { width: 96, height: 72, ..camera(Point3::new(0.2, 1.5, 1.6), held) };
    compare("textured", &shoot(textured(), &camera));
}

#[test]
fn changed_images_are_detected() {
    if std::env::var_os("AVLN_BLESS").is_some() {
        return;
    }
    let held = angle::about_up(0.3) * angle::about_right(-0.15);
    let turned = Camera { width: 96, height: 72, ..camera(Point3::new(0.2, 1.5, 1.6), held) };
    let frame = shoot(textured(), &turned);
    assert!(std::panic::catch_unwind(|| compare("textured", &frame)).is_err());
}
