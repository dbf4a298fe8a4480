//! Sentences of a bedroom built by hand, with known facts, and in procedural houses, checked by a second implementation of
//! the rules.

use crate::{
    cue::{Claim, Claims, Landmark, Relation},
    describe::{
        check::{self, Reading},
        lexicon,
        relate::{Facts, Relater},
        unsaid,
        writer::{Sentence, Writer},
    },
    survey::{Sightings, SurveyOptions, look::Palette, look_around},
};
use avln_episode::Rules;
use avln_geom::{Aabb, Point2, Point3, Rng};
use avln_houses::HouseOptions;
use avln_scene::{Attributes, InstanceId, Lighting, Material, Mesh, Object, Region, Scene, colors};
use avln_world::{Body, SceneAssets};
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::LazyLock,
};

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

    /// Adds a coloured object; indices follow insertion order.
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
        // Right of the bed for a viewer facing the wall z = 0, in direction -z.
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

/// Claims with the noun for `index` and a location by the noun for `landmark`.
fn place(facts: &Facts, index: usize, relation: Relation, landmark: usize) -> Claims {
    let name = |index: usize| lexicon::names(&facts.scene.objects[index]).swap_remove(0);
    let mark = Landmark { name: name(landmark), color: None, only: true };
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
    // The other chair is 0.9 m from the table: too much even for a generous "next to".
    assert_eq!(rivals_of_the_red("red"), (vec![], vec![2]));
    assert_eq!(rivals_of_the_red("blue"), (vec![], vec![]));
}

struct Written {
    assets: SceneAssets,
    /// Recognised objects by index, with their sentences.
    sentences: Vec<(usize, Vec<Sentence>)>,
}

static HOUSES: LazyLock<Vec<Written>> = LazyLock::new(|| (0..3).map(write).collect());

fn write(seed: u64) -> Written {
    let rules = Rules::paper();
    let body = Body { radius_m: rules.body_radius_m, height_m: rules.body_height_m, ..Body::default() };
    let options = HouseOptions { rooms: 6..=8, ..HouseOptions::default() };
    let scene = avln_houses::house(&format!("house-{seed}"), seed, &options);
    let assets = SceneAssets::prepare(scene, &body).expect("a house can be lived in");
    let options = SurveyOptions { looks: 6, look_px: 64, ..SurveyOptions::default() };
    let Sightings { sightings, palettes, .. } = look_around(&assets, &rules, &options, &(0..=u8::MAX));
    let writer = Writer::new(&assets, &palettes, &options);
    let rng = |index: usize| Rng::new(seed).fork(&index.to_string());
    let sentences = sightings.iter().map(|s| (s.index, writer.sentences(s, rng(s.index)))).collect();
    Written { assets, sentences }
}

fn each_sentence(mut check: impl FnMut(&Scene, usize, &Sentence)) {
    for house in HOUSES.iter() {
        for (index, sentences) in &house.sentences {
            sentences.iter().for_each(|sentence| check(&house.assets.scene, *index, sentence));
        }
    }
}

#[test]
fn most_objects_have_sentences() {
    let all: Vec<usize> =
        HOUSES.iter().flat_map(|house| &house.sentences).map(|(_, sentences)| sentences.len()).collect();
    let told = all.iter().filter(|&&count| count > 0).count();
    assert!(all.len() > 100 && told * 10 >= all.len() * 7, "{told} of {}", all.len());
    assert!(all.iter().filter(|&&count| count == 3).count() * 10 >= told * 8);
}

#[test]
fn sentences_have_valid_form_and_length() {
    each_sentence(|_, _, sentence| {
        let text = &sentence.text;
        let words: Vec<&str> = text.split_whitespace().collect();
        assert!((8..=35).contains(&words.len()), "{text}");
        assert!(text.starts_with(|c: char| c.is_ascii_uppercase()), "{text}");
        assert!(text.ends_with(['.', '?']) && !text.contains(['_', '{', '}', '#']), "{text}");
        assert!(!text.chars().any(|c| c.is_ascii_digit()) && !text.contains("  "), "{text}");
        for pair in words.windows(2) {
            let vowel = pair[1].starts_with(['a', 'e', 'i', 'o', 'u']);
            match pair[0].to_lowercase().as_str() {
                "a" => assert!(!vowel, "{text}"),
                "an" => assert!(vowel, "{text}"),
                word => assert!(word != pair[1], "a word twice: {text}"),
            }
        }
    });
}

