//! Memory of sound: intensity by place, and the belief about a source's position.

use crate::geometry::{FloorPoint, Pose2d};
use crate::hearing::{HeardSound, sloped_itd_s};
use crate::map::occupancy::{Cell, Occupancy};
use crate::map::sound_field::{SIDE, SoundField, center};
use std::collections::BTreeMap;

/// Standard deviation of the delay, seconds: a constant, and per metre for cell size and incomplete map.
const ITD_SIGMA_S: f32 = 45e-6;
const ITD_SIGMA_PER_M_S: f32 = 8e-6;
/// Mean and deviation of the log ratio of expected and measured level: straight, and around corners.
const STRAIGHT: [f32; 2] = [0.0, 0.45];
const BENT: [f32; 2] = [1.2, 0.9];
/// Log-likelihood for furniture between a source and a listener without a wall between them.
const HIDDEN: f32 = -2.5;
/// Lower bounds for a sound's log-likelihood: by delay in view, by delay around corners, and by level.
const WORST_STRAIGHT: f32 = -6.0;
const WORST_BENT: f32 = -4.0;
const WORST_LEVEL: f32 = -4.0;
/// Weight per sound: errors in consecutive steps are correlated.
const WEIGHT: f32 = 0.25;
/// Decay of older evidence per sound: it was computed on an older map.
const KEPT: f32 = 0.97;
/// Range with full weight, metres: sound from a greater distance has passed corners.
const CLEAR_M: f32 = 3.0;
/// Log-priors for free floor and unseen cells, per metre outside the seen area, and per metre on the path.
const FREE: f32 = -1.5;
const UNKNOWN: f32 = -1.0;
const OUTSIDE_PER_M: f32 = -1.5;
const PER_M: f32 = -0.1;
/// Log-prior of cells near an unsuccessful Submit with a clear line to it, and their radius, metres.
const MISSED: f32 = -12.0;
const MISSED_M: f32 = 1.8;
/// Radius around the best cell whose probability mass is the certainty, metres.
const CERTAIN_M: f32 = 0.75;

/// A source's likelihood over the floor plan, accumulated from bearings and levels: an extension of the paper.
pub struct SourceBelief {
    scores: Vec<f32>,
}

/// A source's estimated position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SourceEstimate {
    /// Position.
    pub place: FloorPoint,
    /// Probability within 0.75 m around `place`, 0 to 1.
    pub certainty: f32,
}

impl Default for SourceBelief {
    fn default() -> Self {
        Self { scores: vec![0.0; SIDE * SIDE] }
    }
}

impl SourceBelief {
    /// Adds a sound, measured at `pose`; `field` belongs to the same position.
    pub fn hear(&mut self, field: &SoundField, pose: &Pose2d, heard: &HeardSound) {
        let clear = (CLEAR_M / range_m(heard.level)).min(1.0);
        // A distant sound has less weight, and displaces less of the older evidence in proportion.
        let (kept, weight) = (libm::powf(KEPT, clear), WEIGHT * clear);
        for (index, score) in self.scores.iter_mut().enumerate() {
            let said = field.ray(index).map_or(WORST_BENT + WORST_LEVEL, |ray| {
                let sigma_s = ITD_SIGMA_S + ITD_SIGMA_PER_M_S * ray.length_m;
                let delay_s = sloped_itd_s(pose.bearing_rad(ray.from), ray.length_m);
                let late = (delay_s - heard.itd_s) / sigma_s;
                let loss = libm::logf(expected_level(ray.length_m.max(0.2)) / heard.level.max(1e-6));
                let (level, worst) = if field.is_straight(index) {
                    (bell(loss, STRAIGHT).max(bell(loss, BENT) + HIDDEN), WORST_STRAIGHT)
                } else {
                    (bell(loss, BENT), WORST_BENT)
                };
                (-0.5 * late * late).max(worst) + level.max(WORST_LEVEL)
            });
            *score = kept * *score + weight * said;
        }
    }

