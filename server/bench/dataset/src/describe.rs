use avln_scene::{Object, Scene};

/// How near a landmark must be to be called near, metres between boxes.
const NEAR_M: f32 = 1.0;

/// One thing that can be said of an object, and whether it holds for another.
enum Trait<'a> {
    Color(&'a str),
    Material(&'a str),
    Size(&'a str),
    Shape(&'a str),
    Room(&'a str),
    Near(&'a str),
}

/// A sentence that fits `object` and no other object of its category in the scene; `None` when words do not suffice.
///
/// The fewest traits that tell it apart are used, looks before place.
pub(crate) fn describe(scene: &Scene, object: &Object) -> Option<String> {
    let traits = traits_of(scene, object);
    let rivals: Vec<_> = scene
        .objects
        .iter()
        .filter(|other| other.category == object.category && other.id != object.id)
        .collect();
    let unique = |chosen: &[&Trait]| !rivals.iter().any(|rival| chosen.iter().all(|t| t.holds(scene, rival)));
    let chosen =
        (1..=traits.len().min(4)).flat_map(|size| subsets(&traits, size)).find(|chosen| unique(chosen))?;
    Some(sentence(&object.category, &chosen))
}

/// The word for a category in a sentence.
fn noun(category: &str) -> String {
    match category {
        "tv_monitor" => "television".to_owned(),
        "gym_equipment" => "piece of gym equipment".to_owned(),
        "seating" => "seat".to_owned(),
        "clothes" => "pile of clothes".to_owned(),
        other => other.replace('_', " "),
    }
}

fn traits_of<'a>(scene: &'a Scene, object: &'a Object) -> Vec<Trait<'a>> {
    let words = &object.attributes;
    let mut traits = vec![
        Trait::Color(&words.color),
        Trait::Material(&words.material),
        Trait::Size(&words.size),
        Trait::Shape(&words.shape),
        Trait::Room(room_of(scene, object)),
    ];
    traits.extend(landmarks(scene, object).into_iter().map(Trait::Near));
    traits.retain(|t| !t.word().is_empty());
    traits
}

fn room_of<'a>(scene: &'a Scene, object: &Object) -> &'a str {
    object.region.and_then(|region| scene.regions.get(region as usize)).map_or("", |region| &region.label)
}

/// Categories near the object that are worth a mention, in order of their names.
fn landmarks<'a>(scene: &'a Scene, object: &Object) -> Vec<&'a str> {
    let reach = object.bounds.grown(NEAR_M);
    let mut near: Vec<&str> = scene
        .objects
        .iter()
        .filter(|other| other.category != object.category && other.region == object.region)
        .filter(|other| other.bounds.intersects(&reach))
        .map(|other| other.category.as_str())
        .collect();
    near.sort_unstable();
    near.dedup();
    near
}

impl Trait<'_> {
    fn word(&self) -> &str {
        match self {
            Self::Color(w)
            | Self::Material(w)
            | Self::Size(w)
            | Self::Shape(w)
            | Self::Room(w)
            | Self::Near(w) => w,
        }
    }

    fn holds(&self, scene: &Scene, other: &Object) -> bool {
        let words = &other.attributes;
        match self {
            Self::Color(word) => words.color == *word,
            Self::Material(word) => words.material == *word,
            Self::Size(word) => words.size == *word,
            Self::Shape(word) => words.shape == *word,
            Self::Room(word) => room_of(scene, other) == *word,
            Self::Near(word) => landmarks(scene, other).contains(word),
        }
    }
}

/// All subsets of `size` traits, those of earlier traits first.
fn subsets<'t, 'a>(traits: &'t [Trait<'a>], size: usize) -> Vec<Vec<&'t Trait<'a>>> {
    let Some((first, rest)) = traits.split_first() else {
        return if size == 0 { vec![Vec::new()] } else { Vec::new() };
    };
    if size == 0 {
        return vec![Vec::new()];
    }
    let mut with_first = subsets(rest, size - 1);
    with_first.iter_mut().for_each(|subset| subset.insert(0, first));
    with_first.extend(subsets(rest, size));
    with_first
}

/// Adjectives before the noun (size, shape, colour, material), places after it.
fn sentence(category: &str, chosen: &[&Trait]) -> String {
    let rank = |t: &Trait| match t {
        Trait::Size(_) => 0,
        Trait::Shape(_) => 1,
        Trait::Color(_) => 2,
        Trait::Material(_) => 3,
        Trait::Near(_) => 4,
        Trait::Room(_) => 5,
    };
    let mut ordered = chosen.to_vec();
    ordered.sort_by_key(|t| rank(t));
    let (before, after): (Vec<_>, Vec<_>) = ordered.into_iter().partition(|t| rank(t) < 4);
    let mut words: Vec<String> = vec!["the".to_owned()];
    words.extend(before.iter().map(|t| t.word().to_owned()));
    words.push(noun(category));
    words.extend(after.iter().map(|t| match t {
        Trait::Room(room) => format!("in the {}", room.replace('_', " ")),
        other => format!("near a {}", noun(other.word())),
    }));
    words.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_geom::{Aabb, Point3};
    use avln_scene::{Attributes, InstanceId, Mesh, Region};

    fn object(id: u32, category: &str, color: &str, region: u16, x: f32) -> Object {
        let corner = Point3::new(x, 0.0, 0.0);
        Object {
            id: InstanceId(id),
            category: category.to_owned(),
            bounds: Aabb::new(corner, Point3::new(x + 0.5, 0.5, 0.5)),
            region: Some(region),
            attributes: Attributes { color: color.to_owned(), ..Attributes::default() },
        }
    }

    fn scene(objects: Vec<Object>) -> Scene {
        let bounds = Aabb::new(Point3::origin(), Point3::new(9.0, 3.0, 9.0));
        let region = |label: &str| Region { label: label.to_owned(), bounds, storey: 0 };
        Scene {
            name: "flat".to_owned(),
            mesh: Mesh::default(),
            materials: vec![],
            textures: vec![],
            regions: vec![region("kitchen"), region("living_room")],
            objects,
        }
    }

    fn sentences(objects: Vec<Object>) -> Vec<Option<String>> {
        let scene = scene(objects);
        scene.objects.iter().map(|object| describe(&scene, object)).collect()
    }

    #[test]
    fn the_fewest_traits_that_tell_apart_are_used() {
        let said = sentences(vec![
            object(1, "chair", "red", 0, 0.0),
            object(2, "chair", "blue", 0, 4.0),
            object(3, "chair", "blue", 1, 8.0),
        ]);
        assert_eq!(said[0].as_deref(), Some("the red chair"));
        assert_eq!(said[1].as_deref(), Some("the blue chair in the kitchen"));
        assert_eq!(said[2].as_deref(), Some("the chair in the living room"));
    }

    #[test]
    fn landmarks_help_where_looks_do_not() {
        let said = sentences(vec![
            object(1, "chair", "red", 0, 0.0),
            object(2, "chair", "red", 0, 4.0),
            object(3, "table", "brown", 0, 1.0),
        ]);
        assert_eq!(said[0].as_deref(), Some("the chair near a table"));
        assert_eq!(said[1], None, "twins cannot be told apart by words");
    }
}
