//! A body in procedural houses.

use avln_geom::angle;
use avln_houses::{HouseOptions, house};
use avln_world::{Body, Camera, InstanceId, Point3, Rng, SceneAssets};
use std::collections::BTreeMap;
use std::f32::consts::{FRAC_PI_2, FRAC_PI_4};

/// Pixels of each instance in four pictures that together show the whole horizon.
fn pixels_around(assets: &SceneAssets, eye: Point3<f32>) -> BTreeMap<InstanceId, usize> {
    let mut pixels = BTreeMap::new();
    for quarter in 0..4 {
        let world_from_camera = angle::about_up(quarter as f32 * FRAC_PI_2);
        let camera =
            Camera { eye, world_from_camera, width: 64, height: 64, hfov_rad: FRAC_PI_2, depth_max_m: 10.0 };
        for instance in assets.render(&camera).instances {
            *pixels.entry(instance).or_insert(0) += 1;
        }
    }
    pixels.remove(&InstanceId::NONE);
    pixels
}

#[test]
fn what_a_camera_shows_is_seen_and_what_is_seen_a_camera_shows() {
    let assets = SceneAssets::prepare(house("seen", 4, &HouseOptions::default()), &Body::default());
    let assets = assets.expect("a procedural house is fit to live in");
    let mut rng = Rng::new(12);
    let (mut clear, mut missed, mut hidden, mut invented) = (0, 0, 0, 0);
    for _ in 0..60 {
        let stand = assets.navmesh.sample(&mut rng, assets.navmesh.largest_island());
        let eye = stand.position() + avln_geom::Vector3::y();
        let pixels = pixels_around(&assets, eye);
        for object in &assets.scene.objects {
            let count = pixels.get(&object.id).copied().unwrap_or(0);
            let seen = assets.sees(&eye, object.id, FRAC_PI_4);
            clear += usize::from(count >= 40);
            missed += usize::from(count >= 40 && !seen);
            hidden += usize::from(count == 0);
            invented += usize::from(count == 0 && seen);
        }
    }
    assert!(clear > 300 && hidden > 300, "{clear} in clear view, {hidden} hidden");
    assert!(missed * 50 <= clear, "{missed} of {clear} things in clear view were not seen");
    assert!(invented * 50 <= hidden, "{invented} of {hidden} hidden things were seen");
}
