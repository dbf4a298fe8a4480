//! Invalid scenes still give an image: invalid parts are omitted or plain.

use crate::scenes::{add, camera, empty, painted, procedural, shoot, textured};
use avln_geom::{Point3, UnitQuaternion, Vector3};
use avln_render::Camera;
use avln_scene::{InstanceId, Material, Scene, Texture};

fn ahead() -> Camera {
    camera(Point3::new(0.0, 1.2, 0.0), UnitQuaternion::identity())
}

#[test]
fn triangles_without_area_are_not_there() {
    let clean = textured();
    let mut scene = clean.clone();
    let (a, b) = (Point3::new(0.1, 1.0, -1.0), Point3::new(0.2, 1.3, -1.1));
    for corners in [[a, a, a], [a, a, b], [a, b, b], [a, b, a], [a, a + (b - a) * 0.5, b]] {
        add(&mut scene, corners, 99);
    }
    assert_eq!(shoot(scene, &ahead()), shoot(clean, &ahead()));
}

/// Triangles with a corner that is no place, around `eye`.
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
fn triangles_with_corners_that_are_no_places_do_no_harm() {
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
            assert!(!frame.instances.contains(&InstanceId(99)), "{bad}: what is nowhere is seen");
            assert_eq!((&frame.depth, &frame.instances), (&expected.depth, &expected.instances), "{bad}");
            assert!(has_lamps || frame.rgb == expected.rgb, "{bad}: the colours of others changed");
        }
    }
}

#[test]
fn a_scene_without_triangles_is_its_backdrop() {
    let scene = empty();
    let backdrop = scene.lighting.backdrop_rgb();
    let frame = shoot(scene, &ahead());
    assert_eq!(frame.rgb, backdrop.repeat(48 * 36));
    assert!(frame.depth.iter().all(|depth| *depth == 0.0));
    assert!(frame.instances.iter().all(|id| *id == InstanceId::NONE));
}

/// A wall across the whole view, of the first material.
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
fn surfaces_of_a_material_that_does_not_exist_are_white() {
    is_plain(wall(vec![], vec![]), [255; 3]);
    let mut scene = wall(vec![paint(None)], vec![]);
    scene.mesh.material_of[0] = u16::MAX;
    is_plain(scene, [255; 3]);
}

#[test]
fn textures_that_do_not_exist_or_have_another_size_are_left_out() {
    is_plain(wall(vec![paint(Some(7))], vec![]), [10, 200, 90]);
    for (width, height, bytes) in
        [(0, 0, 0), (4, 4, 63), (4, 4, 0), (4, 4, 128), (u32::MAX, u32::MAX, 4), (3, 0, 12)]
    {
        let texture = Texture { width, height, pixels: vec![77; bytes] };
        is_plain(wall(vec![paint(Some(0))], vec![texture]), [10, 200, 90]);
    }
}

#[test]
fn cameras_without_sense_give_frames_of_their_size() {
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