    /// Returns the best position in view of the map; `None` if sound reaches no cell.
    pub fn estimate(
        &self,
        field: &SoundField,
        map: &Occupancy,
        missed: &[FloorPoint],
    ) -> Option<SourceEstimate> {
        let is_missed = |place: FloorPoint| {
            missed.iter().any(|&from| from.distance_m(place) <= MISSED_M && map.has_clear_line(from, place))
        };
        let top = self.scores.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        // Cells below e^-8 of the best score cannot change the estimate; skipping them saves most of the work.
        let plausible = self.scores.iter().enumerate().filter(|(_, score)| **score > top - 8.0);
        let weighed: Vec<(FloorPoint, f32)> = plausible
            .filter_map(|(index, score)| {
                let place = center(index);
                let prior = match Cell::at(place) {
                    cell if map.is_free(cell) => FREE,
                    cell if map.is_unknown(cell) => UNKNOWN,
                    _ => 0.0,
                };
                let prior = prior + if is_missed(place) { MISSED } else { 0.0 };
                let prior = prior + OUTSIDE_PER_M * map.outside_m(place);
                Some((place, libm::expf(score - top + prior + PER_M * field.ray(index)?.length_m)))
            })
            .collect();
        let (best, _) = *weighed.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        // The mean around the best cell is finer than the cells.
        let (mut mass, mut x, mut z) = (0.0, 0.0, 0.0);
        for (place, weight) in weighed.iter().filter(|(place, _)| place.distance_m(best) <= CERTAIN_M) {
            (mass, x, z) = (mass + weight, x + weight * place.x, z + weight * place.z);
        }
        let total: f32 = weighed.iter().map(|(_, weight)| weight).sum();
        Some(SourceEstimate { place: FloorPoint::new(x / mass, z / mass), certainty: mass / total })
    }
}

/// Returns the logarithm for a unit Gaussian.
fn bell(value: f32, [mean, sigma]: [f32; 2]) -> f32 {
    let off = (value - mean) / sigma;
    -0.5 * off * off
}

const MEMORY_CELL_M: f32 = 0.5;
/// Number of loudest cells in an estimate.
const ASKED: usize = 3;
/// Standard deviation for the log range at a level.
const SPREAD: f32 = 0.8;

/// The paper's intensity memory A_int for one storey: the highest level by position.
#[derive(Clone, Debug, Default)]
pub struct IntensityMemory {
    cells: BTreeMap<(i32, i32), LoudestSound>,
}

#[derive(Clone, Copy, Debug)]
struct LoudestSound {
    level: f32,
    place: FloorPoint,
}

impl IntensityMemory {
    /// Adds a level at a position: A(x) = max(A(x), level).
    pub fn hear(&mut self, place: FloorPoint, level: f32) {
        let cell = |coordinate: f32| (coordinate / MEMORY_CELL_M).floor() as i32;
        let heard = self.cells.entry((cell(place.x), cell(place.z))).or_insert(LoudestSound { level, place });
        if level > heard.level {
            *heard = LoudestSound { level, place };
        }
    }

    /// Returns the highest level; 0 without sound.
    pub fn loudest(&self) -> f32 {
        self.cells.values().map(|heard| heard.level).fold(0.0, f32::max)
    }

    /// Returns the support for a source at a point, 0 to 1: `reach_m` relative to the range by the highest level heard within
    /// `reach_m` metres of it; 0 if nothing was heard there.
    pub fn nearness(&self, distance_m: impl Fn(FloorPoint) -> f32, reach_m: f32) -> f32 {
        let near = self.cells.values().filter(|heard| distance_m(heard.place) <= reach_m);
        let level = near.map(|heard| heard.level).reduce(f32::max);
        level.map_or(0.0, |level| (reach_m / range_m(level)).min(1.0))
    }

