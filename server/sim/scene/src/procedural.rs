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
use plan::{CEILING_M, Plan};
use shell::Finish;
use std::ops::RangeInclusive;
use taste::Taste;

/// What a house should be like.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HouseOptions {
    /// How many rooms it has, the hallway among them; drawn from this range. At least one room is built.
    pub rooms: RangeInclusive<u8>,
}

impl Default for HouseOptions {
    /// Five to eight rooms.
    fn default() -> Self {
        Self { rooms: 5..=8 }
    }
}

/// Builds the house of `seed`. The floor lies on y = 0, the ceiling at 2.6 m, the middle of the house near the
/// origin. Houses of five rooms or more have a hallway, a living room, a kitchen, a bedroom and a bathroom.
pub fn house(name: &str, seed: u64, options: &HouseOptions) -> Scene {
    let rng = Rng::new(seed).fork("house");
    let plan = Plan::draw(&mut rng.fork("plan"), room_count(&mut rng.fork("size"), options));
    let mut taste = Taste::new(rng.fork("taste"));
    let mut finish_rng = rng.fork("finish");
    let finishes: Vec<Finish> =
        plan.rooms.iter().map(|room| Finish::choose(&mut finish_rng, room.kind)).collect();
    let mut assembly = Assembly::default();
    shell::add_facade(&mut assembly, &plan);
    for opening in &plan.openings {
        shell::add_opening(&mut assembly, opening, &finishes[opening.rooms[0]]);
    }
    for (index, finish) in finishes.iter().enumerate() {
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
    let region = |room: &plan::Room| Region {
        label: room.kind.label().to_owned(),
        bounds: room.interior().raised([0.0, CEILING_M]),
        storey: 0,
    };
    plan.rooms.iter().map(region).collect()
}
