//! Scene pictures for people: every storey from above, and views from inside rooms.

use avln_geom::{Aabb, Point2, Point3, RayMesh, Vector3, angle};
use avln_render::{Camera, CameraImage, ModelCache, ModelCacheEntry, Renderer};
use avln_scene::digest::digest;
use avln_scene::{InstanceId, Lighting, Mesh, Scene};
use avln_world::Cache;
use std::collections::BTreeMap;
use std::f32::consts::{FRAC_PI_2, TAU};
use std::io::Write;
use std::sync::Arc;

/// Eye height above the floor, metres.
const EYE_M: f32 = 1.5;
/// Free floor around the eye, metres.
const ELBOW_ROOM_M: f32 = 0.35;
/// Grid spacing for eye positions, metres.
const STEP_M: f32 = 0.5;
/// Eye positions per room.
const PLACES: usize = 24;
const DIRECTIONS: usize = 8;
const HFOV_RAD: f32 = 1.4;

/// A named picture.
#[derive(Clone, Debug)]
pub struct Picture {
    /// File name without extension: `storey-0`, `view-3-kitchen` …
    pub name: String,
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `height × width × 3` bytes, sRGB.
    pub rgb: Vec<u8>,
}

impl Picture {
    /// Names a frame.
    pub fn of(name: String, frame: CameraImage) -> Self {
        Self { name, width: frame.width, height: frame.height, rgb: frame.rgb }
    }

    /// Writes a PNG file.
    ///
    /// # Errors
    /// If `out` cannot be written.
    pub fn write_png(&self, out: impl Write) -> Result<(), png::EncodingError> {
        let mut encoder = png::Encoder::new(out, self.width, self.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::Fast);
        encoder.write_header()?.write_image_data(&self.rgb)
    }
}

/// A scene with a renderer.
pub struct SceneRenderer {
    /// The scene; the renderer owns the textures.
    pub scene: Arc<Scene>,
    /// The scene's triangles.
    pub rays: Arc<RayMesh>,
    /// The renderer.
    pub renderer: Renderer,
}

impl SceneRenderer {
    /// Prepares a scene. `cache` stores the renderer's intermediate results.
    pub fn new(mut scene: Scene, cache: Option<Arc<dyn Cache>>) -> Self {
        let entry =
            cache.map(|cache| ModelCacheEntry { cache: cache as Arc<dyn ModelCache>, name: digest(&scene) });
        let textures = std::mem::take(&mut scene.textures);
        let scene = Arc::new(scene);
        let rays = Arc::new(RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles));
        let renderer = Renderer::with_cache(Arc::clone(&scene), textures, Arc::clone(&rays), entry);
        Self { scene, rays, renderer }
    }

    /// Renders the view from `eye` in a direction.
    fn look(&self, eye: Point3<f32>, heading_rad: f32, width: u32) -> CameraImage {
        let height = width * 3 / 4;
        let world_from_camera = angle::about_up(heading_rad);
        let camera = Camera { eye, world_from_camera, width, height, hfov_rad: HFOV_RAD, depth_max_m: 100.0 };
        self.renderer.render(&camera)
    }

    /// Returns a room's views in distinct directions, best first.
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
            let turn_rad = |kept: &RoomView| angle::wrap(kept.heading_rad - view.heading_rad).abs();
            if kept.iter().all(|kept| turn_rad(kept) >= FRAC_PI_2 - 0.01) {
                kept.push(view);
            }
        }
        kept
    }

    /// Returns eye positions in a room's open areas.
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

    /// Returns `true` with floor below and no obstacle around.
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

/// Scores a small frame: many objects, none of them too near.
fn interest(frame: &CameraImage) -> f32 {
    /// Fewest pixels for a visible object.
    const SEEN_PIXELS: usize = 12;
    let mut pixels: BTreeMap<InstanceId, usize> = BTreeMap::new();
    frame.instances.iter().for_each(|id| *pixels.entry(*id).or_default() += 1);
    let seen = pixels.iter().filter(|(id, count)| **id != InstanceId::NONE && **count >= SEEN_PIXELS).count();
    let near = frame.depth.iter().filter(|depth| **depth < 0.9).count() as f32 / frame.depth.len() as f32;
    seen as f32 - 12.0 * near
}

