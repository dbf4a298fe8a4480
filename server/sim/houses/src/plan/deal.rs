//! Deals rooms to the blocks of a storey and cuts the blocks into them.

use super::RoomKind::{self, *};
use super::outline::Outline;
use super::programme::{Annex, Unit};
use super::skeleton::Block;
use crate::rect::{Rect, Side, common};
use avln_geom::Rng;

/// Units per block, in order on the hallway.
type Deal = Vec<Vec<usize>>;

/// Hallway frontage required by a room door, metres.
const FRONTAGE_M: f32 = 1.4;

/// Least width of a closet's or bathroom's cell, metres.
const NARROW_M: f32 = 1.72;

/// The best assignment found by annealing.
pub(super) fn deal(rng: &mut Rng, blocks: &[Block], units: &[Unit]) -> Deal {
    const MOVES: i32 = 2500;
    let mut deal: Deal = vec![vec![]; blocks.len()];
    for unit in 0..units.len() {
        deal[rng.below(blocks.len())].push(unit);
    }
    let cost_of = |deal: &Deal, block: usize| block_cost(&blocks[block], &deal[block], units);
    let mut costs: Vec<f32> = (0..blocks.len()).map(|block| cost_of(&deal, block)).collect();
    for step in 0..MOVES {
        let heat = 3.0 * libm::powf(0.015, step as f32 / MOVES as f32);
        let Some((changed, touched)) = changed(rng, &deal) else { continue };
        let new = touched.map(|block| cost_of(&changed, block));
        let before = costs[touched[0]] + if touched[0] == touched[1] { 0.0 } else { costs[touched[1]] };
        let after = new[0] + if touched[0] == touched[1] { 0.0 } else { new[1] };
        if after <= before || rng.unit() < f64::from(libm::expf((before - after) / heat)) {
            deal = changed;
            touched.into_iter().zip(new).for_each(|(block, cost)| costs[block] = cost);
        }
    }
    deal
}

/// An assignment with a unit moved or two swapped, and the two changed blocks.
fn changed(rng: &mut Rng, deal: &Deal) -> Option<(Deal, [usize; 2])> {
    let mut changed = deal.clone();
    let from = rng.below(deal.len());
    let to = rng.below(deal.len());
    if deal[from].is_empty() {
        return None;
    }
    let taken = rng.below(deal[from].len());
    if rng.chance(0.5) && !deal[to].is_empty() {
        let other = rng.below(deal[to].len());
        changed[from][taken] = deal[to][other];
        changed[to][other] = deal[from][taken];
    } else {
        let unit = changed[from].remove(taken);
        let place = rng.below(changed[to].len() + 1);
        changed[to].insert(place, unit);
    }
    Some((changed, [from, to]))
}

/// Cost of the units in a block.
fn block_cost(block: &Block, members: &[usize], units: &[Unit]) -> f32 {
    if members.is_empty() {
        return 20.0 + block.rect.area_m2();
    }
    let [length, depth] = measures(block);
    let total: f32 = members.iter().map(|&unit| units[unit].total_m2()).sum();
    let stretch = libm::logf(block.rect.area_m2() / total);
    let mut cost = 8.0 * stretch * stretch;
    let mut start = block.hall.span(&block.rect)[0];
    for (place, &member) in members.iter().enumerate() {
        let unit = &units[member];
        let width = length * unit.total_m2() / total;
        let (along, first) = ([start, start + width], place == 0);
        cost += unit_cost(unit, block, [width, depth], along);
        cost -= if first { 0.0 } else { 0.7 * friendship(units[members[place - 1]].kind, unit.kind) };
        start = along[1];
    }
    cost + if block.closes { closing_cost(members, units) } else { 0.0 }
}

fn unit_cost(unit: &Unit, block: &Block, [width, depth]: [f32; 2], along: [f32; 2]) -> f32 {
    let narrow = (least_width_m(unit) - width).max(0.0);
    let host = if unit.annexes.is_empty() { width } else { width * 0.85 };
    let aspect = (host / depth).max(depth / host);
    let hidden = !block.closes && common(along, block.frontage) < FRONTAGE_M;
    8.0 * narrow + 4.0 * (aspect - 1.9).max(0.0) + if hidden { 6.0 } else { 0.0 }
}

fn least_width_m(unit: &Unit) -> f32 {
    let own = if matches!(unit.kind, Bathroom | Closet | Laundry | Utility) { NARROW_M } else { 2.6 };
    let beside = unit.annexes.iter().any(|annex| annex.kind == Closet) || unit.annexes.len() > 1;
    own + if beside { NARROW_M } else { 0.0 }
}

/// Cost of rooms at the end of a hallway, which are large and single.
fn closing_cost(members: &[usize], units: &[Unit]) -> f32 {
    let unit = &units[members[0]];
    let suits = matches!(unit.kind, LivingRoom | GameRoom | Garage | DiningRoom | Kitchen | Gym | Library)
        || unit.kind == Bedroom && !unit.annexes.is_empty();
    6.0 * (members.len() - 1) as f32 + if suits { 0.0 } else { 3.0 }
}

