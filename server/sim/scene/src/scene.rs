use crate::Lighting;
use avln_geom::{Aabb, Point2, Point3};

/// A building, in the world frame of `avln-geom`.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Short name, unique inside a data set: letters, digits, `-` and `_`.
    pub name: String,
    /// All surfaces.
    pub mesh: Mesh,
    /// What surfaces are made of; [`Mesh::material_of`] points here.
    pub materials: Vec<Material>,
    /// Pictures that materials use.
    pub textures: Vec<Texture>,
    /// Rooms.
    pub regions: Vec<Region>,
    /// Labelled instances, in the order of their ids.
    pub objects: Vec<Object>,
    /// Where the light on the surfaces comes from.
    pub lighting: Lighting,
}

/// An indexed triangle mesh. The three per-triangle lists are as long as `triangles`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Corners, metres.
    pub positions: Vec<Point3<f32>>,
    /// Texture coordinates of each corner, v down from the top row; as long as `positions`.
    pub uvs: Vec<Point2<f32>>,
    /// Colour of each corner, multiplied into the material's, RGB 0 to 255 (baked light); as long as `positions`.
    pub colors: Vec<[u8; 3]>,
    /// Three indices into `positions` each, counter-clockwise from outside where the source knows it.
    pub triangles: Vec<[u32; 3]>,
    /// Index of each triangle's material.
    pub material_of: Vec<u16>,
    /// Instance of each triangle; [`InstanceId::NONE`] for what belongs to no object.
    pub instance_of: Vec<InstanceId>,
}

/// Number of a labelled instance inside its scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct InstanceId(pub u32);

impl InstanceId {
    /// The largest number that a scene may use: 2^24 - 1, so that ids fit the mantissa of a 32-bit float.
    pub const MAX: u32 = (1 << 24) - 1;
    /// No instance at all.
    pub const NONE: Self = Self(0);
}

/// What a surface is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// A name that acoustics understands (`wood`, `fabric`, `plaster` …) or the importer's own.
    pub name: String,
    /// Base colour, RGBA 0 to 255, sRGB; multiplies the texture.
    pub base_color: [u8; 4],
    /// Index into [`Scene::textures`].
    pub texture: Option<u16>,
    /// Texels with less alpha than this are not there, 0 to 255; `None` for opaque surfaces.
    pub alpha_cutoff: Option<u8>,
}

/// A picture: `height × width × 4` bytes, row-major from the top-left, RGBA, sRGB; repeats in both directions.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Texture {
    /// Texels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The bytes.
    pub pixels: Vec<u8>,
}

/// A room.
#[derive(Clone, Debug, PartialEq)]
pub struct Region {
    /// What it is used for: `kitchen`, `bedroom` …; empty when unknown.
    pub label: String,
    /// Box around it.
    pub bounds: Aabb,
    /// Storey, 0 is the lowest.
    pub storey: u16,
}

/// A labelled instance.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Its number; not [`InstanceId::NONE`].
    pub id: InstanceId,
    /// Category by its mpcat40 name where there is one (`chair`, `tv_monitor`, `chest_of_drawers` …).
    pub category: String,
    /// Box around its triangles.
    pub bounds: Aabb,
    /// Index of its room in [`Scene::regions`].
    pub region: Option<u16>,
    /// What can be said of it.
    pub attributes: Attributes,
}

/// What can be said of an instance in words; empty strings are unknown.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Attributes {
    /// What people call it where the category is a more general word: `armchair`, `nightstand`, `refrigerator` …
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

/// Why a scene could not be read or is not a scene.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// A file could not be read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// The file.
        path: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file was read, and does not hold what it should.
    #[error("{path} is not a usable scene: {reason}")]
    Malformed {
        /// The file.
        path: String,
        /// What is wrong with it, and what to do.
        reason: String,
    },
}

impl Scene {
    /// The object with number `id`.
    pub fn object(&self, id: InstanceId) -> Option<&Object> {
        let found = self.objects.binary_search_by_key(&id, |object| object.id).ok()?;
        Some(&self.objects[found])
    }

    /// Box around all surfaces; `None` for an empty scene.
    pub fn bounds(&self) -> Option<Aabb> {
        Aabb::around(&self.mesh.positions)
    }

    /// The three corners of triangle `index`.
    ///
    /// # Panics
    /// When there is no such triangle.
    pub fn corners(&self, index: usize) -> [Point3<f32>; 3] {
        self.mesh.triangles[index].map(|corner| self.mesh.positions[corner as usize])
    }
}
