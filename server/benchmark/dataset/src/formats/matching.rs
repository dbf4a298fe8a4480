use super::ForeignInstance;
use avln_geom::Aabb;
use avln_scene::{Object, Scene, categories::mpcat40};

/// Shared volume over joint volume from which on two boxes are of one object: of one kind, and of any.
const SAME_KIND: f32 = 0.25;
const ANY_KIND: f32 = 0.6;
/// How far outside of an object's box its stated middle may lie, metres.
const NEAR_M: f32 = 0.3;

/// The object of the scene that an instance of another data set is: by its box, else by its number, else by its place.
///
/// # Errors
/// Why none is.
pub(super) fn find<'a>(scene: &'a Scene, wanted: &ForeignInstance) -> Result<&'a Object, String> {
    if let Some(bounds) = &wanted.bounds {
        return by_box(scene, wanted, bounds);
    }
    let near =
        |object: &Object| wanted.center.is_none_or(|center| object.bounds.distance_m(&center) <= NEAR_M);
    let numbered = scene.objects.iter().find(|object| Some(object.id.0) == wanted.id);
    if let Some(object) = numbered.filter(|object| is_kind(object, wanted) && near(object)) {
        return Ok(object);
    }
    let Some(center) = wanted.center else {
        return Err(
            "the scene has no such object, and the file gives neither its box nor its place".to_owned()
        );
    };
    let kind = scene.objects.iter().filter(|object| is_kind(object, wanted) && near(object));
    let off = |object: &&Object| (object.bounds.center() - center).norm();
    let none = || format!("the scene has no {} at its place", wanted.category);
    kind.min_by(|a, b| off(a).total_cmp(&off(b))).ok_or_else(none)
}

fn by_box<'a>(scene: &'a Scene, wanted: &ForeignInstance, bounds: &Aabb) -> Result<&'a Object, String> {
    let shared = |object: &Object| overlap(&object.bounds, bounds);
    let fits =
        |object: &&Object| shared(object) >= if is_kind(object, wanted) { SAME_KIND } else { ANY_KIND };
    let best = scene.objects.iter().filter(fits).max_by(|a, b| shared(a).total_cmp(&shared(b)));
    best.ok_or_else(|| format!("the scene has no {} in its box", wanted.category))
}

/// Whether both are of one category, as far as their words tell.
fn is_kind(object: &Object, wanted: &ForeignInstance) -> bool {
    let plain = |name: &str| name.to_lowercase().replace('_', " ");
    let category = |name: &str| mpcat40(name).map_or_else(|| plain(name), plain);
    category(&object.category) == category(&wanted.category)
        || (!object.attributes.noun.is_empty() && plain(&object.attributes.noun) == plain(&wanted.category))
}

/// Shared volume of two boxes over their joint volume; thin ones count as 1 cm thick.
fn overlap(a: &Aabb, b: &Aabb) -> f32 {
    const THIN_M: f32 = 0.005;
    let (a, b) = (a.grown(THIN_M), b.grown(THIN_M));
    let volume = |size: [f32; 3]| size.into_iter().map(|side| side.max(0.0)).product::<f32>();
    let shared = [0, 1, 2].map(|axis| a.max[axis].min(b.max[axis]) - a.min[axis].max(b.min[axis]));
    let shared = volume(shared);
    let joint = volume(a.size().into()) + volume(b.size().into()) - shared;
    if joint > 0.0 { shared / joint } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_geom::Point3;
    use avln_scene::{Attributes, InstanceId, Lighting, Mesh};

    fn object(id: u32, category: &str, x: f32) -> Object {
        Object {
            id: InstanceId(id),
            category: category.to_owned(),
            bounds: Aabb::new(Point3::new(x, 0.0, 0.0), Point3::new(x + 1.0, 1.0, 1.0)),
            region: None,
            attributes: Attributes::default(),
        }
    }

    fn scene() -> Scene {
        Scene {
            name: "flat".to_owned(),
            mesh: Mesh::default(),
            materials: vec![],
            textures: vec![],
            regions: vec![],
            objects: vec![object(1, "chair", 0.0), object(2, "table", 3.0), object(3, "chair", 6.0)],
            lighting: Lighting::Painted,
        }
    }

    fn wanted(category: &str) -> ForeignInstance {
        ForeignInstance { category: category.to_owned(), ..ForeignInstance::default() }
    }

    #[test]
    fn boxes_share_volume() {
        let cube = |x: f32| Aabb::new(Point3::new(x, 0.0, 0.0), Point3::new(x + 1.0, 1.0, 1.0));
        assert!((overlap(&cube(0.0), &cube(0.0)) - 1.0).abs() < 1e-5);
        // Half of each is shared: 0.5 of 1.5.
        assert!((overlap(&cube(0.0), &cube(0.5)) - 1.0 / 3.0).abs() < 0.01);
        assert_eq!(overlap(&cube(0.0), &cube(2.0)), 0.0);
    }

    #[test]
    fn a_box_finds_its_object_whatever_its_number() {
        let scene = scene();
        let bounds = Some(Aabb::new(Point3::new(6.1, 0.0, 0.0), Point3::new(7.1, 1.0, 1.0)));
        let found = find(&scene, &ForeignInstance { id: Some(1), bounds, ..wanted("armchair") });
        assert_eq!(found.unwrap().id, InstanceId(3));
        let bounds = Some(Aabb::new(Point3::new(9.0, 0.0, 0.0), Point3::new(10.0, 1.0, 1.0)));
        assert!(find(&scene, &ForeignInstance { bounds, ..wanted("chair") }).unwrap_err().contains("chair"));
    }

    #[test]
    fn without_a_box_number_and_place_count() {
        let scene = scene();
        let id = |id, category| find(&scene, &ForeignInstance { id: Some(id), ..wanted(category) });
        assert_eq!(id(2, "table").unwrap().id, InstanceId(2));
        assert!(id(2, "sofa").is_err() && id(9, "table").unwrap_err().contains("neither"));
        let at = |x: f32| {
            let center = Some(Point3::new(x, 0.5, 0.5));
            find(&scene, &ForeignInstance { id: Some(1), center, ..wanted("chair") })
        };
        // Number 1 lies elsewhere: the place decides.
        assert_eq!(at(6.6).unwrap().id, InstanceId(3));
        assert!(at(4.9).unwrap_err().contains("no chair at its place"));
    }
}