/// Affinity of two neighbours, 0 or 1.
pub(super) fn friendship(a: RoomKind, b: RoomKind) -> f32 {
    const FRIENDS: [[RoomKind; 2]; 12] = [
        [Kitchen, DiningRoom],
        [Kitchen, LivingRoom],
        [DiningRoom, LivingRoom],
        [Bedroom, Bathroom],
        [Bedroom, Office],
        [Gym, Bathroom],
        [Garage, Utility],
        [Garage, Laundry],
        [Kitchen, Laundry],
        [LivingRoom, Library],
        [LivingRoom, GameRoom],
        [Office, Library],
    ];
    f32::from(u8::from(FRIENDS.iter().any(|pair| *pair == [a, b] || *pair == [b, a])))
}

/// Length on the hallway and depth from it.
fn measures(block: &Block) -> [f32; 2] {
    let [x, z] = block.rect.size();
    if block.hall.runs_along_x() { [x, z] } else { [z, x] }
}

/// A room that was cut from a block.
#[derive(Clone, Debug)]
pub(super) struct Piece {
    pub(super) kind: RoomKind,
    pub(super) cells: Vec<Rect>,
    /// Distance back in the list to the host room; 0 for the hallway.
    pub(super) host: usize,
}

/// Cuts a block into its units, hosts before annexes.
pub(super) fn cut(rng: &mut Rng, block: &Block, members: &[usize], units: &[Unit]) -> Vec<Piece> {
    let span = block.hall.span(&block.rect);
    let [length, depth] = measures(block);
    let total: f32 = members.iter().map(|&unit| units[unit].total_m2()).sum();
    let mut pieces = Vec::new();
    let (mut start, mut share) = (span[0], 0.0);
    for (place, &member) in members.iter().enumerate() {
        share += units[member].total_m2() / total;
        let last = place + 1 == members.len();
        let end = if last { span[1] } else { ((span[0] + length * share) * 100.0).round() / 100.0 };
        let slot = block.hall.strip(&block.rect, [start, end], depth);
        pieces.extend(split(rng, slot, block.hall, &units[member]));
        start = end;
    }
    pieces
}

/// The host and annexes of a unit inside its slot.
fn split(rng: &mut Rng, slot: Rect, hall: Side, unit: &Unit) -> Vec<Piece> {
    let holes = match unit.annexes.as_slice() {
        [] => vec![],
        [annex] => vec![corner(rng, &slot, hall, annex)],
        [a, b, ..] => column(rng, &slot, hall, [a, b]),
    };
    let cells = Outline::without(&slot, &holes).rects();
    let mut pieces = vec![Piece { kind: unit.kind, cells, host: 0 }];
    for (index, (annex, hole)) in unit.annexes.iter().zip(holes).enumerate() {
        pieces.push(Piece { kind: annex.kind, cells: vec![hole], host: index + 1 });
    }
    pieces
}

/// Smallest remaining width next to a closet, metres.
const BESIDE_M: f32 = 1.4;

/// Position of an annex: closets at the hallway, rooms with windows at the outer wall.
fn corner(rng: &mut Rng, slot: &Rect, hall: Side, annex: &Annex) -> Rect {
    let span = hall.span(slot);
    let (width, depth) = (span[1] - span[0], slot.area_m2() / (span[1] - span[0]));
    let wanted = annex.area_m2 * rng.range(0.8, 1.3);
    let mut along = libm::sqrtf(wanted).max(NARROW_M).min(width);
    let rest = width - along;
    // The remainder must be wide enough to stand in, otherwise the annex uses the whole width, off the
    // hallway.
    let at_hall = annex.kind == Closet && rest >= BESIDE_M;
    if !at_hall && rest < NARROW_M {
        along = width;
    }
    let across = (annex.area_m2 / along).clamp(NARROW_M, (depth - 2.6).max(NARROW_M));
    let depths = if at_hall { [0.0, across] } else { [depth - across, depth] };
    let [along, depths] = [[0.0, along], depths].map(|pair| pair.map(|v| (v * 100.0).round() / 100.0));
    let along = if rng.chance(0.5) { [span[0], span[0] + along[1]] } else { [span[1] - along[1], span[1]] };
    snapped(slot, hall.band(slot, along, depths))
}

/// Positions of two annexes: a column at a side of the slot, closets at the hallway.
fn column(rng: &mut Rng, slot: &Rect, hall: Side, annexes: [&Annex; 2]) -> Vec<Rect> {
    let span = hall.span(slot);
    let depth = slot.area_m2() / (span[1] - span[0]);
    let areas = annexes.map(|annex| annex.area_m2);
    let width = (((areas[0] + areas[1]) / depth).max(NARROW_M) * 100.0).round() / 100.0;
    let width = width.min(span[1] - span[0]);
    let along = if rng.chance(0.5) { [span[0], span[0] + width] } else { [span[1] - width, span[1]] };
    let front = usize::from(annexes[1].kind == Closet);
    let share = areas[front] / (areas[0] + areas[1]) * depth;
    let share = (share.min(depth - NARROW_M).max(NARROW_M.min(depth / 2.0)) * 100.0).round() / 100.0;
    let mut places = vec![[0.0, share], [share, depth]];
    if front == 1 {
        places.reverse();
    }
    places.into_iter().map(|depths| snapped(slot, hall.band(slot, along, depths))).collect()
}

/// A rectangle with the edges that nearly touch `slot`'s moved onto them.
fn snapped(slot: &Rect, rect: Rect) -> Rect {
    let snap = |value: f32, edges: [f32; 2]| {
        edges.into_iter().find(|edge| (edge - value).abs() < 0.02).unwrap_or(value)
    };
    Rect { x: rect.x.map(|value| snap(value, slot.x)), z: rect.z.map(|value| snap(value, slot.z)) }
}
