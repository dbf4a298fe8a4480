//! Facts of a scene, as observed in the survey.

use crate::{
    describe::lexicon::{Measure, SIZES, room_noun},
    survey::look::Palette,
};
use avln_geom::{Point3, Vector3};
use avln_scene::{InstanceId, Object, Scene};
use avln_world::SceneAssets;
use std::collections::BTreeMap;

/// Minimum pixel share for a colour word.
const CALLED_SHARE: f32 = 0.35;

/// Outward normals of box sides, as (x, z).
pub(crate) const SIDES: [[f32; 2]; 4] = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]];

/// Observed scene facts, shared by writer and checker.
pub(crate) struct Facts<'a> {
    pub(crate) assets: &'a SceneAssets,
    pub(crate) scene: &'a Scene,
    palettes: &'a BTreeMap<InstanceId, Palette>,
}

impl<'a> Facts<'a> {
    pub(crate) fn new(assets: &'a SceneAssets, palettes: &'a BTreeMap<InstanceId, Palette>) -> Self {
        Self { assets, scene: &assets.scene, palettes }
    }

    pub(crate) fn palette(&self, object: &Object) -> Option<&Palette> {
        const ENOUGH: u64 = 30;
        self.palettes.get(&object.id).filter(|palette| palette.pixels() >= ENOUGH)
    }

    /// Colour word by mean observed colour, unless the label contradicts.
    pub(crate) fn color_of(&self, object: &Object) -> Option<&'static str> {
        let palette = self.palette(object)?;
        let word = palette.mean_word()?;
        let label = object.attributes.color.as_str();
        (palette.share_of(word) >= CALLED_SHARE && (label.is_empty() || label == word)).then_some(word)
    }

    pub(crate) fn room_of(&self, object: &Object) -> Option<String> {
        room_noun(&self.scene.regions.get(usize::from(object.region?))?.label)
    }

    pub(crate) fn rooms_called(&self, noun: &str) -> usize {
        self.scene.regions.iter().filter(|region| room_noun(&region.label).as_deref() == Some(noun)).count()
    }

    /// Measure behind a size word, metres, with the direction: 1 for large, -1 for small.
    pub(crate) fn measure(object: &Object, word: &str) -> Option<(f32, f32)> {
        let (_, measure) = SIZES.iter().find(|(known, _)| *known == word)?;
        let size = object.bounds.size();
        let value_m = match measure {
            Measure::Diagonal => size.norm(),
            Measure::Height => size.y,
            Measure::Width => size.x.max(size.z),
        };
        let direction = if ["small", "low", "short", "narrow"].contains(&word) { -1.0 } else { 1.0 };
        Some((value_m, direction))
    }

    /// Distance to the building surface from `origin`, ignoring furniture, metres.
    pub(crate) fn wall_m(&self, origin: Point3<f32>, [x, z]: [f32; 2], reach_m: f32) -> Option<f32> {
        self.structure_m(&origin, &Vector3::new(x, 0.0, z), reach_m)
    }

    /// Floor height under an object, by the room or the building surface below, metres.
    pub(crate) fn floor_y(&self, object: &Object) -> f32 {
        const STOREY_M: f32 = 4.0;
        let region = object.region.and_then(|region| self.scene.regions.get(usize::from(region)));
        let center = object.bounds.center();
        let below = || self.structure_m(&center, &Vector3::new(0.0, -1.0, 0.0), STOREY_M);
        match region {
            Some(region) => region.bounds.min.y,
            None => below().map_or(object.bounds.min.y, |down_m| center.y - down_m),
        }
    }

    /// Distance to the building surface in a direction (unit vector), ignoring furniture, metres.
    fn structure_m(&self, origin: &Point3<f32>, direction: &Vector3<f32>, reach_m: f32) -> Option<f32> {
        const PAST_M: f32 = 1e-3;
        const THINGS: usize = 24;
        let mut passed_m = 0.0;
        for _ in 0..THINGS {
            let struck = self.assets.cast(&(origin + direction * passed_m), direction, reach_m - passed_m)?;
            passed_m += struck.distance_m;
            if struck.instance == InstanceId::NONE {
                return Some(passed_m);
            }
            passed_m += PAST_M;
        }
        None
    }
}
