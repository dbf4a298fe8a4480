//! ProcTHOR houses: the JSON that AI2-THOR builds houses from, schema 1.0.0 (`rooms`, `walls`, `doors`, `windows`, `objects`).
//!
//! The file contains mesh names, but no meshes. Floors, ceilings, and walls with their openings are built from the
//! outlines; objects are boxes with the size in an asset database (`asset-database.json` next to the house, in `databases/`,
//! or one folder up), or a common size for the category. Negating Z converts Unity's left-handed frame (Y up, Z forward)
//! to the world frame.

mod objects;
mod shell;

use crate::files::{ImportReport, bounded, malformed, plain_words, read_limited, read_regular, scene_name};
use crate::world_frame::check_size;
use avln_geom::{Aabb, Point2, Point3};
use avln_scene::{InstanceId, Lighting, Material, Mesh, Region, Scene, SceneError};
use serde::de::IgnoredAny;
use serde::{Deserialize, Deserializer};
use std::{collections::BTreeMap, path::Path};

const MAX_HOUSE_BYTES: u64 = 64 << 20;

/// Returns whether `path` is a JSON file with rooms and walls.
pub(crate) fn is_procthor(path: &Path) -> bool {
    #[derive(Deserialize)]
    struct HouseKeys {
        #[serde(rename = "rooms")]
        _rooms: IgnoredAny,
        #[serde(rename = "walls")]
        _walls: IgnoredAny,
    }
    let is_json = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
    is_json
        && read_limited(path, MAX_HOUSE_BYTES)
            .is_ok_and(|bytes| serde_json::from_slice::<HouseKeys>(&bytes).is_ok())
}

