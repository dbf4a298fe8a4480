//! Export and import: one digest for a scene and for its file.

use avln_formats::glb;
use avln_geom::{Aabb, Point2, Point3, Rng};
use avln_houses::{HouseOptions, house};
use avln_scene::digest::canonical;
use avln_scene::digest::digest;
use avln_scene::{Attributes, InstanceId, Lighting, Material, Mesh, Object, Scene, Texture};

/// Triangles at random places, of random things and materials.
fn scattered(seed: u64) -> Scene {
    let mut rng = Rng::new(seed);
    let mut mesh = Mesh::default();
    for _ in 0..60 {
        mesh.positions.push(Point3::new(rng.range(0.0, 5.0), rng.range(0.0, 3.0), rng.range(0.0, 4.0)));
        mesh.uvs.push(Point2::new(rng.range(0.0, 1.0), rng.range(0.0, 1.0)));
        mesh.colors.push([rng.below(256) as u8; 3]);
    }
    for _ in 0..200 {
        mesh.triangles.push(std::array::from_fn(|_| rng.below(60) as u32));
        mesh.material_of.push(rng.below(7) as u16);
        mesh.instance_of.push(InstanceId(rng.below(5) as u32));
    }
    let texture = |shade: u8| Texture { width: 1, height: 1, pixels: vec![shade, 0, 0, 255] };
    let material = |number: u8| Material {
        name: format!("m{number}"),
        base_color: [number; 4],
        texture: (!number.is_multiple_of(3)).then_some(u16::from(4 - number % 4)),
        alpha_cutoff: None,
    };
    let object = |id: u32| Object {
        id: InstanceId(id),
        category: "chair".to_owned(),
        bounds: Aabb::new(Point3::origin(), Point3::origin()),
        region: None,
        attributes: Attributes::default(),
    };
    let mut scene = Scene {
        name: "scattered".to_owned(),
        materials: (0..9).map(material).collect(),
        textures: (0..6).map(texture).collect(),
        regions: Vec::new(),
        objects: [1, 3, 4].map(object).to_vec(),
        mesh,
        lighting: Lighting::Painted,
    };
    for object in &mut scene.objects {
        let mesh = &scene.mesh;
        let whole = |[a, b, c]: [u32; 3]| a != b && b != c && c != a;
        let corners: Vec<Point3<f32>> = (0..200)
            .filter(|&triangle| mesh.instance_of[triangle] == object.id && whole(mesh.triangles[triangle]))
            .flat_map(|triangle| mesh.triangles[triangle].map(|corner| mesh.positions[corner as usize]))
            .collect();
        object.bounds = Aabb::around(&corners).unwrap();
    }
    scene
}

#[test]
fn export_and_import_preserve_the_canonical_digest() {
    for seed in 0..40 {
        let ordered = canonical(scattered(seed));
        assert_eq!((ordered.materials.len(), ordered.textures.len() < 6), (7, true));
        let back = glb::from_bytes("scattered", "memory", &glb::export(&ordered)).unwrap();
        assert_eq!(digest(&back), digest(&ordered), "{seed}");
        assert_eq!(digest(&canonical(back)), digest(&ordered), "{seed}");
    }
}

#[test]
fn every_triangle_keeps_its_position_look_and_object() {
    let scene = scattered(99);
    let ordered = canonical(scene.clone());
    let told = |scene: &Scene| {
        let known = |id: InstanceId| if scene.object(id).is_some() { id.0 } else { 0 };
        let mut told: Vec<String> = (0..scene.mesh.triangles.len())
            .filter(|&triangle| {
                let [a, b, c] = scene.mesh.triangles[triangle];
                a != b && b != c && c != a
            })
            .map(|triangle| {
                let material = &scene.materials[usize::from(scene.mesh.material_of[triangle])];
                let picture = material.texture.map(|texture| scene.textures[usize::from(texture)].pixels[0]);
                let id = known(scene.mesh.instance_of[triangle]);
                format!("{:?} {} {picture:?} {id}", scene.corners(triangle), material.name)
            })
            .collect();
        told.sort();
        told
    };
    assert_eq!(told(&ordered), told(&scene));
}

#[test]
fn exported_house_loses_its_lamps() {
    let scene = house("lamps", 1, &HouseOptions::small());
    let mut moved = scene.clone();
    let Lighting::Lamps(lamps) = &mut moved.lighting else { panic!("a house has lamps") };
    lamps[0].position.y += 0.01;
    assert_ne!(digest(&moved), digest(&scene));
    let back = glb::from_bytes("lamps", "memory", &glb::export(&scene)).unwrap();
    assert_eq!(back.lighting, Lighting::Painted);
    assert_eq!((scene.lighting.backdrop_rgb(), back.lighting.backdrop_rgb()), ([135, 176, 222], [0; 3]));
}
