//! Scenes and cameras.

use avln_formats::open;
use avln_geom::{Point2, Point3, RayMesh, Rng, UnitQuaternion, Vector3, angle};
use avln_houses::{HouseOptions, house};
use avln_render::{Camera, CameraImage, Renderer};
use avln_scene::{InstanceId, Lighting, Material, Mesh, Scene, Texture};
use std::f32::consts::{FRAC_PI_2, PI};
use std::path::Path;
use std::sync::Arc;

/// A procedural house.
pub(crate) fn procedural(seed: u64) -> Scene {
    solid(house(&format!("house-{seed}"), seed, &HouseOptions::default()))
}

/// The scene without lamps, to skip light baking.
pub(crate) fn painted(scene: Scene) -> Scene {
    Scene { lighting: Lighting::Painted, ..scene }
}

/// The shared scene at `path`; prints a note if absent.
pub(crate) fn shared(path: &str) -> Option<Scene> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../../shared/scenes").join(path);
    if !file.exists() {
        // Not `println!`, which the test harness hides.
        let _ = std::io::Write::write_fmt(
            &mut std::io::stderr(),
            format_args!("skipped: {path}; put scenes into ../shared/scenes\n"),
        );
        return None;
    }
    Some(solid(open::open(&file).expect("a scene")))
}

/// The scene without texture holes: rays only know shapes.
fn solid(mut scene: Scene) -> Scene {
    scene.materials.iter_mut().for_each(|material| material.alpha_cutoff = None);
    scene
}

pub(crate) fn empty() -> Scene {
    let plain = Material { name: "plain".into(), base_color: [255; 4], texture: None, alpha_cutoff: None };
    Scene {
        name: "hand-made".into(),
        mesh: Mesh::default(),
        materials: vec![plain],
        textures: Vec::new(),
        regions: Vec::new(),
        objects: Vec::new(),
        lighting: Lighting::default(),
    }
}

/// Adds a triangle in the first material.
pub(crate) fn add(scene: &mut Scene, corners: [Point3<f32>; 3], instance: u32) {
    let mesh = &mut scene.mesh;
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(corners);
    mesh.uvs.extend([Point2::origin(), Point2::new(1.0, 0.0), Point2::new(0.0, 1.0)]);
    mesh.colors.extend([[255; 3]; 3]);
    mesh.triangles.push([first, first + 1, first + 2]);
    mesh.material_of.push(0);
    mesh.instance_of.push(InstanceId(instance));
}

/// A room, 6 × 3 × 5 m around (0, 1.5, 0). Every wall is a lattice with inner corners moved randomly in the
/// plane, so triangles have all shapes and share edges exactly.
pub(crate) fn closed_room(rng: &mut Rng, cells: usize) -> Scene {
    let mut scene = empty();
    let half = [3.0, 1.5, 2.5];
    for axis in 0..3 {
        for side in [-1.0_f32, 1.0] {
            let (first, second) = ((axis + 1) % 3, (axis + 2) % 3);
            let mut corner = |i: usize, j: usize| {
                let mut step = |index: usize| {
                    let inner = index > 0 && index < cells;
                    let moved = if inner { rng.range(-0.45, 0.45) } else { 0.0 };
                    2.0 * (index as f32 + moved) / cells as f32 - 1.0
                };
                let mut at = [0.0; 3];
                at[axis] = side * half[axis];
                (at[first], at[second]) = (step(i) * half[first], step(j) * half[second]);
                Point3::new(at[0], at[1] + 1.5, at[2])
            };
            let lattice: Vec<Vec<Point3<f32>>> =
                (0..=cells).map(|i| (0..=cells).map(|j| corner(i, j)).collect()).collect();
            for (i, j) in (0..cells).flat_map(|i| (0..cells).map(move |j| (i, j))) {
                let [a, b, c, d] =
                    [lattice[i][j], lattice[i + 1][j], lattice[i + 1][j + 1], lattice[i][j + 1]];
                let number = 1 + 2 * axis as u32 + u32::from(side > 0.0);
                add(&mut scene, [a, b, c], number);
                add(&mut scene, [a, c, d], number);
            }
        }
    }
    scene
}

