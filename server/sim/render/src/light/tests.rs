use super::*;
use avln_geom::{Point2, Point3, Vector3};
use avln_houses::{HouseOptions, house};
use avln_scene::{InstanceId, Lamp};
use std::collections::BTreeMap;

fn scene(lamps: Vec<Lamp>) -> Scene {
    Scene {
        name: "hand-made".into(),
        mesh: Mesh::default(),
        materials: Vec::new(),
        textures: Vec::new(),
        regions: Vec::new(),
        objects: Vec::new(),
        lighting: Lighting::Lamps(lamps),
    }
}

fn bulb(x: f32, y: f32, z: f32) -> Lamp {
    Lamp { position: Point3::new(x, y, z), facing: None, radius_m: 0.1, strength: [2.5; 3] }
}

/// Adds a box with eight vertices, seen from inside or outside.
fn add_box(mesh: &mut Mesh, min: [f32; 3], max: [f32; 3], from_inside: bool) {
    const SIDES: [[u32; 4]; 6] =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let first = mesh.positions.len() as u32;
    for corner in 0..8 {
        let at = |axis: usize| if corner >> axis & 1 == 0 { min[axis] } else { max[axis] };
        mesh.positions.push(Point3::new(at(0), at(1), at(2)));
        mesh.uvs.push(Point2::new(at(0), at(2)));
        mesh.colors.push([9; 3]);
    }
    for [a, b, c, d] in SIDES.map(|side| side.map(|corner| corner + first)) {
        let faces = [[a, b, c], [a, c, d]];
        mesh.triangles.extend(faces.map(|[a, b, c]| if from_inside { [a, c, b] } else { [a, b, c] }));
    }
    mesh.material_of.resize(mesh.triangles.len(), 0);
    mesh.instance_of.resize(mesh.triangles.len(), InstanceId(first + 1));
}

fn light(scene: &Scene) -> Mesh {
    lit(scene, &RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles)).expect("there are lamps")
}

fn normal(mesh: &Mesh, triangle: [u32; 3]) -> Vector3<f32> {
    let [a, b, c] = triangle.map(|corner| mesh.positions[corner as usize]);
    (b - a).cross(&(c - a))
}

/// Green light at the corner nearest to a position, among triangles facing `facing`.
fn light_at(mesh: &Mesh, facing: Vector3<f32>, [x, y, z]: [f32; 3]) -> i32 {
    let place = Point3::new(x, y, z);
    let seen =
        mesh.triangles.iter().filter(|&&triangle| normal(mesh, triangle).normalize().dot(&facing) > 0.9);
    let distance = |corner: u32| (mesh.positions[corner as usize] - place).norm();
    let nearest = seen.flatten().min_by(|a, b| distance(**a).total_cmp(&distance(**b)));
    i32::from(mesh.colors[*nearest.expect("a triangle faces the position") as usize][1])
}

fn area_m2(mesh: &Mesh) -> f32 {
    mesh.triangles.iter().map(|&triangle| 0.5 * normal(mesh, triangle).norm()).sum()
}

/// Triangle count per edge, by end positions.
fn edges(mesh: &Mesh) -> BTreeMap<[[u32; 3]; 2], usize> {
    let place = |vertex: u32| {
        let place = mesh.positions[vertex as usize];
        [place.x, place.y, place.z].map(|value| (value + 0.0).to_bits())
    };
    let mut edges = BTreeMap::new();
    for &[a, b, c] in &mesh.triangles {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let mut ends = [place(from), place(to)];
            ends.sort_unstable();
            *edges.entry(ends).or_default() += 1;
        }
    }
    edges
}

