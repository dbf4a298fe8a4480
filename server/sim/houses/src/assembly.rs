//! Collection of shapes into a scene, with simple baked light.

use super::model::{Corner, Model};
use super::paint::Paint;
use super::texture::Pattern;
use avln_geom::{Aabb, Vector3};
use avln_scene::colors::name_of;
use avln_scene::describe::Surfaces;
use avln_scene::{Attributes, InstanceId, Lamp, Lighting, Material, Mesh, Object, Region, Scene, Texture};
use std::collections::BTreeMap;

#[derive(Default)]
pub(super) struct Assembly {
    mesh: Mesh,
    materials: Vec<Material>,
    textures: Vec<Texture>,
    objects: Vec<Object>,
    /// Lamps with their objects.
    lamps: Vec<(InstanceId, Lamp)>,
    /// Floor height added to all heights.
    floor_m: f32,
    material_of: BTreeMap<Paint, u16>,
    texture_of: BTreeMap<Pattern, u16>,
}

/// A piece of furniture in its own frame.
#[derive(Clone, Debug)]
pub(super) struct Piece {
    pub(super) category: &'static str,
    pub(super) model: Model,
    pub(super) attributes: Attributes,
}

impl Piece {
    /// Edge lengths in x, y, z.
    pub(super) fn size(&self) -> Vector3<f32> {
        self.model.bounds().size()
    }
}

impl Assembly {
    /// Sets the floor height for all shapes added later.
    pub(super) fn on_floor_at(&mut self, floor_m: f32) {
        self.floor_m = floor_m;
    }

    /// Adds geometry without an object; `light` returns the corner brightness, 0 to 1.
    pub(super) fn add_shell(&mut self, model: &Model, light: impl Fn(&Corner) -> f32) {
        self.add(model, InstanceId::NONE, light);
    }

    /// Adds a placed object with heights above the floor; returns the box in the same frame.
    pub(super) fn add_object(&mut self, piece: &Piece, region: usize) -> Aabb {
        let id = InstanceId(self.objects.len() as u32 + 1);
        let first = self.mesh.triangles.len();
        self.add(&piece.model, id, furniture_light);
        let bounds = piece.model.bounds();
        let attributes = self.truthful(piece, first);
        self.objects.push(Object {
            id,
            category: piece.category.to_owned(),
            bounds: Aabb::new(bounds.min + self.lift(), bounds.max + self.lift()),
            region: Some(region as u16),
            attributes,
        });
        bounds
    }

    pub(super) fn objects(&self) -> &[Object] {
        &self.objects
    }

    /// Removes objects; later objects get smaller ids.
    pub(super) fn remove(&mut self, unwanted: impl Fn(&Object) -> bool) {
        let kept: Vec<bool> = self.objects.iter().map(|object| !unwanted(object)).collect();
        // Ids are positions in the object list plus one, so they stay contiguous. Unused corners may remain.
        let new_id = |id: InstanceId| match id {
            InstanceId::NONE => Some(id),
            InstanceId(number) if kept[number as usize - 1] => {
                Some(InstanceId(1 + kept[..number as usize - 1].iter().filter(|kept| **kept).count() as u32))
            }
            _ => None,
        };
        let ids: Vec<Option<InstanceId>> = self.mesh.instance_of.iter().map(|&id| new_id(id)).collect();
        let stays = |index: &usize| ids[*index].is_some();
        let left: Vec<usize> = (0..ids.len()).filter(stays).collect();
        self.mesh.triangles = left.iter().map(|&index| self.mesh.triangles[index]).collect();
        self.mesh.material_of = left.iter().map(|&index| self.mesh.material_of[index]).collect();
        self.mesh.instance_of = ids.into_iter().flatten().collect();
        self.lamps = self.lamps.iter().filter_map(|&(id, lamp)| Some((new_id(id)?, lamp))).collect();
        let mut keep = kept.into_iter();
        self.objects.retain(|_| keep.next().unwrap_or(true));
        for (index, object) in self.objects.iter_mut().enumerate() {
            object.id = InstanceId(index as u32 + 1);
        }
    }

