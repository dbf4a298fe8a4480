//! Furnished houses from a seed: one storey, a hallway, rooms around it.
//!
//! The same name, seed and options give the same bits on every platform. Every room can be reached by a body of
//! 0.25 m radius; furniture leaves the doors free.

mod assembly;
mod furnish;
mod furniture;
mod model;
mod paint;
mod plan;
mod rect;
mod shell;
mod space;
mod taste;
mod texture;

use crate::{Region, Scene};
use assembly::Assembly;
use avln_geom::Rng;
use plan::{CEILING_M, Plan, STOREY_M};
use serde::{Deserialize, Serialize};
use shell::Finish;
use std::ops::RangeInclusive;
use taste::Taste;

/// What a house should be like.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HouseOptions {
    /// How many rooms it has, the hallway among them; drawn from this range. At least one room is built.
    pub rooms: RangeInclusive<u8>,
    /// How many storeys it has, 1 or 2; drawn from this range.
    pub storeys: RangeInclusive<u8>,
    /// Which palettes, shapes and part combinations its furniture is drawn from.
    pub pool: Pool,
}

impl Default for HouseOptions {
    /// Five to eight rooms on one storey, furniture of the training pool.
    fn default() -> Self {
        Self { rooms: 5..=8, storeys: 1..=1, pool: Pool::Train }
    }
}

/// A share of the palettes, shapes and part combinations of furniture; the shares are disjoint, so that a split can
/// show things that no other split shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Pool {
    /// For training splits.
    #[default]
    Train,
    /// For validation splits.
    Validation,
    /// For test splits.
    Test,
}

impl Pool {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Train, Self::Validation, Self::Test];

    /// Its name: `train`, `validation` or `test`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Validation => "validation",
            Self::Test => "test",
        }
    }

    /// The pool called `name`; `None` when there is none.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|pool| pool.name() == name)
    }
}

/// Builds the house of `seed`. The floor lies on y = 0, the ceiling at 2.6 m, the middle of the house near the
/// origin. Houses of five rooms or more have a hallway, a living room, a kitchen, a bedroom and a bathroom.
pub fn house(name: &str, seed: u64, options: &HouseOptions) -> Scene {
    let rng = Rng::new(seed).fork("house");
    let plan = Plan::draw(&mut rng.fork("plan"), room_count(&mut rng.fork("size"), options));
    let mut taste = Taste::new(rng.fork("taste"), options.pool);
    let mut finish_rng = rng.fork("finish");
    let finishes: Vec<Finish> =
        plan.rooms.iter().map(|room| Finish::choose(&mut finish_rng, room.kind)).collect();
    let mut assembly = Assembly::default();
    for storey in 0..plan.storeys() {
        assembly.on_floor_at(floor_m(storey));
        shell::add_facade(&mut assembly, &plan, storey);
    }
    for opening in &plan.openings {
        assembly.on_floor_at(floor_m(plan.rooms[opening.rooms[0]].storey));
        shell::add_opening(&mut assembly, opening, &finishes[opening.rooms[0]]);
    }
    for (index, finish) in finishes.iter().enumerate() {
        assembly.on_floor_at(floor_m(plan.rooms[index].storey));
        shell::add_room(&mut assembly, &plan, index, finish);
        let room_rng = rng.fork(&format!("room {index}"));
        let covered = furnish::furnish(&mut assembly, &mut taste, room_rng, &plan, index);
        shell::add_floor(&mut assembly, &plan.rooms[index], finish, &covered);
    }
    assembly.into_scene(name, regions(&plan))
}

fn room_count(rng: &mut Rng, options: &HouseOptions) -> usize {
    let (low, high) = (usize::from(*options.rooms.start()), usize::from(*options.rooms.end()));
    low + rng.below(high.saturating_sub(low) + 1)
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

/// Height of the floor of a storey above that of the lowest, metres.
fn floor_m(storey: usize) -> f32 {
    storey as f32 * STOREY_M
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pools_are_found_by_their_names() {
        for pool in Pool::ALL {
            assert_eq!(Pool::from_name(pool.name()), Some(pool));
            assert_eq!(serde_json::to_value(pool).unwrap(), pool.name());
        }
        assert_eq!(Pool::from_name("Train"), None);
    }
}
