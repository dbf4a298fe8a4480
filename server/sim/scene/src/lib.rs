//! The scene model: mesh, materials, regions, objects and lamps of a building.
//!
//! Start at [`Scene`].
//!
//! This crate never reads or writes files or depends on missions.

pub mod categories;
pub mod colors;
pub mod describe;
pub mod digest;
pub mod polygon;
mod room_plan;
pub mod stats;

use avln_geom::{Aabb, Point2, Point3, Vector3};
pub use room_plan::{RoomPlan, RoomPlanError};
pub use stats::Summary;

/// Size limits of scene files and scenes; importers check them before they reserve memory.
pub mod limits {
    // A fuzzer soon finds small files of the greatest scenes, which take minutes and gigabytes.
    const IS_FUZZED: bool = cfg!(fuzzing);

    /// Bytes in a scene file, or in all external files together.
    pub const MAX_FILE_BYTES: u64 = 2 << 30;
    /// Bytes in the JSON part.
    pub const MAX_JSON_BYTES: usize = 64 << 20;
    /// Entries in a JSON list (nodes, accessors, materials …).
    pub const MAX_ENTRIES: usize = 1 << 18;
    /// Triangles in a scene.
    pub const MAX_TRIANGLES: usize = if IS_FUZZED { 10_000 } else { 8_000_000 };
    /// Vertices in a scene; a shared vertex counts once per primitive.
    pub const MAX_VERTICES: usize = 3 * MAX_TRIANGLES;
    /// Texels on a texture's side.
    pub const MAX_TEXTURE_SIDE: u32 = if IS_FUZZED { 512 } else { 16_384 };
    /// Texels in all textures together.
    pub const MAX_TEXELS: u64 = if IS_FUZZED { 1 << 20 } else { 1 << 29 };
    /// Least building length in the longest direction, metres.
    pub const MIN_SCENE_SIDE_M: f32 = 1.0;
    /// Greatest building length in the longest direction, metres.
    pub const MAX_SCENE_SIDE_M: f32 = 300.0;
    /// Characters in a category or attribute.
    pub const MAX_WORD_CHARS: usize = 100;
}

/// A building, in the `avln-geom` world frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Short name, unique inside a data set: letters, digits, `-` and `_`.
    pub name: String,
    /// All surfaces.
    pub mesh: Mesh,
    /// Materials, indexed by [`Mesh::material_of`].
    pub materials: Vec<Material>,
    /// Material images.
    pub textures: Vec<Texture>,
    /// Rooms.
    pub regions: Vec<Region>,
    /// Labelled instances, sorted by id.
    pub objects: Vec<Object>,
    /// Light source.
    pub lighting: Lighting,
}

/// An indexed triangle mesh. Per-vertex lists are as long as `positions`, per-triangle lists as long as `triangles`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertices, metres.
    pub positions: Vec<Point3<f32>>,
    /// Texture coordinates per vertex, v down from the top row.
    pub uvs: Vec<Point2<f32>>,
    /// Colour per vertex, RGB 0 to 255, multiplied into the material's colour (baked light).
    pub colors: Vec<[u8; 3]>,
    /// Three indices into `positions` per triangle, counter-clockwise from outside if the source defines it.
    pub triangles: Vec<[u32; 3]>,
    /// Material index per triangle.
    pub material_of: Vec<u16>,
    /// Instance per triangle; [`InstanceId::NONE`] for unlabelled surfaces.
    pub instance_of: Vec<InstanceId>,
}

/// Instance number, unique within a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct InstanceId(pub u32);

impl InstanceId {
    /// Largest number: 2^24 - 1, because ids must fit into a 32-bit float's mantissa.
    pub const MAX: u32 = (1 << 24) - 1;
    /// No instance.
    pub const NONE: Self = Self(0);
}

/// A surface material.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// A material name for the acoustics (`wood`, `fabric`, `plaster` …) or the name in the file.
    pub name: String,
    /// Base colour, RGBA 0 to 255, sRGB; multiplied with the texture.
    pub base_color: [u8; 4],
    /// Index into [`Scene::textures`].
    pub texture: Option<u16>,
    /// Texels with a smaller alpha are invisible, 0 to 255; `None` for opaque surfaces.
    pub alpha_cutoff: Option<u8>,
}