    /// Returns the piece's attributes, without the colour word if the triangles from `first` on average show
    /// another colour.
    fn truthful(&self, piece: &Piece, first: usize) -> Attributes {
        // Goal cues use these words: no colour word is better than one that a picture contradicts.
        let triangles: Vec<u32> = (first as u32..self.mesh.triangles.len() as u32).collect();
        let surfaces = Surfaces { mesh: &self.mesh, materials: &self.materials, textures: &self.textures };
        let said = piece.attributes.clone();
        match surfaces.mean_color(&triangles).map(name_of) {
            Some(word) if word == said.color => said,
            _ => Attributes { color: String::new(), ..said },
        }
    }

    pub(super) fn into_scene(self, name: &str, regions: Vec<Region>) -> Scene {
        Scene {
            name: name.to_owned(),
            mesh: self.mesh,
            materials: self.materials,
            textures: self.textures,
            regions,
            objects: self.objects,
            lighting: Lighting::Lamps(self.lamps.into_iter().map(|(_, lamp)| lamp).collect()),
        }
    }

    fn add(&mut self, model: &Model, id: InstanceId, light: impl Fn(&Corner) -> f32) {
        let first = self.mesh.positions.len() as u32;
        let mut softness = vec![0.0_f32; model.corners.len()];
        for (corners, paint) in &model.triangles {
            corners.iter().for_each(|&corner| softness[corner as usize] = soften(paint));
        }
        for (corner, softness) in model.corners.iter().zip(softness) {
            let shadow = (1.0 - light(corner)).clamp(0.0, 1.0) * softness;
            self.mesh.positions.push(corner.position + self.lift());
            self.mesh.uvs.push(corner.uv);
            self.mesh.colors.push([((1.0 - shadow) * 255.0).round() as u8; 3]);
        }
        for &(corners, paint) in &model.triangles {
            let material = self.material(paint);
            self.mesh.triangles.push(corners.map(|corner| corner + first));
            self.mesh.material_of.push(material);
            self.mesh.instance_of.push(id);
        }
        let lift = self.lift();
        let lifted = |lamp: &Lamp| (id, Lamp { position: lamp.position + lift, ..*lamp });
        self.lamps.extend(model.lamps.iter().map(lifted));
    }

    fn lift(&self) -> Vector3<f32> {
        Vector3::new(0.0, self.floor_m, 0.0)
    }

    fn material(&mut self, paint: Paint) -> u16 {
        if let Some(&index) = self.material_of.get(&paint) {
            return index;
        }
        let index = self.materials.len() as u16;
        let [r, g, b] = paint.rgb;
        let texture = paint.pattern.map(|pattern| self.texture(pattern));
        let name = paint.material.to_owned();
        self.materials.push(Material { name, base_color: [r, g, b, 255], texture, alpha_cutoff: None });
        self.material_of.insert(paint, index);
        index
    }

    fn texture(&mut self, pattern: Pattern) -> u16 {
        let textures = &mut self.textures;
        *self.texture_of.entry(pattern).or_insert_with(|| {
            textures.push(pattern.draw());
            textures.len() as u16 - 1
        })
    }
}

fn soften(paint: &Paint) -> f32 {
    // Bright surfaces light their surroundings and themselves.
    1.0 - 0.45 * ((paint.brightness() - 0.5) / 0.5).clamp(0.0, 1.0)
}

/// Returns brightness by direction, 0.76 to 1.
pub(super) fn facing_light(normal: &Vector3<f32>) -> f32 {
    // Daylight from above and one side distinguishes adjacent box faces; the floor reflects some of it.
    let above = if normal.y > 0.0 { 0.80 } else { 0.40 };
    0.85 + 0.15 * normal.dot(&Vector3::new(0.27, above, 0.53))
}

/// Returns the light on furniture: by direction, slightly darker towards the floor.
fn furniture_light(corner: &Corner) -> f32 {
    let lift = (corner.position.y / 0.5).clamp(0.0, 1.0);
    facing_light(&corner.normal) * (0.93 + 0.07 * lift)
}

/// Returns the light in room corners: 1 in the open, darker at a small `distance_m` to the nearest surface.
pub(super) fn corner_light(distance_m: f32, reach_m: f32, darkest: f32) -> f32 {
    let t = (distance_m / reach_m).clamp(0.0, 1.0);
    darkest + (1.0 - darkest) * t * (2.0 - t)
}