    /// Returns a source's support by the loudest cells, 0 to 1: a Gaussian over log range by level to distance.
    pub fn supports(&self, distance_m: impl Fn(FloorPoint) -> f32) -> f32 {
        let mut loud: Vec<&LoudestSound> = self.cells.values().collect();
        loud.sort_by(|a, b| b.level.total_cmp(&a.level));
        loud.truncate(ASKED);
        let fits = loud.iter().map(|heard| {
            let range_m = range_m(heard.level).max(MEMORY_CELL_M);
            let off = libm::logf(range_m / distance_m(heard.place).max(MEMORY_CELL_M)) / SPREAD;
            libm::expf(-0.5 * off * off)
        });
        fits.sum::<f32>() / loud.len().max(1) as f32
    }
}

/// Distance, metres, and level relative to [`LEVEL_AT_1_M`] for a visible source: geometric means over twenty
/// missions in ten furnished training houses.
const CURVE: [[f32; 2]; 8] =
    [[0.5, 3.4], [1.25, 2.0], [2.25, 1.55], [3.25, 1.3], [4.5, 0.8], [7.0, 0.3], [9.5, 0.17], [15.0, 0.06]];
/// Free-field level at 1 m.
const LEVEL_AT_1_M: f32 = 0.05;

/// Returns the expected level for a visible source at `distance_m`.
pub fn expected_level(distance_m: f32) -> f32 {
    let logs = CURVE.map(|[distance_m, level]| [libm::logf(distance_m), libm::logf(level)]);
    LEVEL_AT_1_M * libm::expf(between(&logs, libm::logf(distance_m.max(0.05))))
}

/// Returns the expected distance for a level, metres, 0.1 to 100.
pub fn range_m(level: f32) -> f32 {
    let mut logs = CURVE.map(|[distance_m, level]| [libm::logf(level), libm::logf(distance_m)]);
    logs.reverse();
    libm::expf(between(&logs, libm::logf(level.max(1e-6) / LEVEL_AT_1_M))).clamp(0.1, 100.0)
}

