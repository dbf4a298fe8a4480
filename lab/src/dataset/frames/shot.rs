use avln_geom::{Point3, Rng, Vector3, angle};
use avln_scene::Object;
use avln_world::{Camera, SceneAssets};
use std::collections::BTreeMap;
use std::f32::consts::{FRAC_PI_4, PI};

/// Share of the cameras that stand as agents do: level, at [`EYE_M`], with [`HFOV_RAD`].
const USUAL: f64 = 0.8;
const EYE_M: f32 = 1.0;
const HFOV_RAD: f32 = 2.0 * FRAC_PI_4;
/// The others: height above the floor, metres; pitch and field of view, radians.
const EYES_M: [f32; 2] = [0.6, 1.6];
const PITCHES_RAD: [f32; 2] = [-0.45, 0.25];
const HFOVS_RAD: [f32; 2] = [1.05, 1.75];
/// Share of the cameras that look towards some object; the others look anywhere.
const AIMED: f64 = 0.6;
/// Distance of the camera from the box, metres, and of the box from the middle of the picture, radians.
const REACHES_M: [f32; 2] = [0.3, 3.5];
const ASIDE_RAD: f32 = 0.6;
/// Places that are tried for a look at an object.
const TRIES: usize = 40;
/// Depth is told up to here, metres.
const DEPTH_MAX_M: f32 = 10.0;

/// A camera, and how it stands to the floor below it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shot {
    pub(super) camera: Camera,
    /// Above the floor that its body would stand on, metres.
    pub(super) height_m: f32,
    pub(super) heading_rad: f32,
    /// Positive looks up.
    pub(super) pitch_rad: f32,
}

/// Cameras above places where one can walk.
pub(super) fn shots(assets: &SceneAssets, rng: &mut Rng, count: usize, side_px: u32) -> Vec<Shot> {
    let mut kinds: BTreeMap<&str, Vec<&Object>> = BTreeMap::new();
    for object in &assets.scene.objects {
        kinds.entry(&object.category).or_default().push(object);
    }
    let kinds: Vec<Vec<&Object>> = kinds.into_values().collect();
    (0..count).map(|_| shot(assets, rng, &kinds, side_px)).collect()
}

fn shot(assets: &SceneAssets, rng: &mut Rng, kinds: &[Vec<&Object>], side_px: u32) -> Shot {
    let usual = rng.chance(USUAL);
    let mut within =
        |[low, high]: [f32; 2], otherwise: f32| if usual { otherwise } else { rng.range(low, high) };
    let height_m = within(EYES_M, EYE_M);
    let (pitch_rad, hfov_rad) = (within(PITCHES_RAD, 0.0), within(HFOVS_RAD, HFOV_RAD));
    let aim = rng.chance(AIMED).then(|| aimed(assets, rng, kinds, height_m)).flatten();
    let (eye, heading_rad) = aim.unwrap_or_else(|| (stand(assets, rng, height_m), rng.range(-PI, PI)));
    let world_from_camera = angle::about_up(heading_rad) * angle::about_right(pitch_rad);
    let camera = Camera {
        eye,
        world_from_camera,
        width: side_px,
        height: side_px,
        hfov_rad,
        depth_max_m: DEPTH_MAX_M,
    };
    Shot { camera, height_m, heading_rad, pitch_rad }
}

/// An eye above some place where one can walk.
fn stand(assets: &SceneAssets, rng: &mut Rng, height_m: f32) -> Point3<f32> {
    let mesh = &assets.navmesh;
    mesh.sample(rng, mesh.largest_island()).position() + Vector3::y() * height_m
}

/// An eye near an object of some kind, every kind as likely as the others, that sees it, and a heading about towards it.
fn aimed(
    assets: &SceneAssets,
    rng: &mut Rng,
    kinds: &[Vec<&Object>],
    height_m: f32,
) -> Option<(Point3<f32>, f32)> {
    let kind = rng.choose(kinds)?;
    let object = *rng.choose(kind)?;
    let near = |eye: &Point3<f32>| (REACHES_M[0]..REACHES_M[1]).contains(&object.bounds.distance_m(eye));
    let mut eyes = (0..TRIES).map(|_| stand(assets, rng, height_m)).filter(near);
    let eye = eyes.find(|eye| assets.sees(eye, object.id, FRAC_PI_4))?;
    let offset = object.bounds.center() - eye;
    Some((eye, angle::wrap(angle::atan2(-offset.x, -offset.z) + rng.range(-ASIDE_RAD, ASIDE_RAD))))
}