/// A picture: `height × width × 4` bytes, row-major from the top-left, RGBA, sRGB. It repeats in both directions.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Texture {
    /// Texels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// RGBA bytes.
    pub pixels: Vec<u8>,
}

/// A room.
#[derive(Clone, Debug, PartialEq)]
pub struct Region {
    /// Purpose: `kitchen`, `bedroom` …; empty if unknown.
    pub label: String,
    /// Bounding box.
    pub bounds: Aabb,
    /// Storey; 0 is the lowest.
    pub storey: u16,
}

/// A labelled instance.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Number, never [`InstanceId::NONE`].
    pub id: InstanceId,
    /// Category: the mpcat40 name if it exists (`chair`, `tv_monitor`, `chest_of_drawers` …).
    pub category: String,
    /// Bounding box.
    pub bounds: Aabb,
    /// Room index in [`Scene::regions`].
    pub region: Option<u16>,
    /// Descriptive words.
    pub attributes: Attributes,
}

/// Descriptive words for an instance; empty if unknown.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Attributes {
    /// Everyday noun, if more specific than the category: `armchair`, `nightstand`, `refrigerator` …
    pub noun: String,
    /// Colour word: `red`, `orange`, `yellow`, `green`, `teal`, `blue`, `purple`, `pink`, `brown`, `black`, `grey`, `white`.
    pub color: String,
    /// Material word: `wooden`, `metal`, `fabric`, `leather`, `glass`, `plastic`, `ceramic` …
    pub material: String,
    /// Size word: `small`, `large`, `tall`, `long` …
    pub size: String,
    /// Shape word: `round`, `square` …
    pub shape: String,
}

/// A scene that cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// The file cannot be read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// The file.
        path: String,
        /// Operating system error.
        source: std::io::Error,
    },
    /// The file's content is not usable.
    #[error("{path} is not a usable scene: {reason}")]
    Malformed {
        /// The file.
        path: String,
        /// The defect, and a next step.
        reason: String,
    },
}

impl Scene {
    /// Returns the object with the number `id`.
    pub fn object(&self, id: InstanceId) -> Option<&Object> {
        let found = self.objects.binary_search_by_key(&id, |object| object.id).ok()?;
        Some(&self.objects[found])
    }

    /// Returns the bounding box; `None` for an empty scene.
    pub fn bounds(&self) -> Option<Aabb> {
        Aabb::around(&self.mesh.positions)
    }

    /// Returns the corners for a triangle index.
    ///
    /// # Panics
    /// If `index` is out of range.
    pub fn corners(&self, index: usize) -> [Point3<f32>; 3] {
        self.mesh.triangles[index].map(|corner| self.mesh.positions[corner as usize])
    }
}

/// Light source in a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Lighting {
    /// Light baked into textures and vertex colours, as in scans.
    #[default]
    Painted,
    /// Lamps. All triangles are counter-clockwise from their visible side. Vertex colours are an approximate
    /// light for viewers without ray tracing; a renderer with ray tracing ignores them.
    Lamps(Vec<Lamp>),
}

/// A light source: a bulb, or a window pane in daylight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    /// Centre, world frame.
    pub position: Point3<f32>,
    /// Unit normal for a flat source, world frame; `None` for a bulb that shines in all directions.
    pub facing: Option<Vector3<f32>>,
    /// Radius, metres. Surfaces inside it belong to the lamp and cast no shadow.
    pub radius_m: f32,
    /// Red, green and blue light on a surface that faces the lamp from 1 m; 1 equals the indirect light in the middle of a
    /// room.
    pub strength: [f32; 3],
}

impl Lighting {
    /// Returns the background colour, sRGB: sky around houses with lamps, black around scans.
    pub fn backdrop_rgb(&self) -> [u8; 3] {
        match self {
            Self::Painted => [0; 3],
            Self::Lamps(_) => [135, 176, 222],
        }
    }

    /// Returns the lamps; none for baked light.
    pub fn lamps(&self) -> &[Lamp] {
        match self {
            Self::Painted => &[],
            Self::Lamps(lamps) => lamps,
        }
    }
}
