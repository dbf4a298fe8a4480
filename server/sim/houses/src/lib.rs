//! Furnished procedural houses: hallways with rooms on both sides, small rooms in corners of large ones, one
//! or two storeys.
//!
//! Equal name, seed and options give equal bits on every platform. A body with 0.25 m radius and 0.2 m climb
//! reaches every room; furniture leaves the doors free.

mod assembly;
mod furnish;
mod furniture;
mod model;
mod paint;
mod plan;
mod reach;
mod rect;
mod shell;
mod space;
mod styles;
mod texture;

use assembly::Assembly;
use avln_geom::Rng;
use avln_scene::{Region, Scene};
use plan::{CEILING_M, Plan, RoomKind, STOREY_M};
use reach::Reach;
use rect::Rect;
use serde::{Deserialize, Serialize};
use shell::Finish;
use std::ops::RangeInclusive;
use styles::StyleSampler;

/// House properties.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HouseOptions {
    /// Room count range, including hallways, entryway and stairs (one per storey). Wide ranges are divided
    /// into small, medium and large houses. Houses have 1 to 24 rooms.
    pub rooms: RangeInclusive<u8>,
    /// Storey count range, 1 or 2. Houses below 11 rooms have a single storey.
    pub storeys: RangeInclusive<u8>,
    /// Pool for furniture palettes, shapes and combinations.
    pub pool: Pool,
}

const MOST_ROOMS: u8 = 24;

impl HouseOptions {
    /// Small single-storey houses, quick to build: six to nine rooms.
    pub fn small() -> Self {
        Self { rooms: 6..=9, storeys: 1..=1, ..Self::default() }
    }
}

impl Default for HouseOptions {
    /// Six to 24 rooms on one or two storeys, furniture from the training pool.
    fn default() -> Self {
        Self { rooms: 6..=MOST_ROOMS, storeys: 1..=2, pool: Pool::Train }
    }
}

/// A share of furniture palettes, shapes and combinations. Shares are disjoint: a split can contain objects
/// unseen in other splits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Pool {
    /// Training splits.
    #[default]
    Train,
    /// Validation splits.
    Validation,
    /// Test splits.
    Test,
}

impl Pool {
    /// All pools.
    pub const ALL: [Self; 3] = [Self::Train, Self::Validation, Self::Test];

    /// Name: `train`, `validation` or `test`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Validation => "validation",
            Self::Test => "test",
        }
    }

    /// Finds the pool `name`; `None` if unknown.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|pool| pool.name() == name)
    }
}

/// Builds the house for `seed`, centred near the origin. Floors are at y = 0 and 3.12 m, ceilings 2.6 m
/// above. Houses with five or more rooms have a hallway, living room, kitchen, bedroom and bathroom.
#[tracing::instrument(level = "debug", skip_all, fields(scene = name))]
pub fn house(name: &str, seed: u64, options: &HouseOptions) -> Scene {
    let rng = Rng::new(seed).fork("house");
    let (rooms, storeys) = size(&mut rng.fork("size"), options);
    let (plan, assembly) = sound(&rng, rooms, storeys, options.pool);
    assembly.into_scene(name, regions(&plan))
}

/// Largest number of draws per house.
const DRAWS: u32 = 8;

/// Returns the first draw with reachable rooms, otherwise the last.
fn sound(rng: &Rng, rooms: usize, storeys: usize, pool: Pool) -> (Plan, Assembly) {
    let mut draw = 0;
    loop {
        // Draw 0 uses the generator itself: a house that needs no second draw does not depend on retries.
        let rng = if draw == 0 { rng.clone() } else { rng.fork(&format!("draw {draw}")) };
        let (plan, mut assembly) = build(&rng, rooms, storeys, pool);
        let sound = repair(&plan, &mut assembly);
        draw += 1;
        if sound || draw == DRAWS {
            return (plan, assembly);
        }
    }
}

fn build(rng: &Rng, rooms: usize, storeys: usize, pool: Pool) -> (Plan, Assembly) {
    let plan = Plan::draw(&rng.fork("plan"), rooms, storeys);
    let mut finish_rng = rng.fork("finish");
    let mut finishes: Vec<Finish> =
        plan.rooms.iter().map(|room| Finish::choose(&mut finish_rng, room.kind)).collect();
    let wells: Vec<usize> =
        (0..plan.rooms.len()).filter(|&index| plan.rooms[index].kind == RoomKind::Stairs).collect();
    if let [lower, upper, ..] = wells[..] {
        // Both storeys show the same stairwell walls.
        finishes[upper] = finishes[lower].above();
    }
    let mut assembly = Assembly::default();
    add_building(&mut assembly, &plan, &finishes);
    // Labels are part of the random stream: another label means another house.
    let mut sampler = StyleSampler::new(rng.fork("taste"), pool);
    for (index, finish) in finishes.iter().enumerate() {
        assembly.on_floor_at(floor_m(plan.rooms[index].storey));
        shell::add_room(&mut assembly, &plan, index, finish);
        let room_rng = rng.fork(&format!("room {index}"));
        // Furniture comes before the floor, which is darker below it.
        let covered = furnish::furnish(&mut assembly, &mut sampler, &room_rng, &plan, index);
        shell::add_floor(&mut assembly, &plan, index, finish, &covered);
        shell::add_far_windows(&mut assembly, &plan, index);
    }
    (plan, assembly)
}

