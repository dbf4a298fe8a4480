//! Properties of every image.

use crate::compare::check;
use crate::scenes::{
    add, camera, closed_room, direction, empty, painted, procedural, renderer, shoot, tumbled,
};
use avln_geom::{Point3, Rng, UnitQuaternion, Vector3, angle};
use avln_render::{Camera, CameraImage};
use avln_scene::InstanceId;
use std::sync::Arc;

/// Pixels of two frames that differ by more than 1 mm and 0.1 % of depth, or in their instance.
fn differences(a: &CameraImage, b: &CameraImage) -> usize {
    let same = |pixel: &usize| {
        let (depth, other) = (a.depth[*pixel], b.depth[*pixel]);
        (depth - other).abs() <= (1e-3 * depth).max(1e-3) && a.instances[*pixel] == b.instances[*pixel]
    };
    (0..a.depth.len()).filter(|pixel| !same(pixel)).count()
}

#[test]
fn turning_the_camera_is_turning_the_building_the_other_way() {
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
fn a_wall_ahead_comes_nearer_by_every_step_towards_it() {
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
            assert_eq!(holes, 0, "{holes} holes with {cells} cells, seen by {camera:?}");
            assert!(!frame.instances.contains(&InstanceId::NONE));
        }
    }
}

#[test]
fn cameras_that_stand_on_edges_see_no_holes_either() {
    // Diagonal and head-on views of the lattice, where pixel rays pass exactly through corners and edges.
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
fn any_number_of_threads_takes_the_same_pictures() {
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
fn triangles_behind_around_and_through_the_plane_of_the_camera_are_cut_rightly() {
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
fn what_lies_behind_is_not_seen() {
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
