//! Sentences of a bedroom built by hand, with known facts; `houses` has procedural houses.

mod houses;

use crate::{
    describe::{
        Claim, Claims, Facts, Relation,
        check::{self, Reading},
        lexicon,
        relate::Relater,
    },
    survey::Palette,
};
use avln_geom::{Aabb, Point2, Point3};
use avln_scene::{Attributes, InstanceId, Lighting, Material, Mesh, Object, Region, Scene, colors};
use avln_world::{Body, SceneAssets};
use std::collections::BTreeMap;

/// A 6 × 5 m room with walls 0.1 m thick; objects are boxes. The wall behind the bed is at z = 0.
struct Flat {
    scene: Scene,
}

impl Flat {
    fn new() -> Self {
        let bounds = Aabb::new(Point3::new(0.0, 0.0, 0.0), Point3::new(6.0, 2.6, 5.0));
        let material =
            Material { name: "plaster".into(), base_color: [255; 4], texture: None, alpha_cutoff: None };
        let scene = Scene {
            name: "flat".into(),
            mesh: Mesh::default(),
            materials: vec![material],
            textures: Vec::new(),
            regions: vec![Region { label: "bedroom".into(), bounds, storey: 0 }],
            objects: Vec::new(),
            lighting: Lighting::Painted,
        };
        let mut flat = Self { scene };
        for (min, max) in [
            ([-0.1, -0.1, -0.1], [6.1, 0.0, 5.1]),
            ([-0.1, 0.0, -0.1], [6.1, 2.6, 0.0]),
            ([-0.1, 0.0, 5.0], [6.1, 2.6, 5.1]),
            ([-0.1, 0.0, -0.1], [0.0, 2.6, 5.1]),
            ([6.0, 0.0, -0.1], [6.1, 2.6, 5.1]),
        ] {
            flat.block(min, max, InstanceId::NONE);
        }
        flat
    }

