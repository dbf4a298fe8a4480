//! The scene as it grows: assets are read once and placed as often as the scene asks for them.

use super::config::{Instance, Origin};
use super::placing;
use super::rooms::Room;
use super::templates::Template;
use crate::Report;
use crate::files::Checked;
use crate::frame::check_size;
use crate::glb;
use avln_geom::{Aabb, Point3};
use avln_scene::describe::{Meaning, Surfaces};
use avln_scene::limits::{MAX_TEXELS, MAX_TRIANGLES, MAX_VERTICES};
use avln_scene::{Attributes, InstanceId, Lighting, Material, Mesh, Object, Scene, SceneError, Texture};
use nalgebra::Matrix4;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// A mesh file with materials numbered as the scene's are.
struct Asset {
    mesh: Mesh,
}

/// A labelled thing and its triangles.
struct Placed {
    /// The number that the scene gives it.
    own_id: Option<u32>,
    category: String,
    noun: String,
    triangles: Range<usize>,
}

pub(super) struct Assembly {
    name: String,
    mesh: Mesh,
    materials: Vec<Material>,
    textures: Vec<Texture>,
    texels_left: u64,
    assets: BTreeMap<PathBuf, Rc<Asset>>,
    placed: Vec<Placed>,
    unlabelled: BTreeSet<String>,
}

impl Assembly {
    pub(super) fn new(name: String) -> Self {
        Self {
            name,
            mesh: Mesh::default(),
            materials: Vec::new(),
            textures: Vec::new(),
            texels_left: MAX_TEXELS,
            assets: BTreeMap::new(),
            placed: Vec::new(),
            unlabelled: BTreeSet::new(),
        }
    }

    /// Adds what belongs to no instance.
    pub(super) fn add_stage(
        &mut self,
        stage: &Template,
        instance: &Instance,
        says: &dyn Fn(String) -> SceneError,
        report: &mut Report,
    ) -> Result<(), SceneError> {
        let missing =
            || says(format!("its stage {:?} has no mesh in the data set; add the file", stage.name));
        let path = stage.asset.as_deref().ok_or_else(missing)?;
        let asset = self.asset(path, report)?;
        let place = placing::stage(stage, instance).map_err(|why| says(format!("its stage {why}")))?;
        self.append(&asset.mesh, &place).map(|_| ()).map_err(says)
    }

    /// Adds an object; one whose mesh is missing is left out.
    pub(super) fn add_object(
        &mut self,
        template: &Template,
        instance: &Instance,
        origin: Origin,
        meaning: Meaning,
        report: &mut Report,
    ) -> Result<Checked<()>, SceneError> {
        let Some(path) = template.asset.as_deref() else {
            report.warn(format!("object {:?} has no mesh in the data set; left out", template.name));
            return Ok(Ok(()));
        };
        let asset = self.asset(path, report)?;
        let place = placing::object(template, instance, origin, &asset.mesh);
        Ok(place.and_then(|place| self.append(&asset.mesh, &place)).map(|triangles| match meaning {
            Meaning::Object { category, noun } => {
                let own_id = instance.user_defined.get("instance_id").and_then(|id| id.as_u64());
                let own_id = own_id.filter(|id| (1..=u64::from(InstanceId::MAX)).contains(id));
                self.placed.push(Placed { own_id: own_id.map(|id| id as u32), category, noun, triangles });
            }
            Meaning::Nothing => {
                self.unlabelled.insert(template.name.clone());
            }
            Meaning::Structure => {}
        }))
    }

    /// The asset of a file, read when it is first asked for.
    fn asset(&mut self, path: &Path, report: &mut Report) -> Result<Rc<Asset>, SceneError> {
        if let Some(known) = self.assets.get(path) {
            return Ok(Rc::clone(known));
        }
        let model = glb::read_part(path, report)?;
        let fail = |reason: &str| super::malformed(path, reason);
        let texels: u64 = model.textures.iter().map(|texture| texture.pixels.len() as u64 / 4).sum();
        self.texels_left = self.texels_left.checked_sub(texels).ok_or_else(|| {
            fail("with it the textures exceed the texels that fit into memory; resize them")
        })?;
        let (first_material, first_texture) = (self.materials.len(), self.textures.len());
        let count = (first_material + model.materials.len()).max(first_texture + model.textures.len());
        if count > usize::from(u16::MAX) {
            return Err(fail(
                "with it the scene has more than 65535 materials or textures; merge some of them",
            ));
        }
        let mut mesh = model.mesh;
        mesh.material_of.iter_mut().for_each(|material| *material += first_material as u16);
        self.materials.extend(model.materials.into_iter().map(|material| Material {
            texture: material.texture.map(|texture| texture + first_texture as u16),
            ..material
        }));
        self.textures.extend(model.textures);
        let asset = Rc::new(Asset { mesh });
        self.assets.insert(path.to_owned(), Rc::clone(&asset));
        Ok(asset)
    }

