//! Facts of a scene, and the claims of sentences about it.

use crate::{
    describe::lexicon::{Measure, Name, SIZES, room_noun},
    survey::Palette,
};
use avln_geom::{Point3, Vector3};
use avln_scene::{InstanceId, Object, Scene};
use avln_world::SceneAssets;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Share of the seen pixels that must have a colour before a thing is called by it.
const CALLED_SHARE: f32 = 0.35;

/// The four ways that the side of a box can face.
pub(crate) const SIDES: [[f32; 2]; 4] = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]];

/// What was seen of a scene, for those who speak of it and those who check what they say.
pub(crate) struct Facts<'a> {
    pub(crate) assets: &'a SceneAssets,
    pub(crate) scene: &'a Scene,
    palettes: &'a BTreeMap<InstanceId, Palette>,
}

impl<'a> Facts<'a> {
    pub(crate) fn new(assets: &'a SceneAssets, palettes: &'a BTreeMap<InstanceId, Palette>) -> Self {
        Self { assets, scene: &assets.scene, palettes }
    }

    /// The colours in which an object was seen, when it was.
    pub(crate) fn palette(&self, object: &Object) -> Option<&Palette> {
        const ENOUGH: u64 = 30;
        self.palettes.get(&object.id).filter(|palette| palette.pixels() >= ENOUGH)
    }

    /// The colour that one would call a thing by: that of the mean of what was seen, which its label does not deny.
    pub(crate) fn color_of(&self, object: &Object) -> Option<&'static str> {
        let palette = self.palette(object)?;
        let word = palette.mean_word()?;
        let label = object.attributes.color.as_str();
        (palette.share_of(word) >= CALLED_SHARE && (label.is_empty() || label == word)).then_some(word)
    }

    /// The kind of room that an object is in, when it has a name.
    pub(crate) fn room_of(&self, object: &Object) -> Option<String> {
        room_noun(&self.scene.regions.get(usize::from(object.region?))?.label)
    }

    /// How many rooms are of this kind.
    pub(crate) fn rooms_called(&self, noun: &str) -> usize {
        self.scene.regions.iter().filter(|region| room_noun(&region.label).as_deref() == Some(noun)).count()
    }

    /// The measure of an object that a size word speaks of, metres, and the word's direction: 1 for more, -1 for less.
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

    /// How far the building's own surface is from `origin`, through all that stands between, metres.
    pub(crate) fn wall_m(&self, origin: Point3<f32>, [x, z]: [f32; 2], reach_m: f32) -> Option<f32> {
        self.structure_m(&origin, &Vector3::new(x, 0.0, z), reach_m)
    }

    /// Height of the floor under an object: that of its room, or of the building's own surface below it, metres.
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

    /// How far the building's own surface is along `direction` (of length 1), through all that stands between, metres.
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

/// What a sentence says of its target, apart from the words.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Claims {
    /// What it is called.
    pub(crate) head: Name,
    /// What is said of it.
    pub(crate) list: Vec<Claim>,
}

/// One thing that is said of a target.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Claim {
    Size(String),
    Shape(String),
    Color(String),
    Material(String),
    /// The kind of room that it is in.
    Room(String),
    /// Where it is.
    Place(Relation, Vec<Landmark>),
}

/// Where a thing is, as seen from where one can stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Relation {
    /// With something standing or lying on it.
    Holds,
    /// On something.
    On,
    /// Inside the legs of a table.
    Under,
    /// Hanging over something.
    Above,
    /// With something hanging over it.
    Below,
    /// On the left of something on the same wall, for somebody who faces the wall.
    LeftOf,
    /// On the right of something on the same wall, for somebody who faces the wall.
    RightOf,
    /// Between two things.
    Between,
    /// Hardly an arm's length away.
    NextTo,
    /// Within a step.
    Near,
    /// Across the room, wall to wall.
    Opposite,
    /// Where two walls meet.
    Corner,
    /// With its back to a wall.
    AgainstWall,
}

/// A thing that says where another one is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Landmark {
    pub(crate) name: Name,
    pub(crate) color: Option<String>,
    /// Whether its room has no other such thing.
    pub(crate) only: bool,
}