#[test]
fn sentences_contain_their_claims() {
    each_sentence(|_, _, sentence| {
        assert_eq!(unsaid(&sentence.text, &sentence.claims), None, "{}", sentence.text);
        let places = sentence.claims.list.iter().filter(|claim| matches!(claim, Claim::Place(..))).count();
        assert!((1..=3).contains(&places), "{}", sentence.text);
    });
}

#[test]
fn more_than_forty_frames_are_in_use() {
    let mut frames = BTreeSet::new();
    each_sentence(|_, _, sentence| {
        frames.insert(sentence.frame);
    });
    assert!(frames.len() >= 40, "{} frames", frames.len());
}

#[test]
fn equal_seeds_write_equal_sentences() {
    assert_eq!(write(0).sentences, HOUSES[0].sentences);
}

#[test]
fn sentences_fit_their_own_object() {
    each_sentence(|scene, index, sentence| {
        let target = &scene.objects[index];
        let own = |claim: &Claim| fits(scene, target, claim, true);
        assert!(sentence.claims.list.iter().all(own), "{}: not {target:?}", sentence.text);
    });
}

#[test]
fn sentences_fit_no_other_object() {
    let (mut all, mut judged) = (0, 0);
    each_sentence(|scene, index, sentence| {
        all += 1;
        if sentence.claims.list.iter().any(depends_on_walls) {
            return;
        }
        judged += 1;
        let target = &scene.objects[index];
        for other in scene.objects.iter().filter(|other| other.id != target.id) {
            let named = other.category == target.category
                && is_called(&sentence.claims.head.noun, &other.attributes.noun);
            let fits = sentence.claims.list.iter().all(|claim| fits(scene, other, claim, false));
            assert!(!(named && fits), "{}: also {other:?}", sentence.text);
        }
    });
    assert!(judged >= 100 && judged * 3 >= all, "{judged} of {all} sentences");
}

/// True for claims about walls, invisible in labels and boxes: objects without a contradiction prove nothing.
fn depends_on_walls(claim: &Claim) -> bool {
    use Relation::{AgainstWall, Corner, LeftOf, Opposite, RightOf};
    matches!(claim, Claim::Place(LeftOf | RightOf | Opposite | Corner | AgainstWall, _))
}

/// True if a claim holds by labels and boxes only. `blank`: whether an object without a known colour may have any.
fn fits(scene: &Scene, object: &Object, claim: &Claim, blank: bool) -> bool {
    let words = &object.attributes;
    match claim {
        Claim::Color(word) => has_color(object, word, blank),
        Claim::Material(word) => words.material == *word,
        Claim::Shape(word) => words.shape == *word,
        Claim::Size(word) => words.size == *word,
        Claim::Room(noun) => object.region.is_some_and(|region| {
            lexicon::room_noun(&scene.regions[usize::from(region)].label).as_ref() == Some(noun)
        }),
        Claim::Place(Relation::Between, marks) => {
            let near = |mark| things(scene, object, mark, blank).filter(|thing| gap_m(object, thing) <= 1.2);
            near(&marks[0]).any(|a| near(&marks[1]).any(|b| a.id != b.id && is_amid(object, a, b)))
        }
        Claim::Place(relation, marks) => marks.iter().all(|mark| {
            things(scene, object, mark, blank).any(|thing| is_so(scene, *relation, object, thing))
        }),
    }
}

/// True if the path between the two objects bends less than 50 degrees at this object.
fn is_amid(object: &Object, a: &Object, b: &Object) -> bool {
    let flat = |from: &Object, to: &Object| (to.bounds.center() - from.bounds.center()).xz();
    flat(a, object).angle(&flat(object, b)) < 50_f32.to_radians()
}