    /// Adds the triangles of `mesh`, moved by `world_from_asset`, and returns their numbers.
    fn append(&mut self, mesh: &Mesh, world_from_asset: &Matrix4<f64>) -> Checked<Range<usize>> {
        let (first, corner) = (self.mesh.triangles.len(), self.mesh.positions.len());
        if first + mesh.triangles.len() > MAX_TRIANGLES || corner + mesh.positions.len() > MAX_VERTICES {
            return Err(format!(
                "takes the scene beyond {MAX_TRIANGLES} triangles or {MAX_VERTICES} vertices; simplify its assets"
            ));
        }
        for position in &mesh.positions {
            let point: Point3<f32> = world_from_asset.transform_point(&position.cast::<f64>()).cast();
            if !point.iter().all(|coordinate| coordinate.is_finite()) {
                return Err("has no finite place; correct its translation and scale".to_owned());
            }
            self.mesh.positions.push(point);
        }
        let mirrored = world_from_asset.fixed_view::<3, 3>(0, 0).determinant() < 0.0;
        self.mesh.triangles.extend(mesh.triangles.iter().map(|&[a, b, c]| {
            let moved = if mirrored { [a, c, b] } else { [a, b, c] };
            moved.map(|index| index + corner as u32)
        }));
        self.mesh.uvs.extend(&mesh.uvs);
        self.mesh.colors.extend(&mesh.colors);
        self.mesh.material_of.extend(&mesh.material_of);
        self.mesh.instance_of.resize(self.mesh.triangles.len(), InstanceId::NONE);
        Ok(first..self.mesh.triangles.len())
    }

    /// Numbers and describes the instances; `rooms` are the scene's.
    pub(super) fn finish(mut self, rooms: Vec<Room>, report: &mut Report) -> Checked<Scene> {
        check_size(&self.mesh, report)?;
        if let Some(example) = self.unlabelled.first() {
            report.warn(format!(
                "{} templates have no category, {example:?} for one; their instances are surfaces without a label",
                self.unlabelled.len()
            ));
        }
        let ids = self.numbers(report);
        let surfaces = Surfaces { mesh: &self.mesh, materials: &self.materials, textures: &self.textures };
        let described =
            self.placed.iter().zip(&ids).filter_map(|(placed, &id)| object(placed, id, &surfaces, &rooms));
        let mut objects: Vec<Object> = described.collect();
        objects.sort_by_key(|object| object.id);
        for (placed, id) in self.placed.iter().zip(ids) {
            self.mesh.instance_of[placed.triangles.clone()].fill(id);
        }
        Ok(Scene {
            name: self.name,
            mesh: self.mesh,
            materials: self.materials,
            textures: self.textures,
            regions: rooms.into_iter().map(|room| room.region).collect(),
            objects,
            lighting: Lighting::Painted,
        })
    }

    /// A number for each thing: its own where it brings one that is free, else the next free one.
    fn numbers(&self, report: &mut Report) -> Vec<InstanceId> {
        let mut taken = BTreeSet::new();
        let own: Vec<Option<u32>> =
            self.placed.iter().map(|placed| placed.own_id.filter(|&id| taken.insert(id))).collect();
        if self.placed.iter().zip(&own).any(|(placed, own)| placed.own_id != *own) {
            report.warn("an instance_id is given twice; the later instance gets another number");
        }
        let mut free = (1..=InstanceId::MAX).filter(|number| !taken.contains(number));
        own.into_iter().map(|own| InstanceId(own.or_else(|| free.next()).unwrap_or_default())).collect()
    }
}

/// The instance, unless it has no surface.
fn object(placed: &Placed, id: InstanceId, surfaces: &Surfaces<'_>, rooms: &[Room]) -> Option<Object> {
    let triangles: Vec<u32> = placed.triangles.clone().map(|triangle| triangle as u32).collect();
    let corners = surfaces.mesh.triangles[placed.triangles.clone()].iter().flatten();
    let corners: Vec<Point3<f32>> = corners.map(|&corner| surfaces.mesh.positions[corner as usize]).collect();
    let bounds = Aabb::around(&corners)?;
    let region = rooms.iter().position(|room| room.holds(&bounds.center())).map(|index| index as u16);
    let attributes = Attributes { noun: placed.noun.clone(), ..surfaces.attributes(&triangles, &bounds) };
    Some(Object { id, category: placed.category.clone(), bounds, region, attributes })
}
