use avln_geom::{Aabb, Point3, RayMesh, Rng, Vector3, angle};
use avln_render::Camera;
use avln_scene::Scene;
use std::f32::consts::{FRAC_PI_2, PI, TAU};

const EYE_M: f32 = 1.0;
const ELBOW_ROOM_M: f32 = 0.3;
const TRIES: usize = 100_000;

/// Level cameras 1 m above floors with free surroundings, over the rooms or, without rooms, over the whole
/// scene.
pub(crate) fn cameras(scene: &Scene, rays: &RayMesh, count: usize, side: u32) -> Vec<Camera> {
    let mut rng = Rng::new(1);
    let rooms: Vec<Aabb> = match scene.bounds() {
        Some(bounds) if scene.regions.is_empty() => vec![bounds],
        _ => scene.regions.iter().map(|region| region.bounds).collect(),
    };
    let draw = |attempt: usize| {
        let room = rooms[attempt % rooms.len()];
        let (x, z) = (rng.range(room.min.x, room.max.x), rng.range(room.min.z, room.max.z));
        let above = Point3::new(x, room.min.y + 0.5 * room.size().y, z);
        let floor_m = rays.cast(&above, &-Vector3::y(), 3.0)?.distance;
        let eye = above + Vector3::y() * (EYE_M - floor_m);
        let camera = Camera {
            eye,
            world_from_camera: angle::about_up(rng.range(-PI, PI)),
            width: side,
            height: side,
            hfov_rad: FRAC_PI_2,
            depth_max_m: f32::MAX,
        };
        let near = |i: usize| {
            let (sin, cos) = angle::sin_cos(TAU * i as f32 / 8.0);
            rays.cast(&eye, &Vector3::new(sin, 0.0, cos), ELBOW_ROOM_M).is_some()
        };
        (!(0..8).any(near)).then_some(camera)
    };
    let cameras: Vec<Camera> = (0..TRIES).filter_map(draw).take(count).collect();
    assert!(!cameras.is_empty(), "nobody can stand in this scene");
    cameras
}

/// To the right, up and ahead of a camera, world frame.
pub(crate) fn axes(camera: &Camera) -> [Vector3<f32>; 3] {
    [Vector3::x(), Vector3::y(), -Vector3::z()].map(|axis| camera.world_from_camera * axis)
}