/// True if a word in a sentence may mean an object with this label: `pair of trousers` for `trousers`.
fn is_called(said: &str, label: &str) -> bool {
    said.to_lowercase().ends_with(&label.to_lowercase())
}

fn has_color(object: &Object, word: &str, blank: bool) -> bool {
    object.attributes.color == word || blank && object.attributes.color.is_empty()
}

fn things<'a>(
    scene: &'a Scene,
    object: &'a Object,
    mark: &'a Landmark,
    blank: bool,
) -> impl Iterator<Item = &'a Object> {
    scene.objects.iter().filter(move |thing| {
        let noun = &thing.attributes.noun;
        thing.id != object.id
            && thing.category == mark.name.category
            && is_called(&mark.name.noun, noun)
            && mark.color.as_ref().is_none_or(|color| has_color(thing, color, blank))
    })
}

/// Box evidence only; sides and walls count as true for close objects.
fn is_so(scene: &Scene, relation: Relation, object: &Object, thing: &Object) -> bool {
    let (own, other) = (&object.bounds, &thing.bounds);
    let gap_m = gap_m(object, thing);
    match relation {
        Relation::NextTo => gap_m < 0.6,
        Relation::Near => gap_m < 1.3,
        Relation::On => is_stacked(own, other),
        Relation::Holds => is_stacked(other, own),
        Relation::Under => gap_m <= 0.0 && own.max.y < other.max.y,
        Relation::Above => is_over(own, other),
        Relation::Below => is_over(other, own),
        Relation::LeftOf => gap_m < 1.6 && may_be_right_of(scene, thing, object),
        Relation::RightOf => gap_m < 1.6 && may_be_right_of(scene, object, thing),
        Relation::Opposite => (0.9..6.0).contains(&gap_m) && object.region == thing.region,
        Relation::Between | Relation::Corner | Relation::AgainstWall => true,
    }
}

/// True if an object is right of another for a viewer facing a common wall.
fn may_be_right_of(scene: &Scene, object: &Object, thing: &Object) -> bool {
    const DEEP_M: f32 = 0.25;
    let (own, other) = (&object.bounds, &thing.bounds);
    let offset = own.center() - other.center();
    let backs = |axis: usize, end: usize| [object, thing].iter().all(|o| may_stand_at(scene, o, axis, end));
    let low = |axis: usize| (own.min[axis] - other.min[axis]).abs() < DEEP_M && backs(axis, 0);
    let high = |axis: usize| (own.max[axis] - other.max[axis]).abs() < DEEP_M && backs(axis, 1);
    let (north, south) = (low(2) && offset.x > 0.0, high(2) && offset.x < 0.0);
    let (west, east) = (low(0) && offset.z < 0.0, high(0) && offset.z > 0.0);
    north || south || west || east
}

/// True if an object's back may be at a side of the room's box (0: low end, 1: high end), or, far from both ends, at an
/// inner wall: then it is wider than deep.
fn may_stand_at(scene: &Scene, object: &Object, axis: usize, end: usize) -> bool {
    const CLOSE_M: f32 = 0.3;
    let (own, size) = (&object.bounds, object.bounds.size());
    let room = object.region.map_or(*own, |region| scene.regions[usize::from(region)].bounds);
    let from_sides_m = [own.min[axis] - room.min[axis], room.max[axis] - own.max[axis]];
    from_sides_m[end] < CLOSE_M || from_sides_m[1 - end] >= CLOSE_M && size[2 - axis] > 0.7 * size[axis]
}

fn is_over(upper: &Aabb, lower: &Aabb) -> bool {
    let mut column = lower.grown(0.3);
    column.max.y += 2.0;
    upper.min.y > lower.max.y && column.intersects(&Aabb::new(upper.center(), upper.center()))
}

fn is_stacked(upper: &Aabb, lower: &Aabb) -> bool {
    let mut column = lower.grown(0.1);
    column.max.y += 0.1;
    column.contains(&upper.center()) || column.contains(&upper.min) || upper.intersects(&column)
}

fn gap_m(a: &Object, b: &Object) -> f32 {
    let center = a.bounds.closest_point(&b.bounds.closest_point(&a.bounds.center()));
    b.bounds.distance_m(&center)
}
