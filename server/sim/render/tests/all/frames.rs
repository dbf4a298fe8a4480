//! Small scenes with hand-computed values.

use avln_geom::{Point2, Point3, RayMesh, Rng, Vector3, angle};
use avln_houses::{HouseOptions, house};
use avln_render::{Camera, CameraImage, Renderer, Width};
use avln_scene::{InstanceId, Lighting, Material, Mesh, Scene, Texture};
use std::f32::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

const WHITE: [u8; 4] = [255; 4];
/// Texture coordinates: top-left, bottom-left, bottom-right, top-right.
const WHOLE_TEXTURE: [(f32, f32); 4] = [(0.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, 0.0)];

fn empty_scene() -> Scene {
    Scene {
        name: "hand-made".into(),
        mesh: Mesh::default(),
        materials: Vec::new(),
        textures: Vec::new(),
        regions: Vec::new(),
        objects: Vec::new(),
        lighting: Lighting::Painted,
    }
}

fn material(scene: &mut Scene, base_color: [u8; 4], texture: Option<u16>, alpha_cutoff: Option<u8>) -> u16 {
    scene.materials.push(Material { name: "paint".into(), base_color, texture, alpha_cutoff });
    scene.materials.len() as u16 - 1
}

/// Adds a quad with corners in `WHOLE_TEXTURE` order, seen from the front.
fn quad(scene: &mut Scene, corners: [(f32, f32, f32); 4], material: u16, instance: u32) {
    let mesh = &mut scene.mesh;
    let base = mesh.positions.len() as u32;
    mesh.positions.extend(corners.map(|(x, y, z)| Point3::new(x, y, z)));
    mesh.uvs.extend(WHOLE_TEXTURE.map(|(u, v)| Point2::new(u, v)));
    mesh.colors.extend([[255; 3]; 4]);
    mesh.triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
    mesh.material_of.extend([material; 2]);
    mesh.instance_of.extend([InstanceId(instance); 2]);
}

/// A wall across the view at `z`, from `x0` to `x1` and from `y0` to `y1`.
fn wall(scene: &mut Scene, [x0, x1]: [f32; 2], [y0, y1]: [f32; 2], z: f32, material: u16, instance: u32) {
    quad(scene, [(x0, y1, z), (x0, y0, z), (x1, y0, z), (x1, y1, z)], material, instance);
}

/// A square floor (or ceiling) at height `y` with half side `half`.
fn floor(scene: &mut Scene, half: f32, y: f32, material: u16, instance: u32) {
    quad(scene, [(-half, y, -half), (-half, y, half), (half, y, half), (half, y, -half)], material, instance);
}

fn camera(width: u32, height: u32) -> Camera {
    Camera {
        eye: Point3::new(0.0, 1.0, 0.0),
        world_from_camera: angle::about_up(0.0),
        width,
        height,
        hfov_rad: FRAC_PI_2,
        depth_max_m: 10.0,
    }
}

fn shoot(scene: Scene, camera: &Camera) -> CameraImage {
    let rays = RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles);
    Renderer::new(Arc::new(scene), Arc::new(rays)).render(camera)
}

fn pixel(frame: &CameraImage, x: u32, y: u32) -> [u8; 3] {
    let at = 3 * (y * frame.width + x) as usize;
    [frame.rgb[at], frame.rgb[at + 1], frame.rgb[at + 2]]
}

#[test]
fn wall_ahead_has_constant_depth() {
    let mut scene = empty_scene();
    let paint = material(&mut scene, [10, 20, 30, 255], None, None);
    wall(&mut scene, [-9.0, 9.0], [-9.0, 9.0], -3.25, paint, 7);
    let frame = shoot(scene, &camera(40, 30));
    assert_eq!((frame.rgb.len(), frame.depth.len(), frame.instances.len()), (3600, 1200, 1200));
    assert!(frame.depth.iter().all(|depth| (depth - 3.25).abs() < 1e-5));
    assert!(frame.instances.iter().all(|&instance| instance == InstanceId(7)));
    assert!((0..40).all(|x| pixel(&frame, x, 11) == [10, 20, 30]));
}

#[test]
fn floor_depth_is_height_over_tangent() {
    let mut scene = empty_scene();
    let paint = material(&mut scene, WHITE, None, None);
    floor(&mut scene, 500.0, 0.0, paint, 1);
    let frame = shoot(scene, &camera(64, 64));
    for row in 32..64 {
        // A 90 degree image spans a tangent of 1 over 32 pixels; pixel centres are at half pixels.
        let tangent = (row as f32 + 0.5 - 32.0) / 32.0;
        let expected = if 1.0 / tangent <= 10.0 { 1.0 / tangent } else { 0.0 };
        for column in 0..64 {
            let depth = frame.depth[row * 64 + column];
            assert!((depth - expected).abs() < 1e-4 * expected.max(1.0), "row {row}: {depth} not {expected}");
        }
    }
    assert!(frame.depth[..32 * 64].iter().all(|&depth| depth == 0.0), "there is no floor above the horizon");
}

