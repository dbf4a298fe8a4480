//! Scene assembly from assets: an asset is read once and placed for all instances.

use crate::files::{Checked, ImportReport, malformed, refuse_if};
use crate::glb;
use crate::habitat::dataset::{InstanceEntry, Origin, Template};
use crate::habitat::labels::HabitatRoom;
use crate::named_model::bounds;
use crate::world_frame::check_size;
use avln_geom::{Aabb, Point3};
use avln_scene::describe::{Meaning, Surfaces};
use avln_scene::limits::{MAX_TEXELS, MAX_TRIANGLES, MAX_VERTICES};
use avln_scene::{Attributes, InstanceId, Lighting, Material, Mesh, Object, Scene, SceneError, Texture};
use nalgebra::{Matrix3, Matrix4, Quaternion, UnitQuaternion, Vector3};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::{ops::Range, rc::Rc};

struct PlacedObject {
    /// Number in the scene's configuration.
    own_id: Option<u32>,
    category: String,
    noun: String,
    triangles: Range<usize>,
}

#[derive(Default)]
pub(super) struct Assembly {
    name: String,
    mesh: Mesh,
    materials: Vec<Material>,
    textures: Vec<Texture>,
    texels: u64,
    /// Meshes by file, with the scene's material numbers.
    assets: BTreeMap<PathBuf, Rc<Mesh>>,
    placed: Vec<PlacedObject>,
    unlabelled: BTreeSet<String>,
}

impl Assembly {
    pub(super) fn new(name: String) -> Self {
        Self { name, ..Self::default() }
    }

    /// Adds the stage, without instances.
    pub(super) fn add_stage(
        &mut self,
        stage: &Template,
        instance: &InstanceEntry,
        fail: &dyn Fn(String) -> SceneError,
        report: &mut ImportReport,
    ) -> Result<(), SceneError> {
        let path = stage.asset.as_deref().ok_or_else(|| {
            fail(format!("its stage {:?} has no mesh in the data set; add the file", stage.name))
        })?;
        let asset = self.asset(path, report)?;
        let place = stage_place(stage, instance).map_err(|why| fail(format!("its stage {why}")))?;
        self.append(&asset, &place).map(|_| ()).map_err(fail)
    }

    /// Adds an object; an object without a mesh is left out, with a warning.
    pub(super) fn add_object(
        &mut self,
        template: &Template,
        instance: &InstanceEntry,
        origin: Origin,
        meaning: Meaning,
        report: &mut ImportReport,
    ) -> Result<Checked<()>, SceneError> {
        let Some(path) = template.asset.as_deref() else {
            report.warn(format!("object {:?} has no mesh in the data set; left out", template.name));
            return Ok(Ok(()));
        };
        let asset = self.asset(path, report)?;
        let place = object_place(template, instance, origin, &asset);
        Ok(place.and_then(|place| self.append(&asset, &place)).map(|triangles| match meaning {
            Meaning::Object { category, noun } => {
                let own_id = instance.user_defined.get("instance_id").and_then(|id| id.as_u64());
                let own_id =
                    own_id.filter(|id| (1..=u64::from(InstanceId::MAX)).contains(id)).map(|id| id as u32);
                self.placed.push(PlacedObject { own_id, category, noun, triangles });
            }
            Meaning::Unknown => {
                self.unlabelled.insert(template.name.clone());
            }
            Meaning::Structure => {}
        }))
    }

    fn asset(&mut self, path: &Path, report: &mut ImportReport) -> Result<Rc<Mesh>, SceneError> {
        if let Some(known) = self.assets.get(path) {
            return Ok(Rc::clone(known));
        }
        let model = glb::read_part(path, report)?;
        let fail = |reason: &str| malformed(path, reason);
        self.texels += model.textures.iter().map(|texture| texture.pixels.len() as u64 / 4).sum::<u64>();
        if self.texels > MAX_TEXELS {
            return Err(fail("with it, the textures exceed the texel limit; resize them"));
        }
        let first_material = self.materials.len();
        let first_texture = self.textures.len();
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
        let asset = Rc::new(mesh);
        self.assets.insert(path.to_owned(), Rc::clone(&asset));
        Ok(asset)
    }

