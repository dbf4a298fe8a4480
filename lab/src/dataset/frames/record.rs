//! Labelled images: cameras, labels and records.

use crate::npy;
use avln_geom::{Point3, Rng, Vector3, angle};
use avln_scene::{InstanceId, Object, Region, Scene};
use avln_world::{Camera, CameraImage, SceneAssets};
use std::collections::BTreeMap;
use std::f32::consts::{FRAC_PI_4, PI};
use std::io;

/// Category names by number. The first three are the building itself; everything but floors and ceilings counts as wall,
/// including pixels beyond the depth range.
pub const CATEGORIES: [&str; 41] = [
    "wall",
    "floor",
    "ceiling",
    "appliances",
    "basket",
    "bathtub",
    "bed",
    "bin",
    "blinds",
    "board_panel",
    "books",
    "cabinet",
    "chair",
    "chest_of_drawers",
    "clock",
    "clothes",
    "counter",
    "curtain",
    "cushion",
    "door",
    "fireplace",
    "gym_equipment",
    "lighting",
    "mirror",
    "picture",
    "plant",
    "radiator",
    "rug",
    "seating",
    "shelving",
    "shower",
    "sink",
    "sofa",
    "statue",
    "stool",
    "table",
    "toilet",
    "towel",
    "tv_monitor",
    "vase",
    "window",
];
/// Number for instances in other categories.
pub(super) const UNKNOWN: u8 = 255;
const WALL: u8 = 0;
const FLOOR: u8 = 1;
const CEILING: u8 = 2;
/// Height tolerance for points on floors and ceilings, metres.
const LEVEL_M: f32 = 0.02;
/// Height difference between equal levels, metres.
const SAME_LEVEL_M: f32 = 1e-3;

pub(super) struct Labels {
    category_of: Vec<u8>,
    floors_m: Vec<f32>,
    ceilings_m: Vec<f32>,
}

impl Labels {
    pub(super) fn of(scene: &Scene) -> Self {
        let most = scene.objects.iter().map(|object| object.id.0 as usize).max().unwrap_or(0);
        let mut category_of = vec![UNKNOWN; most + 1];
        for object in &scene.objects {
            category_of[object.id.0 as usize] = number(&object.category);
        }
        let levels = |level: fn(&Region) -> f32| {
            let mut levels: Vec<f32> = scene.regions.iter().map(level).collect();
            levels.sort_by(f32::total_cmp);
            levels.dedup_by(|a, b| (*a - *b).abs() < SAME_LEVEL_M);
            levels
        };
        Self {
            category_of,
            floors_m: levels(|room| room.bounds.min.y),
            ceilings_m: levels(|room| room.bounds.max.y),
        }
    }

    /// Returns a pixel's category: an instance's, or the building's by world height; `None` for a height beyond the depth range.
    fn category(&self, instance: InstanceId, height_m: Option<f32>) -> u8 {
        if instance != InstanceId::NONE {
            return self.category_of.get(instance.0 as usize).copied().unwrap_or(UNKNOWN);
        }
        let Some(height_m) = height_m else { return WALL };
        let at = |levels: &[f32]| levels.iter().any(|level| (level - height_m).abs() < LEVEL_M);
        match (at(&self.floors_m), at(&self.ceilings_m)) {
            (true, _) => FLOOR,
            (_, true) => CEILING,
            _ => WALL,
        }
    }
}

fn number(category: &str) -> u8 {
    CATEGORIES.iter().position(|name| *name == category).map_or(UNKNOWN, |number| number as u8)
}

/// Writes the header for `count` records: camera (world position, height above the floor, heading, pitch, field of view),
/// colours, planar depth in millimetres (0 for no hit), categories, and instances as `instance_field`; row by row.
pub(super) fn write_header(
    out: &mut Vec<u8>,
    instance_field: &str,
    side_px: u32,
    count: usize,
) -> io::Result<()> {
    let one = || "()".to_owned();
    let square = || format!("({side_px}, {side_px})");
    let fields = [
        ("eye_m", "<f4", "(3,)".to_owned()),
        ("height_m", "<f4", one()),
        ("heading_rad", "<f4", one()),
        ("pitch_rad", "<f4", one()),
        ("hfov_rad", "<f4", one()),
        ("rgb", "|u1", format!("({side_px}, {side_px}, 3)")),
        ("depth_mm", "<u2", square()),
        ("category", "|u1", square()),
        (instance_field, "<u2", square()),
    ];
    let fields = fields.map(|(name, kind, shape)| format!("('{name}', '{kind}', {shape})"));
    npy::write_header(out, &format!("[{}]", fields.join(", ")), &[count])
}

