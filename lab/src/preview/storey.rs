//! A storey seen from above.

use super::Picture;
use avln_geom::{Aabb, Point2, Point3, RayMesh, angle};
use avln_render::{Camera, CameraImage, Renderer};
use avln_scene::{Lighting, Mesh, Scene};
use std::collections::BTreeMap;
use std::f32::consts::FRAC_PI_2;
use std::sync::Arc;

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
