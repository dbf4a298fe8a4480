//! Facts of a scene, as observed in the survey, and spatial relations between objects, restricted to undisputed ones.

use crate::{
    cue::{Claim, Landmark, Relation},
    describe::lexicon::{Measure, SIZES, is_landmark, may_be_called, names, room_noun},
    survey::look::Palette,
};
use avln_geom::{Aabb, Point3, Vector3};
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

/// Objects with a seat lower than their back.
const SOFT_TOPS: &[&str] = &["bed", "sofa", "chair", "seating"];
/// Objects that touch their support without resting on it.
const NEVER_RESTS: &[&str] = &["curtain", "blinds", "door", "window", "picture", "mirror", "rug", "radiator"];
/// Objects with space underneath.
const ON_LEGS: &[&str] = &["table", "desk"];
/// Objects that show the colour behind or before them.
const COLORLESS: &[&str] = &["window", "mirror", "door", "shower"];
/// Minimum bottom height above the floor for hanging objects, metres.
const HANGING_M: f32 = 0.4;
/// Objects with a top surface.
const HARD_TOPS: &str = "table desk cabinet chest_of_drawers counter shelving fireplace stool appliances rug";
/// Objects with a wall behind them in every house: no information.
const ALWAYS_AT_WALL: &str = "picture mirror counter sink toilet bathtub shower fireplace curtain towel door window \
    radiator tv_monitor cushion blinds clock rug";

pub(crate) struct Relater<'a> {
    pub(crate) facts: Facts<'a>,
    /// Per object: sides with a wall close behind.
    walls: Vec<[bool; 4]>,
    /// Per object: whether it hangs, above the floor without support.
    pub(crate) hangs: Vec<bool>,
}

impl<'a> Relater<'a> {
    pub(crate) fn new(facts: Facts<'a>) -> Self {
        let walls = facts.scene.objects.iter().map(|object| walls_of(&facts, object)).collect();
        let objects = &facts.scene.objects;
        let hangs = objects.iter().map(|object| {
            let high = object.bounds.min.y - facts.floor_y(object) > HANGING_M;
            high && !objects.iter().any(|other| other.id != object.id && rests_on(object, other))
        });
        Self { walls, hangs: hangs.collect(), facts }
    }

    /// Returns all relations between object `index` and the `seen` objects.
    pub(crate) fn places(&self, index: usize, seen: &[usize]) -> Vec<Claim> {
        let objects = &self.facts.scene.objects;
        let own = &objects[index];
        let usable = |other: &&usize| {
            let other = &objects[**other];
            other.category != own.category && is_landmark(other) && same_room(own, other)
        };
        let landmarks: Vec<usize> = seen.iter().filter(usable).copied().collect();
        let mut found = Vec::new();
        for &landmark in &landmarks {
            found.extend(self.relation(index, landmark).map(|relation| (relation, vec![landmark])));
        }
        found.extend(self.between(index, &landmarks).map(|pair| (Relation::Between, pair.to_vec())));
        found.extend(self.at_walls(index).map(|relation| (relation, Vec::new())));
        found.into_iter().flat_map(|(relation, things)| self.variants(relation, &things)).collect()
    }

    /// Most specific relation to a landmark.
    fn relation(&self, index: usize, landmark: usize) -> Option<Relation> {
        let objects = &self.facts.scene.objects;
        let (own, other) = (&objects[index], &objects[landmark]);
        let (a, b) = (&own.bounds, &other.bounds);
        let gap_m = flat_gap_m(a, b);
        if rests_on(own, other) {
            return Some(Relation::On);
        } else if rests_on(other, own) {
            return Some(Relation::Holds);
        } else if ON_LEGS.contains(&other.category.as_str()) && is_over(b, a, 0.0) && a.max.y < b.max.y {
            return Some(Relation::Under);
        } else if self.hangs[index] && has_an_under(other) && hangs_over(a, b) {
            return Some(Relation::Above);
        } else if self.hangs[landmark] && has_an_under(other) && hangs_over(b, a) {
            return Some(Relation::Below);
        } else if gap_m <= 0.0 {
            return None;
        } else if let Some(side) = self.side_on_wall(index, landmark) {
            return Some(side);
        }
        let level = overlap_m([a.min.y, a.max.y], [b.min.y, b.max.y]) > 0.1;
        match gap_m {
            gap_m if level && gap_m <= 0.35 => Some(Relation::NextTo),
            _ if near_m(a, b) <= 1.0 => Some(Relation::Near),
            _ if self.is_opposite(index, landmark) => Some(Relation::Opposite),
            _ => None,
        }
    }

