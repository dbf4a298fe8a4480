use super::shot::Shot;
use crate::npy;
use avln_geom::Vector3;
use avln_scene::{InstanceId, Scene};
use avln_world::{Camera, CameraImage};
use std::io;

/// Contents of pixels in procedural houses; a number is an index into this list. The first three are the building
/// itself: all of it that is neither floor nor ceiling counts as wall, what is out of reach included.
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
/// The number of pixels that show an instance whose category has no name here.
pub(super) const UNKNOWN: u8 = 255;
const WALL: u8 = 0;
const FLOOR: u8 = 1;
const CEILING: u8 = 2;
/// Largest distance of a point from the height of its floor or ceiling, metres.
const LEVEL_M: f32 = 0.02;
/// Heights of floors and ceilings differ by less than this where they are the same, metres.
const SAME_LEVEL_M: f32 = 1e-3;

/// Instances of a scene, and heights of its floors and ceilings.
pub(super) struct Labels {
    /// By instance id; that of none is not used.
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
        let levels = |level: fn(&avln_scene::Region) -> f32| {
            let mut levels: Vec<f32> = scene.regions.iter().map(level).collect();
            levels.sort_by(f32::total_cmp);
            levels.dedup_by(|a, b| (*a - *b).abs() < SAME_LEVEL_M);
            levels
        };
        let (floors_m, ceilings_m) = (levels(|room| room.bounds.min.y), levels(|room| room.bounds.max.y));
        Self { category_of, floors_m, ceilings_m }
    }

    /// Content of a pixel: an instance, or the building at `height_m` in the world; `None` beyond the range of the depth sensor.
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

/// Begins a file of `count` records: the camera (place in the world, height above the floor that one stands on, heading and
/// pitch, field of view), then colours, planar depth in millimetres (0 for none), categories and, as `instance_field`,
/// instances, all row by row.
pub(super) fn write_header(
    out: &mut Vec<u8>,
    instance_field: &str,
    side_px: u32,
    count: usize,
) -> io::Result<()> {
    let (one, square) = (|| "()".to_owned(), || format!("({side_px}, {side_px})"));
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
    npy::write_record_header(out, &fields, count)
}

/// Appends one record.
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

/// Height of the content of a pixel in the world, metres; `None` without depth.
fn height_m(camera: &Camera, pixel: usize, depth_m: f32) -> Option<f32> {
    let (column, row) = (pixel % camera.width as usize, pixel / camera.width as usize);
    let (sin, cos) = avln_geom::angle::sin_cos(0.5 * camera.hfov_rad);
    let metres_per_px = 2.0 * sin / cos / camera.width as f32;
    let from_middle = |at: usize, side: u32| (at as f32 + 0.5 - 0.5 * side as f32) * metres_per_px;
    let ray = Vector3::new(from_middle(column, camera.width), -from_middle(row, camera.height), -1.0);
    (depth_m > 0.0).then(|| (camera.eye + camera.world_from_camera * ray * depth_m).y)
}