pub(super) fn append(out: &mut Vec<u8>, shot: &Shot, frame: &CameraImage, labels: &Labels) {
    let eye = shot.camera.eye;
    let camera = [eye.x, eye.y, eye.z, shot.height_m, shot.heading_rad, shot.pitch_rad, shot.camera.hfov_rad];
    out.extend(camera.into_iter().flat_map(f32::to_le_bytes));
    out.extend(&frame.rgb);
    let millimetres = |depth_m: &f32| (depth_m * 1e3).round() as u16;
    out.extend(frame.depth.iter().flat_map(|depth_m| millimetres(depth_m).to_le_bytes()));
    let category = |(pixel, instance): (usize, &InstanceId)| {
        labels.category(*instance, height_m(&shot.camera, pixel, frame.depth[pixel]))
    };
    out.extend(frame.instances.iter().enumerate().map(category));
    out.extend(frame.instances.iter().flat_map(|instance| (instance.0 as u16).to_le_bytes()));
}

/// Returns the world height of a pixel's content, metres; `None` without depth.
fn height_m(camera: &Camera, pixel: usize, depth_m: f32) -> Option<f32> {
    let (column, row) = (pixel % camera.width as usize, pixel / camera.width as usize);
    let (sin, cos) = angle::sin_cos(0.5 * camera.hfov_rad);
    let metres_per_px = 2.0 * sin / cos / camera.width as f32;
    let from_middle = |at: usize, side: u32| (at as f32 + 0.5 - 0.5 * side as f32) * metres_per_px;
    let ray = Vector3::new(from_middle(column, camera.width), -from_middle(row, camera.height), -1.0);
    (depth_m > 0.0).then(|| (camera.eye + camera.world_from_camera * ray * depth_m).y)
}

/// Share of cameras in agents' position: level, at [`EYE_M`], with [`HFOV_RAD`].
const USUAL: f64 = 0.8;
const EYE_M: f32 = 1.0;
const HFOV_RAD: f32 = 2.0 * FRAC_PI_4;
/// Ranges for other cameras: height above the floor, metres; pitch and field of view, radians.
const EYES_M: [f32; 2] = [0.6, 1.6];
const PITCHES_RAD: [f32; 2] = [-0.45, 0.25];
const HFOVS_RAD: [f32; 2] = [1.05, 1.75];
/// Share of cameras aimed at an object; others have a random heading.
const AIMED: f64 = 0.6;
/// Distance to the object's box, metres, and largest angle between the object and the image's middle, radians.
const REACHES_M: [f32; 2] = [0.3, 3.5];
const ASIDE_RAD: f32 = 0.6;
/// Attempts per aimed camera.
const TRIES: usize = 40;
const DEPTH_MAX_M: f32 = 10.0;

/// A camera above a floor.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shot {
    pub(super) camera: Camera,
    /// Height above the floor, metres.
    pub(super) height_m: f32,
    pub(super) heading_rad: f32,
    /// Positive looks up.
    pub(super) pitch_rad: f32,
}

pub(super) fn shots(assets: &SceneAssets, rng: &mut Rng, count: usize, side_px: u32) -> Vec<Shot> {
    let mut kinds: BTreeMap<&str, Vec<&Object>> = BTreeMap::new();
    for object in &assets.scene.objects {
        kinds.entry(&object.category).or_default().push(object);
    }
    let kinds: Vec<Vec<&Object>> = kinds.into_values().collect();
    (0..count).map(|_| shot(assets, rng, &kinds, side_px)).collect()
}

fn shot(assets: &SceneAssets, rng: &mut Rng, kinds: &[Vec<&Object>], side_px: u32) -> Shot {
    let is_usual = rng.chance(USUAL);
    let mut within =
        |[low, high]: [f32; 2], otherwise: f32| if is_usual { otherwise } else { rng.range(low, high) };
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

/// Draws an eye position above walkable floor.
fn stand(assets: &SceneAssets, rng: &mut Rng, height_m: f32) -> Point3<f32> {
    let mesh = &assets.navmesh;
    mesh.sample(rng, mesh.largest_island()).position() + Vector3::y() * height_m
}

/// Draws an eye position with a view of a near object, and a heading towards the object. Categories are equally likely.
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