#[test]
fn subdivided_box_stays_closed_with_equal_faces() {
    let mut whole = Mesh::default();
    add_box(&mut whole, [-1.37, 0.0, 0.11], [2.9, 2.6, 5.3], true);
    // Faces with separate vertices: the split must depend on positions only.
    let mut apart = Mesh { triangles: Vec::new(), ..whole.clone() };
    for triangle in &whole.triangles {
        let first = apart.positions.len() as u32;
        apart.positions.extend(triangle.map(|corner| whole.positions[corner as usize]));
        apart.uvs.extend(triangle.map(|corner| whole.uvs[corner as usize]));
        apart.colors.extend([[9; 3]; 3]);
        apart.triangles.push([first + 2, first, first + 1]);
    }
    for mesh in [&whole, &apart] {
        let cut = super::cut(mesh);
        let edges = edges(&cut);
        assert!(cut.triangles.len() > 500 && edges.values().all(|&count| count == 2));
        for [from, to] in edges.keys().map(|ends| ends.map(|end| Point3::from(end.map(f32::from_bits)))) {
            assert!((from - to).norm() <= 0.5);
        }
        assert!((area_m2(&cut) - area_m2(mesh)).abs() < 1e-3);
        assert_eq!(
            (cut.material_of.len(), cut.instance_of.len()),
            (cut.triangles.len(), cut.triangles.len())
        );
        for &triangle in &cut.triangles {
            let normal = normal(&cut, triangle);
            let flat = (0..3).filter(|&axis| normal[axis] == 0.0).count();
            assert_eq!(flat, 2, "a piece of a face is tilted: {normal}");
        }
        for (place, uv) in cut.positions.iter().zip(&cut.uvs) {
            assert!((uv - Point2::new(place.x, place.z)).norm() < 1e-5);
        }
    }
}

#[test]
fn endless_edges_stay_whole() {
    for far in [1e4, f32::INFINITY, f32::NAN] {
        let mut mesh = Mesh::default();
        add_box(&mut mesh, [0.0; 3], [far; 3], false);
        assert_eq!(cut(&mesh).triangles, mesh.triangles);
        let lit = light(&Scene { mesh, ..scene(vec![bulb(1.0, 1.0, 1.0)]) });
        assert_eq!(lit.triangles.len(), 12);
    }
}

#[test]
fn white_room_is_brighter_under_lamp_than_corners() {
    let mut room = scene(vec![bulb(0.0, 2.2, 0.0)]);
    add_box(&mut room.mesh, [-2.0, 0.0, -2.0], [2.0, 2.6, 2.0], true);
    let lit = light(&room);
    let floor = |x: f32, z: f32| light_at(&lit, Vector3::y(), [x, 0.0, z]);
    assert!(floor(0.0, 0.0) > floor(1.25, 0.0) + 5);
    assert!(floor(1.25, 0.0) > floor(1.5, 1.5) && floor(1.5, 1.5) > floor(2.0, 2.0) + 15);
    assert!(floor(2.0, 2.0) > 60, "no corner is black: {}", floor(2.0, 2.0));
    for (x, z) in [(0.5, 0.0), (1.0, 0.5), (1.5, 1.5), (2.0, 0.0)] {
        let all = [floor(x, z), floor(-x, z), floor(x, -z), floor(-x, -z), floor(z, x)];
        let (least, most) = (all.iter().min().unwrap(), all.iter().max().unwrap());
        assert!(most - least <= 12, "({x}, {z}): {all:?}");
    }
    // The box has eight vertices, but every face has separate light.
    let wall = light_at(&lit, Vector3::x(), [-2.0, 1.3, 0.0]);
    assert!(wall < floor(0.0, 0.0), "{wall}");
    assert!((area_m2(&lit) - area_m2(&room.mesh)).abs() < 1e-3);
}

#[test]
fn floor_is_darker_under_a_table() {
    let mut room = scene(vec![bulb(0.0, 2.2, 0.0)]);
    add_box(&mut room.mesh, [-2.0, 0.0, -2.0], [2.0, 2.6, 2.0], true);
    add_box(&mut room.mesh, [-0.7, 0.7, -0.7], [0.7, 0.75, 0.7], false);
    let lit = light(&room);
    let [under, beside] = [[0.0; 3], [1.3, 0.0, 0.0]].map(|place| light_at(&lit, Vector3::y(), place));
    assert!(under + 15 < beside, "{under} and {beside}");
}

#[test]
fn floor_by_cupboard_is_no_darker_than_corners() {
    let mut room = scene(vec![bulb(0.0, 2.2, 0.0)]);
    add_box(&mut room.mesh, [-2.0, 0.0, -2.0], [2.0, 2.6, 2.0], true);
    add_box(&mut room.mesh, [-2.0, 0.0, -0.6], [-1.45, 1.8, 0.6], false);
    let lit = light(&room);
    // The nearest floor vertices are hidden under the cupboard but visible just outside.
    for x in [-1.75, -1.5, -1.25] {
        let floor = light_at(&lit, Vector3::y(), [x, 0.0, 0.0]);
        assert!(floor > 90, "{floor} at {x}");
    }
}