/// Interpolates linearly between points of rising x, and extrapolates by the first and last segment.
fn between<const N: usize>(points: &[[f32; 2]; N], x: f32) -> f32 {
    let passed = points[1..N - 1].iter().take_while(|[px, _]| *px < x).count();
    let ([x0, y0], [x1, y1]) = (points[passed], points[passed + 1]);
    y0 + (y1 - y0) * (x - x0) / (x1 - x0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_client::Pose;

    const AREA: [FloorPoint; 2] = [FloorPoint { x: -8.0, z: -8.0 }, FloorPoint { x: 8.0, z: 8.0 }];

    fn heard_from(pose: &Pose2d, source: FloorPoint) -> HeardSound {
        let distance_m = pose.place.distance_m(source);
        let itd_s = sloped_itd_s(pose.bearing_rad(source), distance_m);
        let level = expected_level(distance_m);
        HeardSound { itd_s, level }
    }

    #[test]
    fn bearings_locate_the_source() {
        for source in [FloorPoint::new(3.0, -4.0), FloorPoint::new(-2.0, 5.0), FloorPoint::new(0.5, 1.5)] {
            let (mut belief, mut field) = (SourceBelief::default(), None);
            for step in 0..24 {
                let heading_rad = step as f32 * 30_f32.to_radians();
                let position = [0.1 * step as f32, 0.0, -0.05 * step as f32];
                let pose = Pose2d::new(&Pose::new(position, heading_rad));
                let spread = SoundField::new(&Occupancy::default(), pose.place, AREA);
                belief.hear(&spread, &pose, &heard_from(&pose, source));
                field = Some(spread);
            }
            let found = belief.estimate(&field.unwrap(), &Occupancy::default().with_area(AREA), &[]).unwrap();
            assert!(found.place.distance_m(source) < 0.4, "{found:?} for {source:?}");
            assert!(found.certainty > 0.3, "{found:?}");
        }
    }

    #[test]
    fn one_heading_is_front_back_ambiguous() {
        let mut belief = SourceBelief::default();
        let pose = Pose2d::new(&Pose::default());
        let field = SoundField::new(&Occupancy::default(), pose.place, AREA);
        (0..4).for_each(|_| belief.hear(&field, &pose, &heard_from(&pose, FloorPoint::new(0.0, -4.0))));
        assert!(belief.estimate(&field, &Occupancy::default().with_area(AREA), &[]).unwrap().certainty < 0.5);
        let ahead = [FloorPoint::new(-7.9, -7.9), FloorPoint::new(7.9, -0.1)];
        let map = Occupancy::default().with_area(AREA).with_floor(ahead[0], ahead[1]);
        let behind = belief.estimate(&field, &map, &[]).unwrap();
        assert!(behind.place.z > 2.0, "{behind:?}");
    }

    #[test]
    fn unsuccessful_submits_exclude_nearby_sources() {
        let (mut belief, map) = (SourceBelief::default(), Occupancy::default().with_area(AREA));
        let pose = Pose2d::new(&Pose::default());
        let field = SoundField::new(&map, pose.place, AREA);
        belief.hear(&field, &pose, &heard_from(&pose, FloorPoint::new(-1.5, 0.0)));
        let before = belief.estimate(&field, &map, &[]).unwrap().place;
        assert!(before.distance_m(FloorPoint::new(-1.5, 0.0)) < 0.4, "{before:?}");
        let after = belief.estimate(&field, &map, &[pose.place]).unwrap().place;
        assert!(after.distance_m(pose.place) > MISSED_M - 0.2, "{after:?}");
    }

    #[test]
    fn cells_keep_their_highest_level() {
        let mut memory = IntensityMemory::default();
        assert_eq!((memory.loudest(), memory.supports(|_| 1.0)), (0.0, 0.0));
        memory.hear(FloorPoint::new(0.1, 0.1), 0.025);
        memory.hear(FloorPoint::new(0.2, 0.1), 0.01);
        assert!(memory.cells.len() == 1 && memory.loudest() == 0.025);
        memory.hear(FloorPoint::new(0.9, 0.1), 0.05);
        assert!(memory.cells.len() == 2 && memory.loudest() == 0.05);
    }

    #[test]
    fn loud_positions_support_sources_nearby() {
        let mut memory = IntensityMemory::default();
        let nearness = |memory: &IntensityMemory, x: f32| memory.nearness(|place| (place.x - x).abs(), 1.0);
        assert_eq!(nearness(&memory, 0.0), 0.0);
        memory.hear(FloorPoint::new(0.0, 0.0), expected_level(0.8));
        memory.hear(FloorPoint::new(4.0, 0.0), expected_level(4.0));
        assert_eq!((nearness(&memory, 0.5), nearness(&memory, 9.0)), (1.0, 0.0));
        assert!((nearness(&memory, 4.0) - 0.25).abs() < 1e-3);
    }

    #[test]
    fn intensity_supports_matching_distances() {
        let mut memory = IntensityMemory::default();
        // A source at (3, 0).
        memory.hear(FloorPoint::new(1.0, 0.0), expected_level(2.0));
        memory.hear(FloorPoint::new(2.0, 0.0), expected_level(1.0));
        let supports = |x: f32| memory.supports(|place| place.distance_m(FloorPoint::new(x, 0.0)));
        assert!((supports(3.0) - 1.0).abs() < 1e-4);
        // At (5, 0): ln(2 / 4) and ln(1 / 3) in spreads of 0.8 are -0.866 and -1.373.
        assert!((supports(5.0) - 0.5 * (0.687 + 0.390)).abs() < 1e-2, "{}", supports(5.0));
    }

    #[test]
    fn range_inverts_level() {
        for distance_m in [0.4, 0.75, 2.0, 3.5, 6.0, 12.0, 30.0] {
            let told_m = range_m(expected_level(distance_m));
            assert!((told_m / distance_m - 1.0).abs() < 1e-3, "{distance_m}: {told_m}");
        }
        assert!((expected_level(4.5) - 0.04).abs() < 1e-6 && range_m(0.0) == 100.0 && range_m(9.0) == 0.1);
    }

    #[test]
    fn level_falls_with_distance() {
        let levels: Vec<f32> = (1..80).map(|quarter| expected_level(0.25 * quarter as f32)).collect();
        assert!(levels.is_sorted_by(|a, b| a > b), "{levels:?}");
    }
}
