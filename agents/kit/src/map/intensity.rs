use crate::map::range_m;
use crate::perception::Place;
use std::collections::BTreeMap;

/// Side of a cell of the memory, metres.
const CELL_M: f32 = 0.5;
/// Loudest cells that are asked.
const ASKED: usize = 3;
/// Spread of the logarithm of the range that a level tells.
const SPREAD: f32 = 0.8;

/// The intensity memory A_int of the paper, for one source: the loudest that it was heard at each place.
#[derive(Clone, Debug, Default)]
pub struct Intensity {
    cells: BTreeMap<(i32, i32), Heard>,
}

#[derive(Clone, Copy, Debug)]
struct Heard {
    level: f32,
    place: Place,
}

impl Intensity {
    /// The source was heard this loud at a place: A(x) = max(A(x), level).
    pub fn hear(&mut self, place: Place, level: f32) {
        let cell = |coordinate: f32| (coordinate / CELL_M).floor() as i32;
        let heard = self.cells.entry((cell(place.x), cell(place.z))).or_insert(Heard { level, place });
        if level > heard.level {
            *heard = Heard { level, place };
        }
    }

    /// The loudest of all places; 0 when nothing was heard.
    pub fn loudest(&self) -> f32 {
        self.cells.values().map(|heard| heard.level).fold(0.0, f32::max)
    }

    /// How well a source `distance_m` away from each place explains how loud it was there, 0 to 1: the mean over the
    /// loudest places of a bell over the logarithm of the ratio of the range that the level tells and the distance.
    pub fn supports(&self, distance_m: impl Fn(Place) -> f32) -> f32 {
        let mut loud: Vec<&Heard> = self.cells.values().collect();
        loud.sort_by(|a, b| b.level.total_cmp(&a.level));
        loud.truncate(ASKED);
        let fits = loud.iter().map(|heard| {
            let range_m = range_m(heard.level).max(CELL_M);
            let off = (range_m / distance_m(heard.place).max(CELL_M)).ln() / SPREAD;
            (-0.5 * off * off).exp()
        });
        fits.sum::<f32>() / loud.len().max(1) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::expected_level;

    #[test]
    fn each_place_keeps_its_loudest() {
        let mut memory = Intensity::default();
        assert_eq!((memory.loudest(), memory.supports(|_| 1.0)), (0.0, 0.0));
        memory.hear(Place::new(0.1, 0.1), 0.025);
        memory.hear(Place::new(0.2, 0.1), 0.01);
        assert!(memory.cells.len() == 1 && memory.loudest() == 0.025);
        memory.hear(Place::new(0.9, 0.1), 0.05);
        assert!(memory.cells.len() == 2 && memory.loudest() == 0.05);
    }

    #[test]
    fn what_stands_where_the_level_says_is_supported() {
        let mut memory = Intensity::default();
        // A source at (3, 0).
        memory.hear(Place::new(1.0, 0.0), expected_level(2.0));
        memory.hear(Place::new(2.0, 0.0), expected_level(1.0));
        let supports = |x: f32| memory.supports(|place| place.distance_m(Place::new(x, 0.0)));
        assert!((supports(3.0) - 1.0).abs() < 1e-4);
        // At (5, 0): ln(2 / 4) and ln(1 / 3) in spreads of 0.8 are -0.866 and -1.373.
        assert!((supports(5.0) - 0.5 * (0.687 + 0.390)).abs() < 1e-2, "{}", supports(5.0));
    }
}
