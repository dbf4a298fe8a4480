//! Images at half a pixel compared with exact ones.

use crate::scenes::{procedural, renderer};
use avln_geom::{Point3, Rng, angle};
use avln_render::{Camera, CameraImage, Detail, Renderer};
use avln_scene::Scene;
use std::f32::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

const SIDE: u32 = 64;
/// Exact pixels per side of a pixel.
const FINE: u32 = 4;
const VIEWS: usize = 24;

/// Random headings in rooms, at eye level.
fn cameras(scene: &Scene) -> Vec<Camera> {
    let mut rng = Rng::new(8);
    let camera = |index: usize| {
        let bounds = &scene.regions[index % scene.regions.len()].bounds;
        let middle = bounds.center();
        let mut aside = || rng.range(-0.5, 0.5);
        Camera {
            eye: Point3::new(middle.x + aside(), bounds.min.y + 1.0, middle.z + aside()),
            world_from_camera: angle::about_up(rng.range(-PI, PI)),
            width: SIDE,
            height: SIDE,
            hfov_rad: FRAC_PI_2,
            depth_max_m: 100.0,
        }
    };
    (0..VIEWS).map(camera).collect()
}

/// Exact pixels up to half a pixel around a pixel's centre.
fn around(exact: &CameraImage, pixel: u32) -> impl Iterator<Item = usize> {
    let middle = [pixel % SIDE, pixel / SIDE].map(|at| FINE * at + FINE / 2);
    let reach = FINE / 2 + 1;
    let range = move |at: u32| at.saturating_sub(reach)..(at + reach).min(exact_side());
    let width = exact.width;
    range(middle[1]).flat_map(move |row| range(middle[0]).map(move |column| (row * width + column) as usize))
}

const fn exact_side() -> u32 {
    SIDE * FINE
}

/// Shares of pixels with a wrong depth, a different instance, and a hole.
#[derive(Debug, Default)]
struct Shares {
    depth: f64,
    instance: f64,
    hole: f64,
}

fn compare(renderer: &Renderer, camera: &Camera, shares: &mut Shares) {
    let exact = renderer.render(camera);
    let fine = renderer.render(&Camera { width: exact_side(), height: exact_side(), ..*camera });
    let image = renderer.render_at(camera, Detail::HalfPixel);
    let one = 1.0 / f64::from(SIDE * SIDE) / VIEWS as f64;
    for pixel in 0..SIDE * SIDE {
        let at = pixel as usize;
        let depth_m = image.depth[at];
        let footprint_m = 2.0 / SIDE as f32 * exact.depth[at];
        let tolerance_m = 0.5 * footprint_m + 0.005;
        let is_near = |other: usize| (fine.depth[other] - depth_m).abs() <= tolerance_m;
        if !around(&fine, pixel).any(is_near) {
            shares.depth += one;
        }
        if image.instances[at] != exact.instances[at] {
            shares.instance += one;
        }
        if depth_m == 0.0 && exact.depth[at] > 0.0 {
            shares.hole += one;
        }
    }
}

#[test]
fn half_a_pixel_bounds_the_error() {
    for seed in [3, 11] {
        let scene = Arc::new(procedural(seed));
        let (renderer, _) = renderer(&scene);
        let mut shares = Shares::default();
        cameras(&scene).iter().for_each(|camera| compare(&renderer, camera, &mut shares));
        println!("{seed}: {shares:?}");
        assert!(shares.depth < 0.03 && shares.instance < 0.05 && shares.hole < 0.001, "{seed}: {shares:?}");
    }
}

#[test]
fn details_are_independent_and_repeatable() {
    let scene = Arc::new(procedural(5));
    let [(first, _), (second, _)] = [renderer(&scene), renderer(&scene)];
    let cameras = cameras(&scene);
    let exact: Vec<CameraImage> = cameras.iter().map(|camera| first.render(camera)).collect();
    let mut differences = 0;
    for (camera, exact) in cameras.iter().zip(&exact) {
        let image = second.render_at(camera, Detail::HalfPixel);
        assert_eq!(first.render_at(camera, Detail::HalfPixel), image);
        assert_eq!(&first.render(camera), exact);
        assert_eq!(&second.render_at(camera, Detail::Exact), exact);
        differences += usize::from(&image != exact);
    }
    assert!(differences > VIEWS / 2, "{differences}");
}