#[test]
fn colour_and_instance_exceed_the_depth_range() {
    let mut scene = empty_scene();
    let paint = material(&mut scene, [200, 0, 0, 255], None, None);
    wall(&mut scene, [-90.0, 90.0], [-90.0, 90.0], -11.0, paint, 3);
    let frame = shoot(scene, &camera(8, 8));
    assert!(frame.depth.iter().all(|&depth| depth == 0.0));
    assert!(frame.instances.iter().all(|&instance| instance == InstanceId(3)));
    assert_eq!(pixel(&frame, 4, 4), [200, 0, 0]);
}

#[test]
fn image_border_at_90_degrees_is_at_45() {
    for width in [64, 65] {
        let mut scene = empty_scene();
        let paint = material(&mut scene, WHITE, None, None);
        // Two posts at 4 m, from 44.5 to 45.5 degrees to the left, and the same to the right.
        let (inner, outer) = (4.0 * 44.5_f32.to_radians().tan(), 4.0 * 45.5_f32.to_radians().tan());
        wall(&mut scene, [-outer, -inner], [-1.0, 3.0], -4.0, paint, 1);
        wall(&mut scene, [inner, outer], [-1.0, 3.0], -4.0, paint, 2);
        let frame = shoot(scene, &camera(width, 9));
        let middle = (4 * width) as usize;
        let row = &frame.instances[middle..middle + width as usize];
        assert_eq!((row[0], row[width as usize - 1]), (InstanceId(1), InstanceId(2)));
        let posts = row.iter().filter(|&&instance| instance != InstanceId::NONE).count();
        assert_eq!(posts, 2, "a post half a degree wide covers the border pixels only");
    }
}

#[test]
fn pixels_are_square_in_odd_narrow_images() {
    let mut scene = empty_scene();
    let paint = material(&mut scene, WHITE, None, None);
    // A plate, 2 x 2 m, 4 m ahead: tangents from -1/4 to 1/4.
    wall(&mut scene, [-1.0, 1.0], [0.0, 2.0], -4.0, paint, 1);
    let camera = Camera { hfov_rad: 2.0 * 0.5_f32.atan(), ..camera(101, 67) };
    let frame = shoot(scene, &camera);
    let hits: Vec<_> =
        (0..101 * 67).filter(|&at| frame.depth[at] > 0.0).map(|at| (at % 101, at / 101)).collect();
    // 101 pixels span a tangent of 1, so the plate spans 50.5 pixels around the centre, both ways.
    let span = |values: Vec<usize>| (*values.iter().min().unwrap(), *values.iter().max().unwrap());
    assert_eq!(span(hits.iter().map(|hit| hit.0).collect()), (25, 75));
    assert_eq!(span(hits.iter().map(|hit| hit.1).collect()), (8, 58));
    assert_eq!(hits.len(), 51 * 51);
}

#[test]
fn left_turn_shows_the_left_side() {
    let mut scene = empty_scene();
    let paint = material(&mut scene, WHITE, None, None);
    quad(&mut scene, [(-2.0, 2.0, 1.0), (-2.0, 0.0, 1.0), (-2.0, 0.0, -1.0), (-2.0, 2.0, -1.0)], paint, 5);
    for (heading_rad, seen) in [(0.0, false), (FRAC_PI_2, true), (-FRAC_PI_2, false), (PI, false)] {
        let frame = shoot(
            scene.clone(),
            &Camera { world_from_camera: angle::about_up(heading_rad), ..camera(32, 32) },
        );
        assert_eq!(frame.instances[16 * 32 + 16] == InstanceId(5), seen, "heading {heading_rad}");
    }
}

#[test]
fn textures_are_upright_and_not_mirrored() {
    let colors = [[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 0]];
    let mut scene = empty_scene();
    let pixels = colors.iter().flat_map(|&[r, g, b]| [r, g, b, 255]).collect();
    scene.textures.push(Texture { width: 2, height: 2, pixels });
    let paint = material(&mut scene, WHITE, Some(0), None);
    wall(&mut scene, [-1.0, 1.0], [0.0, 2.0], -1.0, paint, 1);
    let frame = shoot(scene, &camera(64, 64));
    // The wall fills the image; quadrant middles are texel middles.
    for (quadrant, color) in colors.into_iter().enumerate() {
        let (x, y) = (16 + 32 * (quadrant as u32 % 2), 16 + 32 * (quadrant as u32 / 2));
        let seen = pixel(&frame, x, y);
        assert!((0..3).all(|c| seen[c].abs_diff(color[c]) < 20), "quadrant {quadrant}: {seen:?}");
    }
}