/// A hand-made room corner with textures: boards in two frequencies, a red pane in front, cut-out bars.
pub(crate) fn textured() -> Scene {
    let mut scene = empty();
    scene.textures = vec![board(64, [40, 90, 160], [230, 220, 190]), bars()];
    let paint = |texture: Option<u16>, base_color: [u8; 4], alpha_cutoff: Option<u8>| Material {
        name: "paint".into(),
        base_color,
        texture,
        alpha_cutoff,
    };
    scene.materials = vec![
        paint(Some(0), [255; 4], None),
        paint(None, [200, 30, 30, 255], None),
        paint(Some(1), [250, 250, 120, 255], Some(128)),
        paint(Some(0), [150, 255, 170, 255], None),
    ];
    let mut quad = |corners: [[f32; 3]; 4], repeats: f32, material: u16, instance: u32| {
        let mesh = &mut scene.mesh;
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(corners.map(Point3::from));
        mesh.uvs
            .extend([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]].map(|uv| Point2::from(uv) * repeats));
        mesh.colors.extend([[255, 255, 255], [200, 200, 210], [150, 150, 160], [255, 250, 240]]);
        mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        mesh.material_of.extend([material; 2]);
        mesh.instance_of.extend([InstanceId(instance); 2]);
    };
    quad([[-3.0, 3.0, -3.0], [-3.0, 0.0, -3.0], [3.0, 0.0, -3.0], [3.0, 3.0, -3.0]], 1.0, 0, 1);
    quad([[-3.0, 0.0, -3.0], [-3.0, 0.0, 3.0], [3.0, 0.0, 3.0], [3.0, 0.0, -3.0]], 4.0, 3, 2);
    quad([[-3.0, 3.0, 3.0], [-3.0, 0.0, 3.0], [-3.0, 0.0, -3.0], [-3.0, 3.0, -3.0]], 1.0, 0, 3);
    quad([[0.3, 1.4, -1.5], [0.2, 0.4, -1.2], [1.2, 0.5, -1.6], [1.3, 1.5, -1.9]], 1.0, 1, 4);
    quad([[-1.8, 2.0, -2.0], [-1.8, 0.2, -2.0], [-0.4, 0.2, -2.0], [-0.4, 2.0, -2.0]], 3.0, 2, 5);
    scene
}

/// A board with 8 × 8 squares and a gradient from left to right.
fn board(side: u32, dark: [u8; 3], light: [u8; 3]) -> Texture {
    let texel = |at: u32| {
        let (x, y) = (at % side, at / side);
        let [r, g, b] = if (x * 8 / side + y * 8 / side).is_multiple_of(2) { dark } else { light };
        [r, g, b.saturating_sub((x * 60 / side) as u8), 255]
    };
    Texture { width: side, height: side, pixels: (0..side * side).flat_map(texel).collect() }
}

/// Bars with holes between them.
fn bars() -> Texture {
    let texel = |at: u32| [255, 255, 255, if at % 16 < 6 { 255 } else { 0 }];
    Texture { width: 16, height: 16, pixels: (0..256).flat_map(texel).collect() }
}

/// A renderer and the scene's ray tree.
pub(crate) fn renderer(scene: &Arc<Scene>) -> (Renderer, Arc<RayMesh>) {
    let tree = Arc::new(RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles));
    (Renderer::new(Arc::clone(scene), Arc::clone(&tree)), tree)
}

pub(crate) fn shoot(scene: Scene, camera: &Camera) -> CameraImage {
    renderer(&Arc::new(scene)).0.render(camera)
}

/// A small 90 degree camera with unlimited depth.
pub(crate) fn camera(eye: Point3<f32>, world_from_camera: UnitQuaternion<f32>) -> Camera {
    Camera { eye, world_from_camera, width: 48, height: 36, hfov_rad: FRAC_PI_2, depth_max_m: f32::MAX }
}

/// A random orientation.
pub(crate) fn tumbled(rng: &mut Rng) -> UnitQuaternion<f32> {
    let heading = angle::about_up(rng.range(-PI, PI));
    let pitch = angle::about_right(rng.range(-FRAC_PI_2, FRAC_PI_2));
    let (sin, cos) = angle::sin_cos(rng.range(-0.5 * PI, 0.5 * PI));
    heading * pitch * angle::rotation([0.0, 0.0, sin.into(), cos.into()]).expect("a roll")
}

/// A random direction, uniform.
pub(crate) fn direction(rng: &mut Rng) -> Vector3<f32> {
    loop {
        let inside = Vector3::from_fn(|_, _| rng.range(-1.0, 1.0));
        let length = inside.norm();
        if (0.1..1.0).contains(&length) {
            return inside / length;
        }
    }
}
