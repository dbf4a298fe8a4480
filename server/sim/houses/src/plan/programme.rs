//! Room programme: kinds, sizes and groups; assignment to a storey's blocks; division of the blocks.

use super::RoomKind::{self, *};
use super::outline::Outline;
use super::skeleton::Block;
use crate::rect::{Rect, Side, common};
use crate::styles::weighted;
use avln_geom::Rng;

/// A room at the hallway with small rooms in its corners.
#[derive(Clone, Debug)]
pub(super) struct RoomUnit {
    pub(super) kind: RoomKind,
    pub(super) area_m2: f32,
    pub(super) annexes: Vec<Annex>,
}

/// A small room in a corner of another.
#[derive(Clone, Copy, Debug)]
pub(super) struct Annex {
    pub(super) kind: RoomKind,
    pub(super) area_m2: f32,
}

impl RoomUnit {
    /// Floor area with all annexes.
    pub(super) fn total_m2(&self) -> f32 {
        self.area_m2 + self.annexes.iter().map(|annex| annex.area_m2).sum::<f32>()
    }
}

/// Largest number per kind, and the weight of another.
const EXTRAS: [(RoomKind, usize, f32); 12] = [
    (DiningRoom, 1, 4.0),
    (Bedroom, 5, 3.0),
    (Bathroom, 3, 2.2),
    (Closet, 3, 2.0),
    (Office, 2, 1.6),
    (Laundry, 1, 1.6),
    (Gym, 1, 0.9),
    (GameRoom, 1, 0.9),
    (Utility, 1, 0.8),
    (Library, 1, 0.7),
    (Garage, 1, 0.6),
    (LivingRoom, 2, 0.3),
];

/// Draws `count` room kinds without passages. Four or more include the four basic kinds.
pub(super) fn programme(rng: &mut Rng, count: usize) -> Vec<RoomKind> {
    let mut kinds = vec![LivingRoom, Kitchen, Bedroom, Bathroom];
    kinds.truncate(count);
    while kinds.len() < count {
        let weights =
            EXTRAS.map(|(kind, most, weight)| if allowed(&kinds, kind, most) { weight } else { 0.0 });
        kinds.push(weighted(rng, &weights).map_or(Bedroom, |index| EXTRAS[index].0));
    }
    kinds
}

fn allowed(kinds: &[RoomKind], kind: RoomKind, most: usize) -> bool {
    let count = |kind: RoomKind| kinds.iter().filter(|other| **other == kind).count();
    count(kind) < most
        && match kind {
            Bedroom => count(Bedroom) <= 1 + kinds.len() / 5,
            Bathroom | Closet => count(kind) < count(Bedroom),
            _ => true,
        }
}

/// Draws a floor area, square metres (after Infinigen Indoors' targets, bedrooms smaller).
pub(super) fn area_m2(rng: &mut Rng, kind: RoomKind) -> f32 {
    let (low, high) = match kind {
        LivingRoom => (22.0, 30.0),
        Kitchen => (13.0, 18.0),
        DiningRoom => (12.0, 16.0),
        Bedroom => (12.0, 18.0),
        Bathroom => (6.5, 9.0),
        Closet => (3.2, 4.6),
        Laundry | Utility => (6.0, 8.0),
        Office => (10.0, 13.0),
        Library | Gym => (13.0, 17.0),
        GameRoom => (18.0, 24.0),
        Garage => (20.0, 27.0),
        Hallway | Entryway | Stairs => (8.0, 10.0),
    };
    rng.range(low, high)
}

/// Smaller rooms are not shrunk, square metres.
const SMALL_M2: f32 = 9.5;