/// Adds the facade, door frames and stairs.
fn add_building(assembly: &mut Assembly, plan: &Plan, finishes: &[Finish]) {
    for storey in 0..plan.storeys() {
        assembly.on_floor_at(floor_m(storey));
        shell::add_facade(assembly, plan, storey);
    }
    for opening in &plan.openings {
        assembly.on_floor_at(floor_m(plan.rooms[opening.rooms[0]].storey));
        shell::add_opening(assembly, opening, &finishes[opening.rooms[0]]);
    }
    for index in (0..plan.rooms.len()).filter(|&index| plan.begins_stairs(index)) {
        assembly.on_floor_at(floor_m(plan.rooms[index].storey));
        shell::stairs::add_stairs(assembly, plan, index, &finishes[index]);
    }
}

/// Body radii, metres: for passing every door, and for a connected floor.
const BODIES_M: [f32; 2] = [0.25 + RASTER_M, 0.1 + RASTER_M];

/// Loss per gap side on the 5 cm navmesh lattice, metres.
const RASTER_M: f32 = 0.075;

/// Required connected floor share.
const ONE_PIECE: f32 = 0.95;

/// Removes furniture in front of blocked doors; returns false if doors stay blocked.
fn repair(plan: &Plan, assembly: &mut Assembly) -> bool {
    let reach = Reach::of(plan, assembly.objects(), BODIES_M[0]);
    let blocked = reach.blocked(plan, BODIES_M[0]);
    if !blocked.is_empty() {
        let steps: Vec<_> = blocked
            .iter()
            .map(|door| (plan.rooms[door.rooms[0]].storey, reach::doorstep(door, 0.9)))
            .collect();
        assembly.remove(|object| {
            let room = &plan.rooms[usize::from(object.region.unwrap_or(0))];
            let place = Rect::of(&object.bounds);
            // Windows and the front door are part of the walls, not in the way.
            let fixed = matches!(object.category.as_str(), "window" | "door");
            !fixed && steps.iter().any(|(storey, step)| *storey == room.storey && step.overlaps(&place))
        });
    }
    let [wide, slim] = BODIES_M.map(|radius_m| Reach::of(plan, assembly.objects(), radius_m));
    wide.sealed().is_empty() && wide.blocked(plan, BODIES_M[0]).is_empty() && slim.share() >= ONE_PIECE
}

/// Room count ranges for small, medium and large houses, with probabilities.
const SIZES: [(RangeInclusive<u8>, f32); 3] = [(6..=9, 0.3), (10..=15, 0.4), (16..=24, 0.3)];

/// Probability of a second storey in houses with enough rooms.
// Leads to about 30 % of all houses, because about a third are too small.
const TWO_STOREYS: f64 = 0.43;

/// Draws room and storey counts within the options.
fn size(rng: &mut Rng, options: &HouseOptions) -> (usize, usize) {
    let (low, high) = (*options.rooms.start(), (*options.rooms.end()).max(*options.rooms.start()));
    let classes = SIZES.map(|(class, weight)| ((*class.start()).max(low)..=(*class.end()).min(high), weight));
    let classes: Vec<_> = classes.into_iter().filter(|(class, _)| !class.is_empty()).collect();
    let weights: Vec<f32> = classes.iter().map(|(_, weight)| *weight).collect();
    let drawn = styles::weighted(rng, &weights).map(|index| classes[index].0.clone());
    let (low, high) = drawn.map_or((low, high), RangeInclusive::into_inner);
    let rooms = usize::from(low) + rng.below(usize::from(high - low) + 1);
    let (fewest, most) = (*options.storeys.start(), (*options.storeys.end()).min(2));
    let upper = if fewest < most { rng.chance(TWO_STOREYS) } else { fewest.min(most) == 2 };
    (rooms.clamp(1, usize::from(MOST_ROOMS)), 1 + usize::from(upper && rooms >= plan::STAIRS_FROM))
}

fn regions(plan: &Plan) -> Vec<Region> {
    let region = |room: &plan::Room| {
        let floor_m = floor_m(room.storey);
        Region {
            label: room.kind.label().to_owned(),
            bounds: room.extent().raised([floor_m, floor_m + CEILING_M]),
            storey: room.storey as u16,
        }
    };
    plan.rooms.iter().map(region).collect()
}

/// Floor height above the lowest storey, metres.
fn floor_m(storey: usize) -> f32 {
    storey as f32 * STOREY_M
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wide_body_passes_every_doorway() {
        for seed in 0..60 {
            let options = HouseOptions { pool: Pool::ALL[seed as usize % 3], ..HouseOptions::default() };
            let rng = Rng::new(seed).fork("house");
            let (rooms, storeys) = size(&mut rng.fork("size"), &options);
            let (plan, assembly) = sound(&rng, rooms, storeys, options.pool);
            assert_eq!((plan.rooms.len(), plan.storeys()), (rooms, storeys), "seed {seed}");
            let reach = Reach::of(&plan, assembly.objects(), 0.25);
            assert_eq!(reach.sealed(), Vec::<usize>::new(), "seed {seed}");
            assert!(reach.blocked(&plan, 0.25).is_empty(), "seed {seed}");
        }
    }

    #[test]
    fn pools_are_found_by_name() {
        for pool in Pool::ALL {
            assert_eq!(Pool::from_name(pool.name()), Some(pool));
            assert_eq!(serde_json::to_value(pool).unwrap(), pool.name());
        }
        assert_eq!(Pool::from_name("Train"), None);
    }
}