    /// Adds `mesh` after a transform, and returns their numbers.
    fn append(&mut self, mesh: &Mesh, world_from_asset: &Matrix4<f64>) -> Checked<Range<usize>> {
        let first = self.mesh.triangles.len();
        let corner = self.mesh.positions.len();
        let (triangles, vertices) = (first + mesh.triangles.len(), corner + mesh.positions.len());
        refuse_if(triangles > MAX_TRIANGLES || vertices > MAX_VERTICES, || {
            format!(
                "takes the scene beyond {MAX_TRIANGLES} triangles or {MAX_VERTICES} vertices; simplify its assets"
            )
        })?;
        for position in &mesh.positions {
            let point: Point3<f32> = world_from_asset.transform_point(&position.cast::<f64>()).cast();
            refuse_if(!point.iter().all(|coordinate| coordinate.is_finite()), || {
                "has no finite position; correct its translation and scale".into()
            })?;
            self.mesh.positions.push(point);
        }
        // A mirrored asset would turn inside out: its triangles are reversed.
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

    /// Numbers and describes the instances, and returns the scene.
    pub(super) fn finish(mut self, rooms: Vec<HabitatRoom>, report: &mut ImportReport) -> Checked<Scene> {
        check_size(&self.mesh, report)?;
        if let Some(example) = self.unlabelled.first() {
            report.warn(format!(
                "{} templates have no category, for example {example:?}; their instances are unlabelled surfaces",
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

    /// Numbers per object: the configured number if it is free, or the next free number.
    fn numbers(&self, report: &mut ImportReport) -> Vec<InstanceId> {
        let mut taken = BTreeSet::new();
        let own: Vec<Option<u32>> =
            self.placed.iter().map(|placed| placed.own_id.filter(|&id| taken.insert(id))).collect();
        if self.placed.iter().zip(&own).any(|(placed, own)| placed.own_id != *own) {
            report.warn("an instance_id is not unique; the later instance has another number");
        }
        let mut free = (1..=InstanceId::MAX).filter(|number| !taken.contains(number));
        own.into_iter().map(|own| InstanceId(own.or_else(|| free.next()).unwrap_or_default())).collect()
    }
}

fn object(
    placed: &PlacedObject,
    id: InstanceId,
    surfaces: &Surfaces<'_>,
    rooms: &[HabitatRoom],
) -> Option<Object> {
    let triangles: Vec<u32> = placed.triangles.clone().map(|triangle| triangle as u32).collect();
    let bounds = bounds(surfaces.mesh, &triangles)?;
    let region = rooms.iter().position(|room| room.contains(&bounds.center())).map(|index| index as u16);
    let attributes = Attributes { noun: placed.noun.clone(), ..surfaces.attributes(&triangles, &bounds) };
    Some(Object { id, category: placed.category.clone(), bounds, region, attributes })
}

/// Least length for a direction or quaternion.
const TINY: f64 = 1e-6;
/// Greatest scale; larger ones are mistakes.
const MAX_SCALE: f64 = 1.0e4;

/// World from asset for the stage; the reference point is always the asset's origin.
pub(super) fn stage_place(template: &Template, instance: &InstanceEntry) -> Checked<Matrix4<f64>> {
    Ok(motion(instance)? * upright(template, instance)?)
}

/// World from asset for an object: T · R · (-C) · S · F, with habitat-sim's `RigidObject` centre C.
pub(super) fn object_place(
    template: &Template,
    instance: &InstanceEntry,
    origin: Origin,
    mesh: &Mesh,
) -> Checked<Matrix4<f64>> {
    let upright = upright(template, instance)?;
    let center = match origin {
        Origin::Asset => Vector3::zeros(),
        Origin::CenterOfMass => center(template, instance, mesh, &upright)?,
    };
    Ok(motion(instance)? * Matrix4::new_translation(&-center) * upright)
}

fn center(
    template: &Template,
    instance: &InstanceEntry,
    mesh: &Mesh,
    upright: &Matrix4<f64>,
) -> Checked<Vector3<f64>> {
    if let Some(given) = template.center_of_mass {
        return Ok(scale(template, instance)?.component_mul(&Vector3::from(given)));
    }
    let corners: Vec<Point3<f32>> =
        mesh.positions.iter().map(|point| upright.transform_point(&point.cast()).cast()).collect();
    Ok(Aabb::around(&corners).map_or(Vector3::zeros(), |bounds| bounds.center().coords.cast()))
}

/// Scale and frame: the upright asset at the origin.
fn upright(template: &Template, instance: &InstanceEntry) -> Checked<Matrix4<f64>> {
    Ok(Matrix4::new_nonuniform_scaling(&scale(template, instance)?) * upright_frame(template)?)
}

fn scale(template: &Template, instance: &InstanceEntry) -> Checked<Vector3<f64>> {
    let own =
        Vector3::from(template.scale) * template.units_to_meters * instance.uniform_scale.unwrap_or(1.0);
    let scale = own.component_mul(&Vector3::from(instance.non_uniform_scale.unwrap_or([1.0; 3])));
    let sane = |factor: &f64| factor.is_finite() && (1.0 / MAX_SCALE..=MAX_SCALE).contains(&factor.abs());
    if scale.iter().all(sane) {
        Ok(scale)
    } else {
        Err(format!("is scaled by {} x {} x {}; correct its scale", scale.x, scale.y, scale.z))
    }
}

fn motion(instance: &InstanceEntry) -> Checked<Matrix4<f64>> {
    let [w, x, y, z] = instance.rotation.unwrap_or([1.0, 0.0, 0.0, 0.0]);
    let quaternion = Quaternion::new(w, x, y, z);
    let rotation = UnitQuaternion::try_new(quaternion, TINY)
        .filter(|rotation| rotation.coords.iter().all(|part| part.is_finite()))
        .ok_or_else(|| {
            format!("has rotation [{w}, {x}, {y}, {z}], which is no quaternion w, x, y, z; correct it")
        })?;
    Ok(rotation.to_homogeneous().append_translation(&Vector3::from(instance.translation)))
}

/// The rotation from `up` to +Y and from `front` to -Z.
fn upright_frame(template: &Template) -> Checked<Matrix4<f64>> {
    let Template { up, front, .. } = template;
    let fail = || format!("has up {up:?} and front {front:?}, which form no frame; correct them");
    let up = Vector3::from(*up).try_normalize(TINY).ok_or_else(fail)?;
    let front = Vector3::from(*front);
    let front = (front - up * up.dot(&front)).try_normalize(TINY).ok_or_else(fail)?;
    let rows = [front.cross(&up), up, -front].map(|row| row.transpose());
    Ok(Matrix3::from_rows(&rows).to_homogeneous())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn template(up: [f64; 3], front: [f64; 3]) -> Template {
        Template { up, front, ..Template::default() }
    }

    fn image(matrix: &Matrix4<f64>, point: [f64; 3]) -> [f64; 3] {
        matrix.transform_point(&Point3::from(point)).coords.map(|value| (value * 1e9).round() / 1e9).into()
    }

    #[test]
    fn up_and_front_become_y_and_minus_z() {
        let turned =
            stage_place(&template([0.0, 0.0, 1.0], [0.0, 1.0, 0.0]), &InstanceEntry::default()).unwrap();
        // (x, y, z) becomes (x, z, -y).
        assert_eq!(image(&turned, [1.0, 2.0, 3.0]), [1.0, 3.0, -2.0]);
        let plain = stage_place(&Template::default(), &InstanceEntry::default()).unwrap();
        assert_eq!(image(&plain, [1.0, 2.0, 3.0]), [1.0, 2.0, 3.0]);
        let error =
            stage_place(&template([0.0, 1.0, 0.0], [0.0, 2.0, 0.0]), &InstanceEntry::default()).unwrap_err();
        assert!(error.contains("no frame"), "{error}");
    }

    #[test]
    fn a_rotation_begins_with_w() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let instance = InstanceEntry {
            rotation: Some([half, 0.0, half, 0.0]),
            translation: [10.0, 0.0, 0.0],
            ..InstanceEntry::default()
        };
        // A quarter turn to the left about +Y carries -Z to -X.
        let place = stage_place(&Template::default(), &instance).unwrap();
        assert_eq!(image(&place, [0.0, 1.0, -2.0]), [8.0, 1.0, 0.0]);
        let none = InstanceEntry { rotation: Some([0.0; 4]), ..InstanceEntry::default() };
        assert!(stage_place(&Template::default(), &none).unwrap_err().contains("quaternion"));
    }

    #[test]
    fn translation_moves_centre_of_mass_or_origin() {
        let mesh = Mesh {
            positions: vec![Point3::new(0.0, 0.0, 0.0), Point3::new(2.0, 4.0, 6.0)],
            ..Mesh::default()
        };
        let scaled = Template { scale: [2.0, 1.0, 1.0], ..Template::default() };
        let instance = InstanceEntry {
            translation: [0.0, 1.0, 0.0],
            uniform_scale: Some(0.5),
            ..InstanceEntry::default()
        };
        let place = |template: &Template, origin| object_place(template, &instance, origin, &mesh).unwrap();
        // Scaled by (1, 0.5, 0.5) the box is 2 x 2 x 3 with its centre at (1, 1, 1.5).
        assert_eq!(image(&place(&scaled, Origin::Asset), [2.0, 4.0, 6.0]), [2.0, 3.0, 3.0]);
        assert_eq!(image(&place(&scaled, Origin::CenterOfMass), [2.0, 4.0, 6.0]), [1.0, 2.0, 1.5]);
        let given = Template { center_of_mass: Some([2.0, 0.0, 0.0]), ..scaled };
        assert_eq!(image(&place(&given, Origin::CenterOfMass), [2.0, 4.0, 6.0]), [0.0, 3.0, 3.0]);
    }
}