/// Puts closets and some bathrooms, laundries and utility rooms into corners of larger rooms.
pub(super) fn units(rng: &mut Rng, kinds: &[RoomKind]) -> Vec<RoomUnit> {
    let mut units: Vec<RoomUnit> = Vec::new();
    let (small, large): (Vec<RoomKind>, Vec<RoomKind>) =
        kinds.iter().partition(|kind| matches!(kind, Closet | Bathroom | Laundry | Utility));
    for kind in large {
        let area_m2 = area_m2(rng, kind);
        units.push(RoomUnit { kind, area_m2, annexes: vec![] });
    }
    let mut bathrooms = 0;
    for kind in small {
        let area_m2 = area_m2(rng, kind);
        bathrooms += usize::from(kind == Bathroom);
        let annexed = match kind {
            Closet => true,
            Bathroom => bathrooms > 1 && rng.chance(0.6),
            _ => rng.chance(0.5),
        };
        match host(&mut units, kind).filter(|_| annexed) {
            Some(unit) => unit.annexes.push(Annex { kind, area_m2: area_m2.min(6.5) }),
            None => units.push(RoomUnit { kind, area_m2, annexes: vec![] }),
        }
    }
    units
}

/// Returns the best host for a small room.
fn host(units: &mut [RoomUnit], kind: RoomKind) -> Option<&mut RoomUnit> {
    let hosts: &[RoomKind] = match kind {
        Closet => &[Bedroom, Office, Gym, GameRoom],
        Bathroom => &[Bedroom],
        _ => &[Garage, Kitchen],
    };
    let has = |unit: &RoomUnit| unit.annexes.iter().any(|annex| annex.kind == kind);
    let free =
        units.iter_mut().filter(|unit| hosts.contains(&unit.kind) && !has(unit) && unit.annexes.len() < 2);
    free.min_by_key(|unit| (hosts.iter().position(|host| *host == unit.kind), unit.annexes.len()))
}

/// Shrinks the larger rooms until all rooms take at most `most_m2`.
pub(super) fn fit(units: &mut [RoomUnit], most_m2: f32) {
    let small = |unit: &RoomUnit| unit.area_m2 <= SMALL_M2;
    let annexes: f32 = units.iter().map(|unit| unit.total_m2() - unit.area_m2).sum();
    let fixed: f32 = annexes + units.iter().filter(|unit| small(unit)).map(|unit| unit.area_m2).sum::<f32>();
    let rest: f32 = units.iter().filter(|unit| !small(unit)).map(|unit| unit.area_m2).sum();
    let factor = ((most_m2 - fixed) / rest.max(1.0)).clamp(0.6, 1.0);
    for unit in units.iter_mut().filter(|unit| !small(unit)) {
        unit.area_m2 = (unit.area_m2 * factor).max(SMALL_M2);
    }
}

/// Divides the rooms between two storeys: public and noisy rooms below, bedrooms above.
pub(super) fn by_storey(rng: &mut Rng, units: Vec<RoomUnit>) -> [Vec<RoomUnit>; 2] {
    let total: f32 = units.iter().map(RoomUnit::total_m2).sum();
    let mut bathrooms = 0;
    let mut ranked: Vec<(f32, RoomUnit)> = Vec::new();
    for unit in units {
        bathrooms += usize::from(unit.kind == Bathroom);
        let height = match unit.kind {
            Garage | Kitchen | LivingRoom | DiningRoom => 0.0,
            Laundry | Utility => 0.3,
            // The first bathroom is upstairs near the bedrooms, the second below.
            Bathroom if bathrooms == 2 => 0.2,
            GameRoom | Gym => 0.45,
            Library | Office => 0.6,
            _ => 0.9,
        };
        ranked.push((height + rng.range(0.0, 0.25), unit));
    }
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut storeys = [vec![], vec![]];
    let mut below_m2 = 0.0;
    for (_, unit) in ranked {
        // Slightly more than half is below: the upper storey may have fewer wings.
        let below = below_m2 + unit.total_m2() / 2.0 < 0.52 * total;
        below_m2 += if below { unit.total_m2() } else { 0.0 };
        storeys[usize::from(!below)].push(unit);
    }
    storeys
}