    fn side_on_wall(&self, index: usize, landmark: usize) -> Option<Relation> {
        let objects = &self.facts.scene.objects;
        let (a, b) = (&objects[index].bounds, &objects[landmark].bounds);
        let side = (0..4).find(|&side| self.walls[index][side] && self.walls[landmark][side])?;
        let [x, z] = SIDES[side];
        // For a viewer looking in direction (x, z), right is (-z, x).
        let span = |bounds: &Aabb| {
            let ends = [bounds.min, bounds.max].map(|corner| corner.z * x - corner.x * z);
            [ends[0].min(ends[1]), ends[0].max(ends[1])]
        };
        let (own, other) = (span(a), span(b));
        let both_hang = self.hangs[index] && self.hangs[landmark];
        let level = overlap_m([a.min.y, a.max.y], [b.min.y, b.max.y]) > 0.1 || both_hang;
        let gap_m = (own[0] - other[1]).max(other[0] - own[1]);
        if !level || !(0.0..=0.9).contains(&gap_m) {
            return None;
        }
        Some(if own[0] >= other[1] { Relation::RightOf } else { Relation::LeftOf })
    }

    /// True if both objects are on opposite walls, facing each other across the floor.
    fn is_opposite(&self, index: usize, landmark: usize) -> bool {
        let objects = &self.facts.scene.objects;
        let (a, b) = (&objects[index].bounds, &objects[landmark].bounds);
        let faces = |side: usize| {
            let [x, z] = SIDES[side];
            let behind = (a.center() - b.center()).dot(&Vector3::new(x, 0.0, z));
            let axis = if x == 0.0 { 0 } else { 2 };
            let shared_m = overlap_m([a.min[axis], a.max[axis]], [b.min[axis], b.max[axis]]);
            let shared = shared_m / a.size()[axis].min(b.size()[axis]);
            self.walls[index][side] && self.walls[landmark][side ^ 1] && behind > 0.0 && shared > 0.6
        };
        let gap_m = flat_gap_m(a, b);
        (1.2..=4.5).contains(&gap_m) && (0..4).any(faces)
    }

    /// Closest pair with the object in between.
    fn between(&self, index: usize, landmarks: &[usize]) -> Option<[usize; 2]> {
        let objects = &self.facts.scene.objects;
        let own = &objects[index].bounds;
        let is_near = |landmark: &usize| {
            let other = &objects[*landmark].bounds;
            let level = overlap_m([own.min.y, own.max.y], [other.min.y, other.max.y]) > 0.1;
            level && (0.01..=1.0).contains(&flat_gap_m(own, other))
        };
        let near: Vec<usize> = landmarks.iter().copied().filter(is_near).collect();
        let pairs = near.iter().enumerate().flat_map(|(i, &a)| near[i + 1..].iter().map(move |&b| [a, b]));
        let width_m =
            |[a, b]: &[usize; 2]| flat_gap_m(own, &objects[*a].bounds) + flat_gap_m(own, &objects[*b].bounds);
        pairs.filter(|pair| self.is_between(index, *pair)).min_by(|a, b| width_m(a).total_cmp(&width_m(b)))
    }

    fn is_between(&self, index: usize, pair: [usize; 2]) -> bool {
        const COS_150_DEG: f32 = -0.866;
        let objects = &self.facts.scene.objects;
        let center = objects[index].bounds.center();
        let [a, b] = pair.map(|other| {
            let mut offset = objects[other].bounds.center() - center;
            offset.y = 0.0;
            offset
        });
        let lengths = a.norm() * b.norm();
        lengths > 0.0 && a.dot(&b) <= COS_150_DEG * lengths
    }

    fn at_walls(&self, index: usize) -> Option<Relation> {
        let object = &self.facts.scene.objects[index];
        let stands = object.bounds.min.y - self.facts.floor_y(object) < HANGING_M;
        let free = ALWAYS_AT_WALL.split(' ').all(|known| known != object.category);
        let [east, west, south, north] = self.walls[index];
        if !stands || !free {
            return None;
        } else if (east || west) && (south || north) {
            return Some(Relation::Corner);
        }
        [east, west, south, north].contains(&true).then_some(Relation::AgainstWall)
    }

