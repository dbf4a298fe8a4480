//! Stairs between two storeys: two parallel flights, a half landing, a wall between the flights.
//!
//! Both storeys enter from the same side. In the stair frame, `along` points from that side, `across` from
//! the first to the second flight, and heights start at the lower floor.

use super::{Finish, facing_light, flat, upright};
use crate::assembly::Assembly;
use crate::model::Model;
use crate::paint::Paint;
use crate::plan::{CEILING_M, Plan, STOREY_M};
use crate::rect::{Rect, Side};

/// Steps per flight; the last is a landing.
const STEPS: usize = 9;

/// Step height, metres.
// 17.3 cm: below the 20 cm climb of a body.
const RISE_M: f32 = STOREY_M / (2 * STEPS) as f32;

const TREAD_M: f32 = 0.25;

/// Landing depth at the doors, metres.
const LANDING_M: f32 = 1.1;

/// Wall between the flights: width, and height above steps and upper floor, metres.
const SPINE_M: [f32; 2] = [0.1, 0.95];

/// A stairwell's floor and entry side.
#[derive(Clone, Copy)]
struct Well {
    floor: Rect,
    door: Side,
}

impl Well {
    /// `None` if the stairs have no door.
    fn of(plan: &Plan, index: usize) -> Option<Self> {
        let floor = plan.rooms[index].interior();
        let has_door = |side: &Side| plan.openings_on(index, &floor, *side).next().is_some();
        let door = Side::ALL.into_iter().find(has_door)?;
        Some(Self { floor, door })
    }

    fn width_m(&self) -> f32 {
        let span = self.door.span(&self.floor);
        span[1] - span[0]
    }

    fn depth_m(&self) -> f32 {
        self.floor.area_m2() / self.width_m()
    }

    /// Ranges across, first and second flight.
    fn flights(&self) -> [[f32; 2]; 2] {
        let (width, flight) = (self.width_m(), (self.width_m() - SPINE_M[0]) / 2.0);
        [[0.0, flight], [width - flight, width]]
    }

    fn rect(&self, along: [f32; 2], across: [f32; 2]) -> Rect {
        let start = self.door.span(&self.floor)[0];
        self.door.band(&self.floor, across.map(|value| start + value), along)
    }

    fn level(&self, model: &mut Model, along: [f32; 2], across: [f32; 2], y: f32, paint: Paint) {
        let rect = self.rect(along, across);
        model.quad(flat(rect.x, rect.z, y), paint);
    }

    /// A vertical face at `along`, towards the door or the back.
    fn riser(&self, model: &mut Model, along: f32, across: [f32; 2], y: [f32; 2], back: bool, paint: Paint) {
        let rect = self.rect([0.0, along], across);
        let far = self.door.opposite();
        let side = if back { far } else { self.door };
        model.quad(upright(side, far.line_m(&rect), self.door.span(&rect), y), paint);
    }

    /// A wooden rail on top of a wall.
    fn rail(&self, model: &mut Model, along: [f32; 2], across: [f32; 2], y: f32) {
        let wider = [(across[0] - RAIL_M[1]).max(0.0), across[1] + RAIL_M[1]];
        let rect = self.rect(along, wider);
        model.block(rect.x, [y, y + RAIL_M[0]], rect.z, Paint::plain("wood", [134, 92, 58]));
    }

    fn block(&self, model: &mut Model, along: [f32; 2], across: [f32; 2], y: [f32; 2], paint: Paint) {
        let rect = self.rect(along, across);
        model.slab(rect.x, y, rect.z, paint);
    }
}

/// Stairwell floor common to both storeys; `None` if the stairs have no door.
pub(crate) fn landing(plan: &Plan, index: usize) -> Option<Rect> {
    let well = Well::of(plan, index)?;
    // Only the landing has a floor on both storeys; the flights are open up to the upper ceiling.
    Some(well.rect([0.0, LANDING_M], [0.0, well.width_m()]))
}

/// Adds the stairs that start in room `lower`.
pub(crate) fn add_stairs(assembly: &mut Assembly, plan: &Plan, lower: usize, finish: &Finish) {
    let Some(well) = Well::of(plan, lower) else { return };
    let mut model = Model::new();
    first_flight(&mut model, &well, finish);
    second_flight(&mut model, &well, finish);
    banisters(&mut model, &well);
    assembly.add_shell(&model, |corner| 0.1 + 0.9 * facing_light(&corner.normal));
}

/// Adds the flight up to the half landing, and the half landing.
fn first_flight(model: &mut Model, well: &Well, finish: &Finish) {
    let across = well.flights()[0];
    for step in 0..STEPS {
        let (start, y) = (LANDING_M + step as f32 * TREAD_M, step as f32 * RISE_M);
        well.riser(model, start, across, [y, y + RISE_M], true, finish.skirting);
        let (end, across) = match step + 1 == STEPS {
            true => (well.depth_m(), [0.0, well.width_m()]),
            false => (start + TREAD_M, across),
        };
        well.level(model, [start, end], across, y + RISE_M, finish.floor);
    }
}

/// Adds the flight up to the upper floor, and the edge of the upper floor.
fn second_flight(model: &mut Model, well: &Well, finish: &Finish) {
    let across = well.flights()[1];
    let far = LANDING_M + (STEPS - 1) as f32 * TREAD_M;
    for step in 0..STEPS {
        let start = far - step as f32 * TREAD_M;
        let y = (STEPS + step) as f32 * RISE_M;
        well.riser(model, start, across, [y, y + RISE_M], false, finish.skirting);
        if step + 1 < STEPS {
            well.level(model, [start - TREAD_M, start], across, y + RISE_M, finish.floor);
        }
    }
    well.riser(model, LANDING_M, across, [0.0, CEILING_M], true, finish.wall);
    let beside = [0.0, across[0]];
    well.riser(model, LANDING_M, beside, [CEILING_M, STOREY_M], false, finish.ceiling);
}

/// Rail thickness and overhang, metres.
const RAIL_M: [f32; 2] = [0.05, 0.025];

/// Adds the wall between the flights, and the upper railing.
fn banisters(model: &mut Model, well: &Well) {
    let paint = Paint::plain("wood", [224, 218, 206]);
    let [first, second] = well.flights();
    let between = [first[1], second[0]];
    let far = LANDING_M + (STEPS - 1) as f32 * TREAD_M;
    for step in 1..STEPS {
        let start = far - step as f32 * TREAD_M;
        let top = (STEPS + step) as f32 * RISE_M + SPINE_M[1];
        well.block(model, [start, start + TREAD_M], between, [0.0, top], paint);
        well.rail(model, [start, start + TREAD_M], between, top);
    }
    let (railing, across, top) =
        ([LANDING_M - SPINE_M[0], LANDING_M], [0.0, between[1]], STOREY_M + SPINE_M[1]);
    well.block(model, railing, across, [STOREY_M, top], paint);
    well.rail(model, [railing[0] - RAIL_M[1], railing[1] + RAIL_M[1]], [0.0, across[1] - RAIL_M[1]], top);
}