/// Units per block, in order on the hallway.
type Deal = Vec<Vec<usize>>;

/// Hallway frontage required by a room door, metres.
const FRONTAGE_M: f32 = 1.4;

/// Smallest width of closets and bathrooms, metres.
const NARROW_M: f32 = 1.72;

/// Assigns units to blocks by simulated annealing.
pub(super) fn deal(rng: &mut Rng, blocks: &[Block], units: &[RoomUnit]) -> Deal {
    // Area, proportions, neighbours and doors are weighed together (docs/decisions/0006). Powers and
    // exponentials come from libm, for equal bits on every platform.
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

/// Returns an assignment with a unit moved or two swapped, and the two changed blocks.
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

fn block_cost(block: &Block, members: &[usize], units: &[RoomUnit]) -> f32 {
    if members.is_empty() {
        return 20.0 + block.rect.area_m2();
    }
    let [length, depth] = measures(block);
    let total: f32 = members.iter().map(|&unit| units[unit].total_m2()).sum();
    // The logarithm penalises half and double the wanted area equally.
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

fn unit_cost(unit: &RoomUnit, block: &Block, [width, depth]: [f32; 2], along: [f32; 2]) -> f32 {
    let narrow = (least_width_m(unit) - width).max(0.0);
    let host = if unit.annexes.is_empty() { width } else { width * 0.85 };
    let aspect = (host / depth).max(depth / host);
    let hidden = !block.closes && common(along, block.frontage) < FRONTAGE_M;
    8.0 * narrow + 4.0 * (aspect - 1.9).max(0.0) + if hidden { 6.0 } else { 0.0 }
}

fn least_width_m(unit: &RoomUnit) -> f32 {
    let own = if matches!(unit.kind, Bathroom | Closet | Laundry | Utility) { NARROW_M } else { 2.6 };
    let beside = unit.annexes.iter().any(|annex| annex.kind == Closet) || unit.annexes.len() > 1;
    own + if beside { NARROW_M } else { 0.0 }
}

/// Cost at the end of a hallway, which suits a large single room.
fn closing_cost(members: &[usize], units: &[RoomUnit]) -> f32 {
    let unit = &units[members[0]];
    let suits = matches!(unit.kind, LivingRoom | GameRoom | Garage | DiningRoom | Kitchen | Gym | Library)
        || unit.kind == Bedroom && !unit.annexes.is_empty();
    6.0 * (members.len() - 1) as f32 + if suits { 0.0 } else { 3.0 }
}

/// Affinity between neighbours, 0 or 1.
pub(super) fn friendship(a: RoomKind, b: RoomKind) -> f32 {
    const FRIENDS: [(RoomKind, &[RoomKind]); 7] = [
        (Kitchen, &[DiningRoom, LivingRoom, Laundry]),
        (DiningRoom, &[LivingRoom]),
        (Bedroom, &[Bathroom, Office]),
        (Gym, &[Bathroom]),
        (Garage, &[Utility, Laundry]),
        (LivingRoom, &[Library, GameRoom]),
        (Office, &[Library]),
    ];
    let related = |a: RoomKind, b: RoomKind| FRIENDS.iter().any(|(kind, of)| *kind == a && of.contains(&b));
    f32::from(u8::from(related(a, b) || related(b, a)))
}

/// Length on the hallway and depth from it.
fn measures(block: &Block) -> [f32; 2] {
    let [x, z] = block.rect.size();
    if block.hall.runs_along_x() { [x, z] } else { [z, x] }
}

/// A room cut from a block.
#[derive(Clone, Debug)]
pub(super) struct CutRoom {
    pub(super) kind: RoomKind,
    pub(super) cells: Vec<Rect>,
    /// Distance back in the list to the host room; 0 for the hallway.
    pub(super) host: usize,
}

/// Cuts a block into rooms, hosts before annexes.
pub(super) fn cut(rng: &mut Rng, block: &Block, members: &[usize], units: &[RoomUnit]) -> Vec<CutRoom> {
    let span = block.hall.span(&block.rect);
    let [length, depth] = measures(block);
    let total: f32 = members.iter().map(|&unit| units[unit].total_m2()).sum();
    let mut pieces = Vec::new();
    let (mut start, mut share) = (span[0], 0.0);
    for (place, &member) in members.iter().enumerate() {
        share += units[member].total_m2() / total;
        let last = place + 1 == members.len();
        // The last room absorbs the rounding, so no gap remains.
        let end = if last { span[1] } else { ((span[0] + length * share) * 100.0).round() / 100.0 };
        let slot = block.hall.strip(&block.rect, [start, end], depth);
        pieces.extend(split(rng, slot, block.hall, &units[member]));
        start = end;
    }
    pieces
}

/// Cuts a unit's slot into host and annexes.
fn split(rng: &mut Rng, slot: Rect, hall: Side, unit: &RoomUnit) -> Vec<CutRoom> {
    let holes = match unit.annexes.as_slice() {
        [] => vec![],
        [annex] => vec![corner(rng, &slot, hall, annex)],
        [a, b, ..] => column(rng, &slot, hall, [a, b]),
    };
    let cells = Outline::without(&slot, &holes).rects();
    let mut pieces = vec![CutRoom { kind: unit.kind, cells, host: 0 }];
    for (index, (annex, hole)) in unit.annexes.iter().zip(holes).enumerate() {
        pieces.push(CutRoom { kind: annex.kind, cells: vec![hole], host: index + 1 });
    }
    pieces
}

/// Smallest remaining width next to a closet, metres.
const BESIDE_M: f32 = 1.4;

/// Positions an annex: closets at the hallway, rooms with windows at the outer wall.
fn corner(rng: &mut Rng, slot: &Rect, hall: Side, annex: &Annex) -> Rect {
    let span = hall.span(slot);
    let (width, depth) = (span[1] - span[0], slot.area_m2() / (span[1] - span[0]));
    let wanted = annex.area_m2 * rng.range(0.8, 1.3);
    let mut along = libm::sqrtf(wanted).max(NARROW_M).min(width);
    let rest = width - along;
    // Without enough width for standing next to it, the annex uses the whole width, off the hallway.
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

/// Positions two annexes: a column at a side of the slot, closets at the hallway.
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

/// Moves edges that nearly touch the edges of `slot` onto them.
fn snapped(slot: &Rect, rect: Rect) -> Rect {
    let snap = |value: f32, edges: [f32; 2]| {
        edges.into_iter().find(|edge| (edge - value).abs() < 0.02).unwrap_or(value)
    };
    Rect { x: rect.x.map(|value| snap(value, slot.x)), z: rect.z.map(|value| snap(value, slot.z)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn programmes_have_basic_rooms_within_limits() {
        for seed in 0..200 {
            let count = 4 + seed as usize % 19;
            let kinds = programme(&mut Rng::new(seed), count);
            assert_eq!(kinds.len(), count);
            let of = |kind: RoomKind| kinds.iter().filter(|other| **other == kind).count();
            assert!(of(Kitchen) == 1 && of(LivingRoom) >= 1, "{kinds:?}");
            assert!((1..=5).contains(&of(Bedroom)) && (1..=3).contains(&of(Bathroom)), "{kinds:?}");
            assert!(of(Garage) <= 1 && of(Closet) <= 3, "{kinds:?}");
            let units = units(&mut Rng::new(seed), &kinds);
            let rooms: usize = units.iter().map(|unit| 1 + unit.annexes.len()).sum();
            assert_eq!(rooms, count, "{units:?}");
            assert!(units.iter().any(|unit| unit.kind == Bathroom), "a bathroom from the hallway: {units:?}");
        }
    }
}