#[test]
fn texture_base_colour_and_vertex_colour_multiply() {
    let mut scene = empty_scene();
    scene.textures.push(Texture { width: 1, height: 1, pixels: vec![200, 100, 255, 255] });
    let paint = material(&mut scene, [128, 255, 51, 255], Some(0), None);
    wall(&mut scene, [-2.0, 2.0], [-1.0, 3.0], -1.0, paint, 1);
    scene.mesh.colors = vec![[255, 51, 255]; 4];
    let frame = shoot(scene.clone(), &camera(16, 16));
    // 200·128/255 = 100.4, 100·51/255 = 20, 255·51/255 = 51.
    assert_eq!(pixel(&frame, 8, 8), [100, 20, 51]);
    // Black on the left, white on the right: vertex colours change evenly across the wall.
    scene.mesh.colors = vec![[0; 3], [0; 3], [255; 3], [255; 3]];
    let frame = shoot(scene, &camera(16, 16));
    for x in 0..16 {
        let across = (x as f32 + 0.5 - 8.0) / 8.0 * 0.25 + 0.5;
        assert!((f32::from(pixel(&frame, x, 3)[2]) - 51.0 * across).abs() < 1.0);
    }
}

#[test]
fn cut_out_texels_are_holes() {
    let mut scene = empty_scene();
    // Left half solid, right half cut out; alpha falls linearly from 255 to 0 between the texel centres.
    scene.textures.push(Texture { width: 2, height: 1, pixels: vec![9, 9, 9, 255, 9, 9, 9, 0] });
    let lattice = material(&mut scene, WHITE, Some(0), Some(128));
    let solid = material(&mut scene, [70, 80, 90, 255], None, None);
    wall(&mut scene, [-2.0, 2.0], [-1.0, 3.0], -2.0, lattice, 1);
    wall(&mut scene, [-9.0, 9.0], [-9.0, 9.0], -5.0, solid, 2);
    let frame = shoot(scene, &camera(64, 8));
    let row = &frame.depth[4 * 64..5 * 64];
    assert!(row[20..31].iter().all(|depth| (depth - 2.0).abs() < 1e-5), "solid left of the middle");
    assert!(row[33..44].iter().all(|depth| (depth - 5.0).abs() < 1e-5), "open right of the middle");
    assert_eq!(pixel(&frame, 40, 4), [70, 80, 90]);
    assert_eq!(frame.instances[4 * 64 + 40], InstanceId(2));
}

#[test]
fn alpha_without_cutoff_is_ignored() {
    let mut scene = empty_scene();
    let glass = material(&mut scene, [255, 255, 255, 0], None, None);
    wall(&mut scene, [-9.0, 9.0], [-9.0, 9.0], -2.0, glass, 1);
    assert!((shoot(scene, &camera(4, 4)).depth[5] - 2.0).abs() < 1e-6);
}

#[test]
fn empty_scene_shows_the_backdrop() {
    let frame = shoot(empty_scene(), &camera(5, 3));
    assert_eq!(frame.rgb, [0; 45], "scans have a black background");
    let house = Scene { lighting: Lighting::Lamps(vec![]), ..empty_scene() };
    let sky = house.lighting.backdrop_rgb();
    assert_eq!(shoot(house, &camera(5, 3)).rgb, sky.repeat(15));
    assert!(frame.depth.iter().all(|&depth| depth == 0.0));
    assert!(frame.instances.iter().all(|&instance| instance == InstanceId::NONE));
    assert_eq!(shoot(empty_scene(), &camera(0, 7)).rgb.len(), 0);
}

#[test]
fn distant_patterns_fade_to_their_mean() {
    let mut scene = empty_scene();
    let board = (0..64 * 64).flat_map(|i| if (i + i / 64) % 2 == 0 { [0, 0, 0, 255] } else { WHITE });
    scene.textures.push(Texture { width: 64, height: 64, pixels: board.collect() });
    let paint = material(&mut scene, WHITE, Some(0), None);
    wall(&mut scene, [-1.0, 1.0], [0.0, 2.0], -8.0, paint, 1);
    let frame = shoot(scene, &camera(64, 64));
    for at in (0..64 * 64).filter(|&at| frame.depth[at] > 0.0) {
        assert!(frame.rgb[3 * at].abs_diff(128) <= 1, "{}", frame.rgb[3 * at]);
    }
}

/// Random plates around and behind the eye.
fn clutter(rng: &mut Rng, count: u32) -> Scene {
    let mut scene = empty_scene();
    let paint = material(&mut scene, WHITE, None, None);
    for instance in 1..=count {
        let mut draw =
            |reach: f32| (rng.range(-reach, reach), rng.range(-reach, reach), rng.range(-reach, reach));
        let (at, along, across) = (draw(6.0), draw(1.0), draw(1.0));
        let corner = |a: f32, b: f32| {
            let sum = |p: f32, q: f32, r: f32| p + a * q + b * r;
            (sum(at.0, along.0, across.0), sum(at.1, along.1, across.1), sum(at.2, along.2, across.2))
        };
        let corners = [corner(0.0, 0.0), corner(0.0, 1.0), corner(1.0, 1.0), corner(1.0, 0.0)];
        quad(&mut scene, corners, paint, instance);
    }
    scene
}

