//! Room programme: kinds, sizes and groups.

use super::RoomKind::{self, *};
use avln_geom::Rng;

/// A room at the hallway with small rooms in its corners.
#[derive(Clone, Debug)]
pub(super) struct Unit {
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

impl Unit {
    /// Floor area with all annexes.
    pub(super) fn total_m2(&self) -> f32 {
        self.area_m2 + self.annexes.iter().map(|annex| annex.area_m2).sum::<f32>()
    }
}

/// Largest number per kind, and the probability of the next.
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

/// The uses of `count` rooms, passages not counted. Every house of four or more has the four basic ones.
pub(super) fn programme(rng: &mut Rng, count: usize) -> Vec<RoomKind> {
    let mut kinds = vec![LivingRoom, Kitchen, Bedroom, Bathroom];
    kinds.truncate(count);
    while kinds.len() < count {
        let weights =
            EXTRAS.map(|(kind, most, weight)| if allowed(&kinds, kind, most) { weight } else { 0.0 });
        let mut left = rng.range(0.0, weights.iter().sum());
        let drawn = weights.iter().position(|weight| {
            left -= weight;
            left < 0.0
        });
        kinds.push(drawn.map_or(Bedroom, |index| EXTRAS[index].0));
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

/// Floor area that a room should have, square metres (after Infinigen Indoors' targets, bedrooms smaller).
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

/// Rooms smaller than this keep their size when a house is made smaller, square metres.
const SMALL_M2: f32 = 9.5;

/// Puts closets and some bathrooms, laundries and utility rooms into the corners of larger rooms.
pub(super) fn units(rng: &mut Rng, kinds: &[RoomKind]) -> Vec<Unit> {
    let mut units: Vec<Unit> = Vec::new();
    let (small, large): (Vec<RoomKind>, Vec<RoomKind>) =
        kinds.iter().partition(|kind| matches!(kind, Closet | Bathroom | Laundry | Utility));
    for kind in large {
        let area_m2 = area_m2(rng, kind);
        units.push(Unit { kind, area_m2, annexes: vec![] });
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
            None => units.push(Unit { kind, area_m2, annexes: vec![] }),
        }
    }
    units
}

/// The best host for a small room.
fn host(units: &mut [Unit], kind: RoomKind) -> Option<&mut Unit> {
    let hosts: &[RoomKind] = match kind {
        Closet => &[Bedroom, Office, Gym, GameRoom],
        Bathroom => &[Bedroom],
        _ => &[Garage, Kitchen],
    };
    let has = |unit: &Unit| unit.annexes.iter().any(|annex| annex.kind == kind);
    let free =
        units.iter_mut().filter(|unit| hosts.contains(&unit.kind) && !has(unit) && unit.annexes.len() < 2);
    free.min_by_key(|unit| (hosts.iter().position(|host| *host == unit.kind), unit.annexes.len()))
}

/// Makes the larger rooms smaller so that all of them together take at most `most_m2`.
pub(super) fn fit(units: &mut [Unit], most_m2: f32) {
    let small = |unit: &Unit| unit.area_m2 <= SMALL_M2;
    let annexes: f32 = units.iter().map(|unit| unit.total_m2() - unit.area_m2).sum();
    let fixed: f32 = annexes + units.iter().filter(|unit| small(unit)).map(|unit| unit.area_m2).sum::<f32>();
    let rest: f32 = units.iter().filter(|unit| !small(unit)).map(|unit| unit.area_m2).sum();
    let factor = ((most_m2 - fixed) / rest.max(1.0)).clamp(0.6, 1.0);
    for unit in units.iter_mut().filter(|unit| !small(unit)) {
        unit.area_m2 = (unit.area_m2 * factor).max(SMALL_M2);
    }
}

/// Divides the rooms between two storeys: public and noisy rooms below, bedrooms above.
pub(super) fn by_storey(rng: &mut Rng, units: Vec<Unit>) -> [Vec<Unit>; 2] {
    let total: f32 = units.iter().map(Unit::total_m2).sum();
    let mut bathrooms = 0;
    let mut ranked: Vec<(f32, Unit)> = Vec::new();
    for unit in units {
        bathrooms += usize::from(unit.kind == Bathroom);
        let height = match unit.kind {
            Garage | Kitchen | LivingRoom | DiningRoom => 0.0,
            Laundry | Utility => 0.3,
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
        let below = below_m2 + unit.total_m2() / 2.0 < 0.52 * total;
        below_m2 += if below { unit.total_m2() } else { 0.0 };
        storeys[usize::from(!below)].push(unit);
    }
    storeys
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn programmes_have_the_basic_rooms_and_keep_the_limits() {
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