/// Imports a house, with boxes instead of AI2-THOR's meshes. Unknown sizes and openings without a wall are warnings.
pub(crate) fn import(path: &Path, report: &mut ImportReport) -> Result<Scene, SceneError> {
    let fail = |reason: String| malformed(path, reason);
    let bytes = read_regular(path, MAX_HOUSE_BYTES)?;
    let house: ProcthorHouse = serde_json::from_slice(&bytes)
        .map_err(|error| fail(format!("it is no ProcTHOR house ({error}); export it with schema 1.0.0")))?;
    let sizes = objects::AssetSizes::beside(path)?;
    let mut builder = HouseMesh::default();
    let rooms = shell::build(&house, &mut builder, report).map_err(fail)?;
    let objects = objects::build(&house, &sizes, &rooms, &mut builder, report).map_err(fail)?;
    check_size(&builder.mesh, report).map_err(fail)?;
    let region =
        |room: &shell::ProcthorRoom| Region { label: room.label.clone(), bounds: room.bounds, storey: 0 };
    Ok(Scene {
        name: scene_name(path),
        mesh: builder.mesh,
        materials: builder.materials,
        textures: Vec::new(),
        regions: rooms.iter().map(region).collect(),
        objects,
        lighting: Lighting::Painted,
    })
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct ProcthorHouse {
    #[serde(deserialize_with = "bounded")]
    pub(super) rooms: Vec<RoomEntry>,
    #[serde(deserialize_with = "bounded")]
    pub(super) walls: Vec<Wall>,
    #[serde(deserialize_with = "maybe_bounded")]
    pub(super) doors: Vec<Opening>,
    #[serde(deserialize_with = "maybe_bounded")]
    pub(super) windows: Vec<Opening>,
    #[serde(deserialize_with = "maybe_bounded")]
    pub(super) objects: Vec<ProcthorObject>,
    pub(super) procedural_parameters: Parameters,
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Parameters {
    pub(super) ceiling_material: MaterialName,
}

/// Metres, or degrees; Unity's axes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub(super) struct UnityVector {
    pub(super) x: f32,
    pub(super) y: f32,
    pub(super) z: f32,
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct RoomEntry {
    pub(super) id: String,
    pub(super) room_type: String,
    pub(super) floor_material: MaterialName,
    #[serde(deserialize_with = "bounded")]
    pub(super) floor_polygon: Vec<UnityVector>,
}

/// A material: a name, with or without a colour.
#[derive(Clone, Default)]
pub(super) struct MaterialName {
    pub(super) name: String,
    /// Red, green, blue, sRGB, 0 to 1.
    pub(super) color: Option<[f32; 3]>,
}

impl<'de> Deserialize<'de> for MaterialName {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Written {
            Name(String),
            Entry {
                #[serde(default)]
                name: String,
                #[serde(default)]
                color: Option<Color>,
            },
        }
        #[derive(Deserialize)]
        struct Color {
            r: f32,
            g: f32,
            b: f32,
        }
        Ok(match Written::deserialize(deserializer)? {
            Written::Name(name) => Self { name, color: None },
            Written::Entry { name, color } => Self { name, color: color.map(|Color { r, g, b }| [r, g, b]) },
        })
    }
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Wall {
    pub(super) id: String,
    pub(super) room_id: String,
    pub(super) material: MaterialName,
    /// Four corners: two lower and two upper ones, in either order.
    #[serde(deserialize_with = "bounded")]
    pub(super) polygon: Vec<UnityVector>,
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Opening {
    pub(super) id: String,
    pub(super) wall0: String,
    pub(super) wall1: String,
    /// Two opposite corners on `wall0`: x from the lower edge's first point, y up.
    #[serde(deserialize_with = "bounded")]
    pub(super) hole_polygon: Vec<UnityVector>,
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct ProcthorObject {
    pub(super) id: String,
    pub(super) asset_id: String,
    pub(super) object_type: String,
    pub(super) position: UnityVector,
    /// Unity's Euler angles, degrees.
    pub(super) rotation: Rotation,
    pub(super) bounding_box: Option<UnityVector>,
    #[serde(deserialize_with = "maybe_bounded")]
    pub(super) children: Vec<ProcthorObject>,
}

/// Angles about the three axes, or about the vertical axis only.
#[derive(Clone, Copy, Deserialize)]
#[serde(untagged)]
pub(super) enum Rotation {
    Angles(UnityVector),
    AboutY(f32),
}

impl Default for Rotation {
    fn default() -> Self {
        Self::AboutY(0.0)
    }
}

/// A list, or `null` for none.
fn maybe_bounded<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
) -> Result<Vec<T>, D::Error> {
    struct Listed<T>(Vec<T>);
    impl<'de, T: Deserialize<'de>> Deserialize<'de> for Listed<T> {
        fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
            bounded(deserializer).map(Listed)
        }
    }
    Ok(Option::<Listed<T>>::deserialize(deserializer)?.map_or(Vec::new(), |listed| listed.0))
}

#[derive(Default)]
pub(super) struct HouseMesh {
    pub(super) mesh: Mesh,
    pub(super) materials: Vec<Material>,
    material_of: BTreeMap<(String, [u8; 3]), u16>,
}

impl HouseMesh {
    /// Returns a plain material's number; creates it at the first use.
    pub(super) fn material(&mut self, name: &str, color: [u8; 3]) -> u16 {
        let name = plain_words(name);
        let next = self.materials.len().min(usize::from(u16::MAX)) as u16;
        let number = *self.material_of.entry((name.clone(), color)).or_insert(next);
        if usize::from(number) == self.materials.len() {
            let [r, g, b] = color;
            let material = Material { name, base_color: [r, g, b, 255], texture: None, alpha_cutoff: None };
            self.materials.push(material);
        }
        number
    }

    /// Adds corners and triangles; indices count from the first new corner.
    pub(super) fn add(
        &mut self,
        corners: &[Point3<f32>],
        triangles: &[[u32; 3]],
        material: u16,
        instance: InstanceId,
    ) {
        let first = self.mesh.positions.len() as u32;
        self.mesh.positions.extend(corners);
        let uvs = corners.iter().map(|corner| Point2::new(corner.x + corner.y, corner.z + corner.y));
        self.mesh.uvs.extend(uvs);
        self.mesh.colors.resize(self.mesh.positions.len(), [255; 3]);
        self.mesh.triangles.extend(triangles.iter().map(|triangle| triangle.map(|corner| corner + first)));
        self.mesh.material_of.resize(self.mesh.triangles.len(), material);
        self.mesh.instance_of.resize(self.mesh.triangles.len(), instance);
    }

    pub(super) fn add_quad(&mut self, corners: [Point3<f32>; 4], material: u16) {
        self.add(&corners, &[[0, 1, 2], [0, 2, 3]], material, InstanceId::NONE);
    }
}

pub(super) fn world(point: &UnityVector) -> Point3<f32> {
    Point3::new(point.x, point.y, -point.z)
}

/// Returns the points' box; `None` if a coordinate is not finite.
pub(super) fn finite_box(points: &[Point3<f32>]) -> Option<Aabb> {
    let finite = points.iter().flat_map(|point| point.iter()).all(|coordinate| coordinate.is_finite());
    Aabb::around(points).filter(|_| finite)
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_geom::Rng;
    use serde_json::{Value, json};
    use tempfile::TempDir;

    fn at(x: f32, y: f32, z: f32) -> Value {
        json!({ "x": x, "y": y, "z": z })
    }

    fn wall(id: &str, room: &str, from: [f32; 2], to: [f32; 2]) -> Value {
        let corner = |[x, z]: [f32; 2], y| at(x, y, z);
        json!({ "id": id, "roomId": room, "material": { "name": "PureWhite", "color": { "r": 1.0, "g": 0.5, "b": 0.0 } },
        "polygon": [corner(from, 0.0), corner(to, 0.0), corner(from, 2.5), corner(to, 2.5)] })
    }

    /// Two rooms, 0 to 4 and 4 to 6 in x, both 3 m deep in Unity's z, with a door between them, a door to the outside
    /// and a window.
    fn house() -> Value {
        let rectangle =
            |x0, x1| json!([at(x0, 0.0, 0.0), at(x0, 0.0, 3.0), at(x1, 0.0, 3.0), at(x1, 0.0, 0.0)]);
        json!({
            "metadata": { "schema": "1.0.0" },
            "rooms": [
                { "id": "room|1", "roomType": "LivingRoom", "floorMaterial": { "name": "WoodFloor" }, "floorPolygon": rectangle(0.0, 4.0) },
                { "id": "room|2", "roomType": "Bathroom", "floorMaterial": "KitchenTiles", "floorPolygon": rectangle(4.0, 6.0) },
            ],
            "walls": [
                wall("w1", "room|1", [4.0, 0.0], [4.0, 3.0]),
                wall("w2", "room|2", [4.0, 3.0], [4.0, 0.0]),
                wall("w3", "room|1", [0.0, 0.0], [4.0, 0.0]),
                wall("wall|exterior|3", "room|1", [4.0, 0.0], [0.0, 0.0]),
            ],
            "doors": [
                { "id": "door|1|2", "wall0": "w1", "wall1": "w2", "holePolygon": [at(0.5, 0.0, 0.0), at(1.5, 2.0, 0.0)] },
                { "id": "door|1|0", "wall0": "w3", "wall1": "wall|exterior|3", "holePolygon": [at(1.0, 0.0, 0.0), at(2.0, 2.0, 0.0)] },
                { "id": "door|9|9", "wall0": "nowhere", "holePolygon": [] },
            ],
            "windows": [{ "id": "window|1", "wall0": "w3", "wall1": "wall|exterior|3", "holePolygon": [at(2.5, 1.0, 0.0), at(3.5, 2.0, 0.0)] }],
            "objects": [{
                "id": "Sofa|1|0", "assetId": "Sofa_1", "position": at(2.0, 0.4, 1.5), "rotation": at(0.0, 90.0, 0.0),
                "children": [{ "id": "Pillow|1|1", "assetId": "Pillow_4", "position": at(2.0, 0.9, 1.5), "rotation": 0 }],
            }],
            "proceduralParameters": { "ceilingMaterial": { "name": "CreamDrywall" } },
        })
    }

    fn imported(house: &Value, with_database: bool, report: &mut ImportReport) -> Result<Scene, SceneError> {
        let folder: TempDir = tempfile::tempdir().unwrap();
        if with_database {
            let database = json!({ "Sofa": [{ "assetId": "Sofa_1", "boundingBox": at(2.0, 0.8, 1.0) }] });
            std::fs::write(folder.path().join("asset-database.json"), database.to_string()).unwrap();
        }
        let path = folder.path().join("house_1.json");
        std::fs::write(&path, house.to_string()).unwrap();
        assert!(is_procthor(&path) || house.get("rooms").is_none());
        import(&path, report)
    }

    /// Distance to the first surface on a ray, metres.
    fn hit(scene: &Scene, from: [f32; 3], towards: [f32; 3]) -> Option<f32> {
        let (from, towards) = (Point3::from(from), avln_geom::Vector3::from(towards));
        let distance = |triangle: usize| {
            let [a, b, c] = scene.corners(triangle);
            let normal = (b - a).cross(&(c - a));
            let t = (a - from).dot(&normal) / towards.dot(&normal);
            let point = from + towards * t;
            let inside =
                [(a, b), (b, c), (c, a)].iter().all(|(p, q)| (q - p).cross(&(point - p)).dot(&normal) >= 0.0);
            (t > 0.0 && inside).then_some(t)
        };
        (0..scene.mesh.triangles.len()).filter_map(distance).min_by(f32::total_cmp)
    }

    #[test]
    fn house_has_rooms_openings_and_boxes() {
        let mut report = ImportReport::default();
        let scene = imported(&house(), true, &mut report).unwrap();
        let labels: Vec<&str> = scene.regions.iter().map(|region| region.label.as_str()).collect();
        assert_eq!(labels, ["living room", "bathroom"]);
        assert_eq!(
            scene.regions[0].bounds,
            Aabb::new(Point3::new(0.0, 0.0, -3.0), Point3::new(4.0, 2.5, 0.0))
        );
        let [sofa, pillow] = &scene.objects[..] else { panic!("{:?}", scene.objects) };
        assert_eq!((sofa.category.as_str(), sofa.region), ("sofa", Some(0)));
        // 2 m wide in Unity's x before the quarter turn, in z after it.
        assert!(
            (sofa.bounds.size() - avln_geom::Vector3::new(1.0, 0.8, 2.0)).norm() < 1e-5,
            "{:?}",
            sofa.bounds
        );
        assert!((sofa.bounds.center() - Point3::new(2.0, 0.4, -1.5)).norm() < 1e-5);
        assert_eq!(pillow.category, "cushion");
        let warnings = report.warnings.join("\n");
        assert!(
            warnings.contains("Pillow_4") && warnings.contains("door|9|9") && report.warnings.len() == 2,
            "{warnings}"
        );

        let close =
            |found: Option<f32>, expected: f32| found.is_some_and(|found| (found - expected).abs() < 0.02);
        // From the middle of the bathroom to -x: through the door, 0.5 to 1.5 m from the corner, without a hit; other rays hit the wall.
        assert_eq!(hit(&scene, [5.0, 1.0, -1.0], [-1.0, 0.0, 0.0]), None);
        assert!(close(hit(&scene, [5.0, 2.2, -1.0], [-1.0, 0.0, 0.0]), 1.0), "above the door");
        assert!(close(hit(&scene, [5.0, 1.0, -2.5], [-1.0, 0.0, 0.0]), 1.0), "beside the door");
        // Front door and window are closed, and so are floor and ceiling.
        for (from, towards, expected) in [
            ([1.5, 1.0, -1.0], [0.0, 0.0, 1.0], 1.0),
            ([3.0, 1.5, -1.0], [0.0, 0.0, 1.0], 1.0),
            ([0.5, 1.0, -1.0], [0.0, -1.0, 0.0], 1.0),
            ([0.5, 1.0, -1.0], [0.0, 1.0, 0.0], 1.5),
        ] {
            assert!(close(hit(&scene, from, towards), expected), "{from:?} {towards:?}");
        }
        let orange = scene.materials.iter().any(|material| material.base_color == [255, 128, 0, 255]);
        assert!(orange, "walls keep the colour that the file gives");
    }

    #[test]
    fn floors_face_up_and_ceilings_down() {
        let scene = imported(&house(), true, &mut ImportReport::default()).unwrap();
        let mut levels = [0, 0];
        for triangle in 0..scene.mesh.triangles.len() {
            let [a, b, c] = scene.corners(triangle);
            let up = (b - a).cross(&(c - a)).y;
            if scene.mesh.instance_of[triangle] == InstanceId::NONE && up.abs() > 1.0 {
                let is_floor = a.y == 0.0;
                assert_eq!(up > 0.0, is_floor);
                levels[usize::from(is_floor)] += 1;
            }
        }
        assert_eq!(levels, [4, 4]);
    }

    #[test]
    fn faults_are_named() {
        type Change = fn(&mut Value);
        let cases: [(&str, Change); 7] = [
            ("0 rooms", |house| house["rooms"] = json!([])),
            ("2 corners", |house| {
                house["rooms"][0]["floorPolygon"] = json!([at(0.0, 0.0, 0.0), at(1.0, 0.0, 0.0)])
            }),
            ("crosses itself", |house| {
                house["rooms"][0]["floorPolygon"] = json!([
                    at(0.0, 0.0, 0.0),
                    at(3.0, 0.0, 2.0),
                    at(3.0, 0.0, 0.0),
                    at(0.0, 0.0, 2.0),
                    at(-2.0, 0.0, 1.0)
                ]);
            }),
            ("four finite corners", |house| house["walls"][0]["polygon"] = json!([at(0.0, 0.0, 0.0)])),
            ("no holePolygon", |house| house["doors"][0]["holePolygon"] = json!([])),
            ("no ProcTHOR house", |house| house["rooms"] = json!(3)),
            ("scale it", |house| house["rooms"][0]["floorPolygon"][2] = at(4.0e6, 0.0, 3.0)),
        ];
        for (expected, change) in cases {
            let mut house = house();
            change(&mut house);
            let error = imported(&house, true, &mut ImportReport::default())
                .map(|_| expected)
                .unwrap_err()
                .to_string();
            assert!(error.contains("house_1.json") && error.contains(expected), "{expected}: {error}");
        }
    }

    #[test]
    fn damaged_houses_never_panic() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("house.json");
        let whole = house().to_string().into_bytes();
        let mut rng = Rng::new(11);
        let mut refused = 0;
        for round in 0..1500 {
            let mut bytes = whole.clone();
            for _ in 0..=rng.below(4) {
                let at = rng.below(bytes.len());
                bytes[at] = if rng.chance(0.7) {
                    b"0123456789-\"{}[],:e"[rng.below(19)]
                } else {
                    bytes[at] ^ 1 << rng.below(8)
                };
            }
            if round % 5 == 0 {
                bytes.truncate(rng.below(whole.len()));
            }
            std::fs::write(&path, bytes).unwrap();
            refused += u32::from(import(&path, &mut ImportReport::default()).is_err());
        }
        assert!(refused > 400, "{refused}");
    }
}