    fn block(&mut self, min: [f32; 3], max: [f32; 3], id: InstanceId) {
        let mesh = &mut self.scene.mesh;
        let first = mesh.positions.len() as u32;
        let corner = |i: usize| [0, 1, 2].map(|axis| if i >> axis & 1 == 0 { min[axis] } else { max[axis] });
        mesh.positions.extend((0..8).map(|i| Point3::from(corner(i))));
        mesh.uvs.extend([Point2::origin(); 8]);
        mesh.colors.extend([[255; 3]; 8]);
        for [a, b, c, d] in
            [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
        {
            mesh.triangles.extend([[a, b, c], [a, c, d]].map(|triangle| triangle.map(|i: u32| first + i)));
            mesh.material_of.extend([0; 2]);
            mesh.instance_of.extend([id; 2]);
        }
    }

    /// Adds a coloured object; its index is the insertion order.
    fn with(mut self, category: &str, color: &str, min: [f32; 3], max: [f32; 3]) -> Self {
        let id = InstanceId(self.scene.objects.len() as u32 + 1);
        self.block(min, max, id);
        self.scene.objects.push(Object {
            id,
            category: category.to_owned(),
            bounds: Aabb::new(min.into(), max.into()),
            region: Some(0),
            attributes: Attributes { color: color.to_owned(), ..Attributes::default() },
        });
        self
    }

    fn open(self) -> (SceneAssets, BTreeMap<InstanceId, Palette>) {
        let palette = |object: &Object| {
            let known = colors::PALETTE.iter().find(|(word, _)| *word == object.attributes.color);
            let mut palette = Palette::default();
            (0..100).for_each(|_| palette.add(known.map_or([255; 3], |(_, rgb)| *rgb)));
            (object.id, palette)
        };
        let palettes = self.scene.objects.iter().map(palette).collect();
        (SceneAssets::prepare(self.scene, &Body::default()).expect("one can stand in it"), palettes)
    }
}

const BED: usize = 0;
const NIGHTSTAND: usize = 1;
const LAMP: usize = 2;
const PICTURE: usize = 3;
const STOOL: usize = 4;
const DESK: usize = 5;
const CUSHION: usize = 6;
const CHAIR: usize = 7;

fn bedroom() -> (SceneAssets, BTreeMap<InstanceId, Palette>) {
    let flat = Flat::new()
        .with("bed", "blue", [2.0, 0.0, 0.02], [3.6, 0.9, 2.0])
        // Right of the bed for a viewer facing the wall z = 0, along -z.
        .with("chest_of_drawers", "brown", [3.7, 0.0, 0.02], [4.2, 0.5, 0.45])
        .with("lamp", "red", [3.85, 0.5, 0.1], [4.05, 0.9, 0.3])
        .with("picture", "green", [2.4, 1.3, 0.01], [3.2, 1.9, 0.04])
        // Tucked under the desk across the room.
        .with("stool", "black", [2.6, 0.0, 4.3], [3.0, 0.45, 4.7])
        .with("desk", "white", [2.2, 0.0, 4.2], [3.4, 0.75, 4.98])
        .with("cushion", "yellow", [2.6, 0.5, 0.3], [3.0, 0.7, 0.6])
        .with("chair", "orange", [0.05, 0.0, 4.3], [0.55, 0.9, 4.95]);
    flat.open()
}

/// Relations between object `index` and plain landmarks: `Above bed`.
fn said_of(index: usize) -> Vec<String> {
    let (assets, palettes) = bedroom();
    let relater = Relater::new(Facts::new(&assets, &palettes));
    let seen: Vec<usize> = (0..assets.scene.objects.len()).filter(|&other| other != index).collect();
    let text = |claim: Claim| match claim {
        Claim::Place(relation, landmarks) if landmarks.iter().all(|mark| mark.color.is_none()) => {
            let nouns: Vec<_> = landmarks.iter().map(|mark| mark.name.noun.as_str()).collect();
            Some(format!("{relation:?} {}", nouns.join(", ")).trim_end().to_owned())
        }
        _ => None,
    };
    relater.places(index, &seen).into_iter().filter_map(text).collect()
}

#[test]
fn relations_follow_the_view_of_a_visitor() {
    let expected: [(usize, &[&str]); 8] = [
        (
            BED,
            &[
                "LeftOf chest of drawers",
                "LeftOf lamp",
                "Below picture",
                "Opposite desk",
                "Holds cushion",
                "AgainstWall",
            ],
        ),
        (NIGHTSTAND, &["RightOf bed", "Holds lamp", "Near picture", "Near cushion", "AgainstWall"]),
        (LAMP, &["RightOf bed", "On chest of drawers", "Near picture", "Near cushion"]),
        (PICTURE, &["Above bed", "Near chest of drawers", "Near lamp", "Opposite desk", "Near cushion"]),
        (STOOL, &["Under desk"]),
        (DESK, &["Opposite bed", "Opposite picture", "AgainstWall"]),
        (CUSHION, &["On bed", "Near chest of drawers", "Near lamp", "Near picture"]),
        (CHAIR, &["Corner"]),
    ];
    let differing: Vec<_> = expected
        .iter()
        .map(|(index, places)| (index, said_of(*index), places))
        .filter(|(_, said, places)| said != *places)
        .collect();
    assert!(differing.is_empty(), "{differing:#?}");
}

#[test]
fn checker_accepts_all_written_claims() {
    let (assets, palettes) = bedroom();
    let relater = Relater::new(Facts::new(&assets, &palettes));
    let everything: Vec<usize> = (0..assets.scene.objects.len()).collect();
    for index in 0..assets.scene.objects.len() {
        for claim in relater.places(index, &everything) {
            for reading in [Reading::Plain, Reading::Generous] {
                assert!(check::holds(&relater.facts, &claim, index, index, reading), "{index} {claim:?}");
            }
        }
    }
}

/// Claims with the noun for `index` and one location by the noun for `landmark`.
fn place(facts: &Facts, index: usize, relation: Relation, landmark: usize) -> Claims {
    let name = |index: usize| lexicon::names(&facts.scene.objects[index]).swap_remove(0);
    let mark = crate::describe::Landmark { name: name(landmark), color: None, only: true };
    Claims { head: name(index), list: vec![Claim::Place(relation, vec![mark])] }
}

#[test]
fn checker_rejects_false_claims() {
    let (assets, palettes) = bedroom();
    let facts = Facts::new(&assets, &palettes);
    for (index, relation, landmark) in [
        (BED, Relation::RightOf, NIGHTSTAND),
        (NIGHTSTAND, Relation::LeftOf, BED),
        (PICTURE, Relation::Below, BED),
        (BED, Relation::Above, PICTURE),
        (CHAIR, Relation::NextTo, BED),
        (CHAIR, Relation::Near, DESK),
        (CUSHION, Relation::Under, BED),
        (LAMP, Relation::On, BED),
        (STOOL, Relation::Opposite, DESK),
    ] {
        let claims = place(&facts, index, relation, landmark);
        assert!(!check::fits_only(&facts, &claims, index), "{claims:?}");
    }
    assert!(check::fits_only(&facts, &place(&facts, LAMP, Relation::On, NIGHTSTAND), LAMP));
}

#[test]
fn same_coloured_twin_is_a_rival() {
    let twins = |color: &str| {
        let flat = Flat::new()
            .with("table", "brown", [2.0, 0.0, 2.0], [3.0, 0.7, 3.0])
            .with("chair", "red", [1.3, 0.0, 2.2], [1.8, 0.9, 2.7])
            .with("chair", color, [3.9, 0.0, 2.2], [4.4, 0.9, 2.7]);
        flat.open()
    };
    let rivals_of_the_red = |color: &str| {
        let (assets, palettes) = twins(color);
        let facts = Facts::new(&assets, &palettes);
        let mut claims = place(&facts, 1, Relation::NextTo, 0);
        let by_place = check::rivals(&facts, &claims, 1);
        claims.list = vec![Claim::Color("red".into())];
        (by_place, check::rivals(&facts, &claims, 1))
    };
    // The other chair is 0.9 m from the table: too far even for a generous "next to".
    assert_eq!(rivals_of_the_red("red"), (vec![], vec![2]));
    assert_eq!(rivals_of_the_red("blue"), (vec![], vec![]));
}