struct RoomView {
    eye: Point3<f32>,
    heading_rad: f32,
    score: f32,
}

/// Returns the rooms by label and box; the whole scene if no rooms are known.
fn rooms(scene: &Scene) -> Vec<(String, Aabb)> {
    let rooms: Vec<_> = scene.regions.iter().map(|region| (region.label.clone(), region.bounds)).collect();
    match scene.bounds() {
        Some(bounds) if rooms.is_empty() => vec![("scene".to_owned(), bounds)],
        _ => rooms,
    }
}

/// Renders up to `count` views from inside rooms.
pub fn indoors(viewer: &SceneRenderer, count: usize) -> Vec<Picture> {
    let rooms = rooms(&viewer.scene);
    // A second bedroom shows little news: every room label has a turn before any label has two.
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

/// Replaces all characters except letters and digits, for file names.
fn file_word(label: &str) -> String {
    label.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect()
}

/// Cut height above the floor, metres: walls and furniture end here.
const CUT_M: f32 = 1.7;
/// Depth below a floor that belongs to the storey, metres.
const BELOW_M: f32 = 0.15;
/// Resolution, pixels per metre, within the size limit.
const PIXELS_PER_M: f32 = 80.0;
/// Size limit for a picture's sides, pixels.
const LONGEST_PX: f32 = 1600.0;
/// Half the field of view, radians: in a narrow view from a great height, walls are upright.
const HALF_VIEW_RAD: f32 = 0.04;
/// Colour outside the building, sRGB.
const PAPER_RGB: [u8; 3] = [58, 60, 66];

/// Renders every storey from above without ceiling, -Z at the top.
pub fn storeys(scene: &Scene) -> Vec<Picture> {
    let floors = floors(scene).into_iter().enumerate();
    let picture = |(index, bounds)| Some(Picture::of(format!("storey-{index}"), from_above(scene, &bounds)?));
    floors.filter_map(picture).collect()
}

/// Returns a box around the rooms by storey, lowest first.
fn floors(scene: &Scene) -> Vec<Aabb> {
    let mut floors: BTreeMap<u16, Aabb> = BTreeMap::new();
    for region in &scene.regions {
        let floor = floors.entry(region.storey).or_insert(region.bounds);
        *floor = floor.union(&region.bounds);
    }
    if floors.is_empty() { scene.bounds().into_iter().collect() } else { floors.into_values().collect() }
}

/// Renders everything below the cut, seen from above; `None` without geometry.
fn from_above(scene: &Scene, bounds: &Aabb) -> Option<CameraImage> {
    let cut = Arc::new(cut(scene, bounds.min.y));
    if cut.mesh.triangles.is_empty() {
        return None;
    }
    let rays = Arc::new(RayMesh::new(&cut.mesh.positions, &cut.mesh.triangles));
    let margin = bounds.grown(0.3);
    let size = margin.size();
    let scale = PIXELS_PER_M.min(LONGEST_PX / size.x.max(size.z));
    let middle = margin.center();
    // The tangent of a small angle is the angle.
    let height_m = size.x / 2.0 / HALF_VIEW_RAD;
    let camera = Camera {
        eye: Point3::new(middle.x, bounds.min.y + height_m, middle.z),
        world_from_camera: angle::about_right(-FRAC_PI_2),
        width: (size.x * scale).ceil().max(1.0) as u32,
        height: (size.z * scale).ceil().max(1.0) as u32,
        hfov_rad: 2.0 * HALF_VIEW_RAD,
        depth_max_m: 2.0 * height_m,
    };
    let mut frame = Renderer::new(cut, rays).render(&camera);
    for (pixel, depth) in frame.rgb.as_chunks_mut::<3>().0.iter_mut().zip(&frame.depth) {
        if *depth == 0.0 {
            *pixel = PAPER_RGB;
        }
    }
    Some(frame)
}

/// Returns the geometry between a floor and the cut, with plain lighting.
fn cut(scene: &Scene, floor_m: f32) -> Scene {
    let mut mesh = Mesh::default();
    for index in 0..scene.mesh.triangles.len() {
        let low = scene.corners(index).iter().map(|corner| corner.y).fold(f32::INFINITY, f32::min);
        if low >= floor_m - BELOW_M && low < floor_m + CUT_M {
            add_cut(&mut mesh, &scene.mesh, index, floor_m + CUT_M);
        }
    }
    Scene { mesh, regions: vec![], objects: vec![], lighting: Lighting::Painted, ..scene.clone() }
}

/// Adds a triangle's part below the height `top_m`.
fn add_cut(mesh: &mut Mesh, from: &Mesh, index: usize, top_m: f32) {
    let corners: Vec<Corner> =
        from.triangles[index].iter().map(|&corner| Corner::of(from, corner as usize)).collect();
    let mut kept: Vec<Corner> = Vec::with_capacity(4);
    for (i, corner) in corners.iter().enumerate() {
        let next = &corners[(i + 1) % 3];
        let (here, there) = (top_m - corner.position.y, top_m - next.position.y);
        if here >= 0.0 {
            kept.push(*corner);
        }
        if (here > 0.0 && there < 0.0) || (here < 0.0 && there > 0.0) {
            kept.push(corner.towards(next, here / (here - there)));
        }
    }
    let first = mesh.positions.len() as u32;
    for corner in &kept {
        mesh.positions.push(corner.position);
        mesh.uvs.push(corner.uv);
        mesh.colors.push(corner.color);
    }
    for i in 2..kept.len() as u32 {
        mesh.triangles.push([first, first + i - 1, first + i]);
        mesh.material_of.push(from.material_of[index]);
        mesh.instance_of.push(from.instance_of[index]);
    }
}

#[derive(Clone, Copy)]
struct Corner {
    position: Point3<f32>,
    uv: Point2<f32>,
    color: [u8; 3],
}

impl Corner {
    fn of(mesh: &Mesh, index: usize) -> Self {
        Self { position: mesh.positions[index], uv: mesh.uvs[index], color: mesh.colors[index] }
    }

    fn towards(&self, other: &Self, share: f32) -> Self {
        let color = |channel: usize| {
            let (a, b) = (f32::from(self.color[channel]), f32::from(other.color[channel]));
            (a + (b - a) * share).round() as u8
        };
        Self {
            position: self.position + (other.position - self.position) * share,
            uv: self.uv + (other.uv - self.uv) * share,
            color: [color(0), color(1), color(2)],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_houses::{HouseOptions, house};

    #[test]
    fn eight_views_come_from_open_positions() {
        let viewer = SceneRenderer::new(house("preview", 2, &HouseOptions::default()), None);
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

    #[test]
    fn floors_fill_the_plan_below_the_cut() {
        let scene = house("preview", 1, &HouseOptions::default());
        let pictures = storeys(&scene);
        let storeys = scene.regions.iter().map(|region| region.storey).max().map_or(0, usize::from) + 1;
        assert_eq!(pictures.len(), storeys);
        for picture in &pictures {
            assert_eq!(picture.rgb.len(), (picture.width * picture.height * 3) as usize);
            let inside = picture.rgb.as_chunks::<3>().0.iter().filter(|pixel| **pixel != PAPER_RGB).count();
            assert!(inside * 3 > picture.rgb.len() / 3, "{}: {inside} pixels", picture.name);
        }
        let cut = cut(&scene, 0.0);
        assert!(cut.mesh.positions.iter().all(|point| point.y <= CUT_M + 1e-4));
    }

    #[test]
    fn cut_triangles_keep_their_lower_part() {
        let scene = house("preview", 1, &HouseOptions::default());
        let whole = Mesh {
            positions: vec![
                Point3::new(0.0, 0.0, 0.0),
                Point3::new(2.0, 0.0, 0.0),
                Point3::new(0.0, 2.0, 0.0),
            ],
            uvs: vec![Point2::origin(); 3],
            colors: vec![[0; 3], [0; 3], [200; 3]],
            triangles: vec![[0, 1, 2]],
            material_of: vec![0],
            instance_of: vec![scene.objects[0].id],
        };
        let mut cut = Mesh::default();
        add_cut(&mut cut, &whole, 0, 1.0);
        assert_eq!(cut.triangles.len(), 2);
        assert!(cut.positions.contains(&Point3::new(1.0, 1.0, 0.0)));
        assert!(cut.colors.contains(&[100; 3]), "half-way up");
    }
}
