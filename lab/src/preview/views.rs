use super::{Picture, rooms};
use crate::scene_renderer::SceneRenderer;
use avln_geom::{Aabb, Point3, RayMesh, Vector3, angle};
use avln_render::{Camera, CameraImage, Renderer};
use avln_scene::{InstanceId, Scene};
use avln_world::Cache;
use std::collections::BTreeMap;
use std::f32::consts::{FRAC_PI_2, TAU};
use std::sync::Arc;

/// Height of the eye above the floor, metres.
const EYE_M: f32 = 1.5;

/// Free floor around the eye, metres.
const ELBOW_ROOM_M: f32 = 0.35;

/// Distance between the places that are tried, metres.
const STEP_M: f32 = 0.5;

/// Places tried in one room.
const PLACES: usize = 24;

/// Directions tried at each place.
const DIRECTIONS: usize = 8;

const HFOV_RAD: f32 = 1.4;

/// Takes pictures inside of one scene.
pub struct Viewer {
    scene: Arc<Scene>,
    rays: Arc<RayMesh>,
    renderer: Renderer,
}

/// A view and how much there is to see.
struct RoomView {
    eye: Point3<f32>,
    heading_rad: f32,
    score: f32,
}

impl Viewer {
    /// A viewer of `scene`; what pictures are made from is looked for and kept in `cache`.
    pub fn new(scene: Scene, cache: Option<Arc<dyn Cache>>) -> Self {
        let SceneRenderer { scene, rays, renderer } = SceneRenderer::new(scene, cache);
        Self { renderer, scene, rays }
    }

    /// Picture from `eye` in the direction `heading_rad`.
    fn look(&self, eye: Point3<f32>, heading_rad: f32, width: u32) -> CameraImage {
        let height = width * 3 / 4;
        let world_from_camera = angle::about_up(heading_rad);
        let camera = Camera { eye, world_from_camera, width, height, hfov_rad: HFOV_RAD, depth_max_m: 100.0 };
        self.renderer.render(&camera)
    }

    /// Views of a room, those that show most first, each from another side than the ones before.
    fn views_of(&self, room: &Aabb) -> Vec<RoomView> {
        let mut views: Vec<RoomView> = Vec::new();
        for eye in self.places_in(room) {
            for direction in 0..DIRECTIONS {
                let heading_rad = TAU * (direction as f32 + 0.5) / DIRECTIONS as f32;
                let score = interest(&self.look(eye, heading_rad, 64));
                views.push(RoomView { eye, heading_rad, score });
            }
        }
        views.sort_by(|a, b| b.score.total_cmp(&a.score));
        let mut kept: Vec<RoomView> = Vec::new();
        for view in views {
            let other =
                |kept: &RoomView| angle::wrap(kept.heading_rad - view.heading_rad).abs() >= FRAC_PI_2 - 0.01;
            if kept.iter().all(other) {
                kept.push(view);
            }
        }
        kept
    }

    /// Some places in a room where one can stand.
    fn places_in(&self, room: &Aabb) -> Vec<Point3<f32>> {
        let size = room.size();
        let count = |length: f32| ((length - 2.0 * ELBOW_ROOM_M) / STEP_M).floor().max(0.0) as usize + 1;
        let (columns, rows) = (count(size.x), count(size.z));
        let at = |index: usize| {
            let (i, k) = (index % columns, index / columns);
            let offset = |i: usize, count: usize, length: f32| length * (i as f32 + 0.5) / count as f32;
            let (x, z) = (offset(i, columns, size.x), offset(k, rows, size.z));
            Point3::new(room.min.x + x, room.min.y + EYE_M, room.min.z + z)
        };
        let places: Vec<_> = (0..columns * rows).map(at).filter(|eye| self.is_open(eye)).collect();
        let stride = places.len().div_ceil(PLACES).max(1);
        places.into_iter().step_by(stride).collect()
    }

    /// True if an agent can stand there: floor below, no obstacle near.
    fn is_open(&self, eye: &Point3<f32>) -> bool {
        let below = self.rays.cast(eye, &-Vector3::y(), EYE_M + 0.3);
        let on_floor = below.is_some_and(|hit| hit.distance > EYE_M - 0.1);
        let chest = eye - Vector3::y() * 0.7;
        let near = (0..8).any(|i| {
            let (sin, cos) = angle::sin_cos(TAU * i as f32 / 8.0);
            let ahead = Vector3::new(sin, 0.0, cos);
            [eye, &chest].iter().any(|from| self.rays.cast(from, &ahead, ELBOW_ROOM_M).is_some())
        });
        on_floor && !near
    }
}

/// Score of the content of a small picture: many objects, none of them too near.
fn interest(frame: &CameraImage) -> f32 {
    const SEEN_PIXELS: usize = 12;
    let mut pixels: BTreeMap<InstanceId, usize> = BTreeMap::new();
    frame.instances.iter().for_each(|id| *pixels.entry(*id).or_default() += 1);
    let seen = pixels.iter().filter(|(id, count)| **id != InstanceId::NONE && **count >= SEEN_PIXELS).count();
    let near = frame.depth.iter().filter(|depth| **depth < 0.9).count() as f32 / frame.depth.len() as f32;
    seen as f32 - 12.0 * near
}

/// At most `count` views from inside rooms: first one of each kind of room, then of the others, then again.
pub fn indoors(viewer: &Viewer, count: usize) -> Vec<Picture> {
    let rooms = rooms(&viewer.scene);
    let mut seen: BTreeMap<&str, usize> = BTreeMap::new();
    let mut order: Vec<(usize, usize)> = Vec::new();
    for (index, (label, _)) in rooms.iter().enumerate() {
        let turn = seen.entry(label).or_default();
        order.push((*turn, index));
        *turn += 1;
    }
    order.sort();
    let chosen: Vec<usize> = order.into_iter().map(|(_, index)| index).take(count).collect();
    let views: Vec<(usize, Vec<RoomView>)> =
        chosen.into_iter().map(|index| (index, viewer.views_of(&rooms[index].1))).collect();
    let turns =
        (0..DIRECTIONS).flat_map(|turn| views.iter().map(move |(room, views)| (*room, views.get(turn))));
    let picked = turns.filter_map(|(room, view)| Some((room, view?))).take(count).enumerate();
    picked
        .map(|(number, (room, view))| {
            let name = format!("view-{number}-{}", file_word(&rooms[room].0));
            Picture::of(name, viewer.look(view.eye, view.heading_rad, 640))
        })
        .collect()
}

/// A label as a part of a file's name: letters, digits and `_`.
fn file_word(label: &str) -> String {
    label.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_houses::{HouseOptions, house};

    #[test]
    fn eight_views_from_places_where_one_can_stand() {
        let viewer = Viewer::new(house("preview", 2, &HouseOptions::default()), None);
        let pictures = indoors(&viewer, 8);
        assert_eq!(pictures.len(), 8);
        let kinds: std::collections::BTreeSet<_> =
            pictures.iter().filter_map(|picture| picture.name.rsplit('-').next()).collect();
        assert!(kinds.len() >= 4, "{kinds:?}");
        let room = viewer.scene.regions[0].bounds;
        for eye in viewer.places_in(&room) {
            assert!(room.contains(&eye) && viewer.is_open(&eye));
        }
    }
}