#[test]
fn walls_hide_lamps_and_windows_shine_ahead() {
    let closed = |lamp: Lamp| {
        let mut rooms = scene(vec![lamp]);
        add_box(&mut rooms.mesh, [-2.0, 0.0, -2.0], [2.0, 2.6, 2.0], true);
        add_box(&mut rooms.mesh, [2.1, 0.0, -2.0], [6.1, 2.6, 2.0], true);
        light(&rooms)
    };
    let dark = closed(Lamp { strength: [0.0; 3], ..bulb(0.0, 1.0, 0.0) });
    let plain = closed(bulb(1.5, 1.0, 0.0));
    let [here, there] = [[1.5, 0.0, 0.0], [2.7, 0.0, 0.0]];
    let up = |lit: &Mesh, place: [f32; 3]| light_at(lit, Vector3::y(), place);
    assert!(up(&plain, here) > up(&dark, here) + 25);
    assert_eq!(up(&plain, there), up(&dark, there), "the wall is closed");

    let mut shaded = scene(vec![Lamp { radius_m: 0.3, ..bulb(0.0, 1.0, 0.0) }]);
    add_box(&mut shaded.mesh, [-2.0, 0.0, -2.0], [2.0, 2.6, 2.0], true);
    add_box(&mut shaded.mesh, [-0.15, 0.85, -0.15], [0.15, 1.15, 0.15], false);
    let bare = Scene { lighting: Lighting::Lamps(vec![bulb(0.0, 1.0, 0.0)]), ..shaded.clone() };
    let floor = [0.5, 0.0, 0.5];
    assert!(
        up(&light(&shaded), floor) > up(&light(&bare), floor) + 10,
        "within its radius nothing hides a lamp"
    );

    let window = closed(Lamp { facing: Some(Vector3::x()), ..bulb(0.0, 1.0, 0.0) });
    assert!(up(&window, [0.75, 0.0, 0.0]) > up(&dark, [0.75, 0.0, 0.0]) + 8);
    assert_eq!(up(&window, [-0.75, 0.0, 0.0]), up(&dark, [-0.75, 0.0, 0.0]));
}

#[test]
fn painted_scenes_are_not_lit() {
    let mut painted = Scene { lighting: Lighting::Painted, ..scene(vec![]) };
    add_box(&mut painted.mesh, [-2.0, 0.0, -2.0], [2.0, 2.6, 2.0], true);
    let rays = RayMesh::new(&painted.mesh.positions, &painted.mesh.triangles);
    assert_eq!(lit(&painted, &rays), None);
}

#[test]
fn house_light_is_repeatable_and_bright() {
    let scene = house("light", 5, &HouseOptions::small());
    let lit = light(&scene);
    assert_eq!(lit, light(&scene));
    assert!(lit.triangles.len() < 4 * scene.mesh.triangles.len(), "{}", lit.triangles.len());
    assert!((area_m2(&lit) / area_m2(&scene.mesh) - 1.0).abs() < 1e-4);
    for room in &scene.regions {
        let floor = room.bounds.min.y;
        let inside = lit.positions.iter().zip(&lit.colors).filter(|(place, _)| room.bounds.contains(place));
        let light: Vec<f32> =
            inside.filter(|(p, _)| p.y == floor).map(|(_, color)| f32::from(color[1])).collect();
        let mean = light.iter().sum::<f32>() / light.len() as f32;
        assert!((130.0..240.0).contains(&mean), "{}: {mean}", room.label);
    }
    // Lamps are nearly white, so that colours keep their names.
    let tinted = lit.colors.iter().filter(|[r, g, b]| r.abs_diff(*g).max(g.abs_diff(*b)) > 12).count();
    assert_eq!(tinted, 0);
}

#[test]
fn lit_instances_have_equal_surfaces() {
    let scene = house("light", 5, &HouseOptions::small());
    let lit = light(&scene);
    let areas = |mesh: &Mesh| {
        let mut areas: BTreeMap<(InstanceId, u16), f64> = BTreeMap::new();
        for (index, &triangle) in mesh.triangles.iter().enumerate() {
            let key = (mesh.instance_of[index], mesh.material_of[index]);
            *areas.entry(key).or_default() += 0.5 * f64::from(normal(mesh, triangle).norm());
        }
        areas
    };
    let (before, after) = (areas(&scene.mesh), areas(&lit));
    assert_eq!(before.len(), after.len());
    for (key, area) in before {
        assert!((after[&key] - area).abs() < 1e-4 * area.max(0.01), "{key:?}");
    }
}