    /// The claim with and without landmark colours.
    fn variants(&self, relation: Relation, things: &[usize]) -> Vec<Claim> {
        let plain: Vec<Landmark> = things.iter().map(|&thing| self.landmark(thing, None)).collect();
        let objects = &self.facts.scene.objects;
        let color = |&thing: &usize| {
            let object =
                Some(&objects[thing]).filter(|object| !COLORLESS.contains(&object.category.as_str()));
            self.facts.color_of(object?).map(str::to_owned)
        };
        let colored = things.iter().map(|thing| color(thing).map(|color| self.landmark(*thing, Some(color))));
        let mut variants = vec![Claim::Place(relation, plain)];
        if let Some(colored) = colored.collect::<Option<Vec<_>>>().filter(|list| !list.is_empty()) {
            variants.push(Claim::Place(relation, colored));
        }
        variants
    }

    fn landmark(&self, thing: usize, color: Option<String>) -> Landmark {
        let objects = &self.facts.scene.objects;
        let object = &objects[thing];
        let name = names(object).swap_remove(0);
        let twin = |other: &&Object| {
            other.id != object.id && other.region == object.region && may_be_called(other, &name)
        };
        let only = object.region.is_some() && objects.iter().find(twin).is_none();
        Landmark { name, color, only }
    }
}

/// True if two objects share a room; doors and windows belong to all adjacent rooms.
fn same_room(a: &Object, b: &Object) -> bool {
    a.region == b.region || ["door", "window"].contains(&b.category.as_str())
}

/// Horizontal distance between two boxes, metres; not positive for overlapping floor plans.
fn flat_gap_m(a: &Aabb, b: &Aabb) -> f32 {
    let x = (a.min.x - b.max.x).max(b.min.x - a.max.x);
    let z = (a.min.z - b.max.z).max(b.min.z - a.max.z);
    if x > 0.0 && z > 0.0 { (x * x + z * z).sqrt() } else { x.max(z) }
}

/// Distance between two boxes in space, metres.
fn near_m(a: &Aabb, b: &Aabb) -> f32 {
    let flat = flat_gap_m(a, b).max(0.0);
    let y = (a.min.y - b.max.y).max(b.min.y - a.max.y).max(0.0);
    (flat * flat + y * y).sqrt()
}

fn overlap_m(a: [f32; 2], b: [f32; 2]) -> f32 {
    a[1].min(b[1]) - a[0].max(b[0])
}

/// True if the centre of `upper` is above or below the floor plan of `lower`, grown by `margin_m`.
fn is_over(lower: &Aabb, upper: &Aabb, margin_m: f32) -> bool {
    let mut middle = upper.center();
    middle.y = lower.min.y;
    lower.grown(margin_m).contains(&middle)
}

fn rests_on(own: &Object, other: &Object) -> bool {
    let (a, b) = (&own.bounds, &other.bounds);
    let smaller = a.size().x.max(a.size().z) < 1.05 * b.size().x.max(b.size().z);
    let category = other.category.as_str();
    if !smaller || NEVER_RESTS.contains(&own.category.as_str()) || !is_over(b, a, 0.0) {
        return false;
    }
    let on_top = (a.min.y - b.max.y).abs() <= 0.06 && HARD_TOPS.split(' ').any(|known| known == category);
    let height_m = b.size().y;
    let on_seat = (b.min.y + 0.25 * height_m..b.max.y - 0.02).contains(&a.min.y) && a.max.y <= b.max.y + 0.8;
    on_top || on_seat && SOFT_TOPS.contains(&category)
}

/// True if the object has space underneath: curtains reach the floor.
fn has_an_under(object: &Object) -> bool {
    !["curtain", "door", "rug", "blinds"].contains(&object.category.as_str())
}

/// True if `upper` hangs over `lower` with a gap.
fn hangs_over(upper: &Aabb, lower: &Aabb) -> bool {
    let gap_m = upper.min.y - lower.max.y;
    (0.03..=1.2).contains(&gap_m) && (is_over(lower, upper, 0.15) && upper.max.y - lower.min.y < 2.6)
}

/// Sides with a wall close behind them.
fn walls_of(facts: &Facts, object: &Object) -> [bool; 4] {
    const INSIDE_M: f32 = 0.1;
    const BEHIND_M: f32 = 0.12;
    let (center, half) = (object.bounds.center(), object.bounds.size() / 2.0);
    SIDES.map(|[x, z]| {
        let depth_m = half.x * x.abs() + half.z * z.abs();
        let inside_m = INSIDE_M.min(depth_m);
        let face = center + Vector3::new(x, 0.0, z) * (depth_m - inside_m);
        let across = Vector3::new(half.x * z.abs(), 0.0, half.z * x.abs());
        let behind = |share: f32| facts.wall_m(face + across * share, [x, z], inside_m + BEHIND_M).is_some();
        [-0.8, -0.3, 0.3, 0.8].into_iter().filter(|&share| behind(share)).count() >= 3
    })
}