#[test]
fn frames_agree_with_single_rays() {
    let mut rng = Rng::new(11);
    let (mut compared, mut different) = (0, 0);
    for heading_rad in [0.0, 0.7, 2.0, -1.3] {
        let scene = clutter(&mut rng, 400);
        let rays = RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles);
        let camera =
            Camera { world_from_camera: angle::about_up(heading_rad), depth_max_m: 100.0, ..camera(61, 43) };
        let frame = shoot(scene, &camera);
        let (forward, right) = (
            Vector3::new(-heading_rad.sin(), 0.0, -heading_rad.cos()),
            Vector3::new(heading_rad.cos(), 0.0, -heading_rad.sin()),
        );
        for at in 0..61 * 43 {
            let (x, y) = ((at % 61) as f32 + 0.5 - 30.5, (at / 61) as f32 + 0.5 - 21.5);
            let direction = forward + right * (x / 30.5) - Vector3::y() * (y / 30.5);
            let expected = rays.cast(&camera.eye, &direction, 100.0).map_or(0.0, |hit| hit.distance);
            compared += usize::from(expected > 0.0);
            different += usize::from((frame.depth[at] - expected).abs() > 1e-3 * expected.max(0.1));
        }
    }
    assert!(compared > 4000, "only {compared} pixels have a hit");
    assert!(
        different <= 3,
        "{different} of {compared} pixels differ from their rays, more than edges explain"
    );
}

#[test]
fn closed_surfaces_have_no_gaps() {
    // A ball around the eye, made from triangles.
    let mut scene = empty_scene();
    let paint = material(&mut scene, WHITE, None, None);
    let (rings, sectors) = (23, 37);
    let point = |ring: usize, sector: usize| {
        let (polar, around) =
            (PI * ring as f32 / rings as f32, 2.0 * PI * (sector % sectors) as f32 / sectors as f32);
        (3.0 * polar.sin() * around.cos(), 1.0 + 3.0 * polar.cos(), 3.0 * polar.sin() * around.sin())
    };
    for (ring, sector) in (0..rings).flat_map(|ring| (0..sectors).map(move |sector| (ring, sector))) {
        let corners = [(ring, sector), (ring + 1, sector), (ring + 1, sector + 1), (ring, sector + 1)];
        quad(&mut scene, corners.map(|(ring, sector)| point(ring, sector)), paint, 1);
    }
    for step in 0..12 {
        let frame = shoot(
            scene.clone(),
            &Camera { world_from_camera: angle::about_up(0.53 * step as f32), ..camera(128, 128) },
        );
        assert!(frame.depth.iter().all(|&depth| depth > 0.0), "a hole at step {step}");
    }
}

#[test]
fn images_are_equal_in_all_threads() {
    let scene = Arc::new(clutter(&mut Rng::new(4), 200));
    let rays = Arc::new(RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles));
    let renderer = Renderer::new(scene, rays);
    let camera = camera(50, 50);
    let first = renderer.render(&camera);
    std::thread::scope(|scope| {
        let others: Vec<_> = (0..3).map(|_| scope.spawn(|| renderer.render(&camera))).collect();
        for other in others {
            assert_eq!(other.join().expect("rendered"), first);
        }
    });
}

#[test]
fn extreme_cameras_return_full_images() {
    let scene = clutter(&mut Rng::new(9), 50);
    for (eye, hfov_rad) in [(f32::NAN, 1.0), (f32::INFINITY, 1.0), (0.0, 0.0), (0.0, 7.0), (0.0, f32::NAN)] {
        let camera = Camera { eye: Point3::new(eye, 1.0, 0.0), hfov_rad, ..camera(9, 9) };
        assert_eq!(shoot(scene.clone(), &camera).depth.len(), 81);
    }
}

#[test]
fn images_are_equal_for_all_vector_widths() {
    let scene = Arc::new(house("width", 3, &HouseOptions::small()));
    let rays = Arc::new(RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles));
    let room = scene.regions[0].bounds.center();
    let renderer = Renderer::new(Arc::clone(&scene), rays);
    for step in 0..12 {
        let world_from_camera = angle::about_up(0.53 * step as f32);
        let camera = Camera { eye: room, world_from_camera, ..camera(131, 97) };
        let portable = renderer.render_with(&camera, Width::Portable);
        assert!(portable == renderer.render(&camera), "step {step}");
    }
}
