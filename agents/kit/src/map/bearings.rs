//! Bearing memory: directions of sound by place of hearing.

use crate::geometry::{FloorPoint, Pose2d};
use crate::hearing::{HeardSound, bearings_rad};
use avln_client::nalgebra::Vector2;

/// Observations kept per goal.
const MOST: usize = 200;
/// Distance, metres, and cosine of the angle within which two observations are merged.
const MERGED_M: f32 = 0.25;
const MERGED_COS: f32 = 0.966;
/// Weight of a beam in explored space without a candidate.
const EXPLAINED: f32 = 0.2;
/// Distance between samples on a beam, metres.
const SAMPLE_M: f32 = 0.5;

/// The paper's bearing memory A_bear for one goal and storey: the set of (p, beta, rho).
///
/// Two ears cannot separate front from back: an observation has two beams, and its alignment is the better one. Other headings
/// and explored space decide between them.
#[derive(Clone, Debug, Default)]
pub struct BearingMemory {
    all: Vec<BearingObservation>,
}

#[derive(Clone, Copy, Debug)]
struct BearingObservation {
    place: FloorPoint,
    level: f32,
    step: u32,
    beams: [Beam; 2],
}

/// A unit vector on the floor plan, right and back, with the weight by the map, 0 to 1.
#[derive(Clone, Copy, Debug)]
struct Beam {
    direction: Vector2<f32>,
    weight: f32,
}

impl Beam {
    fn new(pose: &Pose2d, bearing_rad: f32) -> Self {
        let end = pose.offset(libm::cosf(bearing_rad), -libm::sinf(bearing_rad));
        Self { direction: end - pose.place, weight: 1.0 }
    }

    fn along(&self, from: FloorPoint, range_m: f32) -> FloorPoint {
        from + self.direction * range_m
    }

    /// Returns the cosine of the angle to the direction from one point to another.
    fn cosine(&self, from: FloorPoint, to: FloorPoint) -> f32 {
        self.direction.dot(&(to - from)) / from.distance_m(to).max(1e-3)
    }
}

impl BearingMemory {
    /// Adds an observation: A_bear(g) = A_bear(g) ∪ {(p, beta, rho)}. Close and almost equal observations are merged.
    pub fn hear(&mut self, pose: &Pose2d, heard: &HeardSound, step: u32) {
        let beams = bearings_rad(heard.itd_s).map(|bearing_rad| Beam::new(pose, bearing_rad));
        let observation = BearingObservation { place: pose.place, level: heard.level, step, beams };
        let is_same = |known: &BearingObservation| {
            let pairs = known.beams.iter().zip(&beams);
            known.place.distance_m(pose.place) <= MERGED_M
                && pairs.into_iter().all(|(a, b)| a.direction.dot(&b.direction) >= MERGED_COS)
        };
        self.all.retain(|known| !is_same(known));
        if self.all.len() >= MOST {
            self.all.remove(0);
        }
        self.all.push(observation);
    }

    /// Forgets all observations.
    pub fn clear(&mut self) {
        self.all.clear();
    }

    /// Returns true without any observation.
    pub fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    /// Weights every beam again after a change of the map: a beam that ends in unexplored space keeps its weight. `range_m`
    /// converts a level to a distance; `is_explained` returns true for explored positions without a candidate.
    pub fn weigh(&mut self, range_m: impl Fn(f32) -> f32, is_explained: impl Fn(FloorPoint) -> bool) {
        const FARTHEST_M: f32 = 10.0;
        for observation in &mut self.all {
            let far_m = range_m(observation.level).clamp(1.0, FARTHEST_M);
            let samples = (far_m / SAMPLE_M) as u32;
            for beam in &mut observation.beams {
                let points =
                    (1..=samples).map(|sample| beam.along(observation.place, sample as f32 * SAMPLE_M));
                let explained = points.filter(|&point| is_explained(point)).count() as f32;
                beam.weight = 1.0 - (1.0 - EXPLAINED) * explained / samples.max(1) as f32;
            }
        }
    }

    /// Returns s_aud(x, g), the alignment of a frontier with the memory, 0 to 1: the mean cosine between each observation's beam
    /// and the direction from its place to the frontier, weighted by level and age.
    pub fn alignment(&self, frontier: FloorPoint, step: u32, half_life_steps: f32) -> f32 {
        let (mut sum, mut all) = (0.0, 0.0);
        for observation in &self.all {
            let age = step.saturating_sub(observation.step) as f32 / half_life_steps;
            let weight = observation.level * libm::exp2f(-age);
            let beams = observation.beams.iter();
            let cosines = beams.map(|beam| beam.weight * beam.cosine(observation.place, frontier).max(0.0));
            sum += weight * cosines.fold(0.0, f32::max);
            all += weight;
        }
        if all > 0.0 { sum / all } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hearing::itd_s;
    use avln_client::Pose;

    fn pose(x: f32, heading_rad: f32) -> Pose2d {
        Pose2d::new(&Pose::new([x, 0.0, 0.0], heading_rad))
    }

    fn hear(memory: &mut BearingMemory, pose: &Pose2d, source: FloorPoint, step: u32) {
        memory.hear(pose, &HeardSound { itd_s: itd_s(pose.bearing_rad(source)), level: 0.1 }, step);
    }

    #[test]
    fn turns_resolve_front_and_back() {
        let (mut memory, source) = (BearingMemory::default(), FloorPoint::new(0.0, -5.0));
        hear(&mut memory, &pose(0.0, 0.4), source, 0);
        let alignment = |memory: &BearingMemory, z: f32| memory.alignment(FloorPoint::new(0.0, z), 1, 25.0);
        assert!(alignment(&memory, -3.0) > 0.95);
        hear(&mut memory, &pose(0.0, 1.2), source, 1);
        hear(&mut memory, &pose(0.0, -0.9), source, 1);
        assert!(alignment(&memory, -3.0) > 0.95 && alignment(&memory, 3.0) < 0.5, "{memory:?}");
    }

    #[test]
    fn older_sounds_count_less() {
        let mut memory = BearingMemory::default();
        hear(&mut memory, &pose(0.0, 0.0), FloorPoint::new(-5.0, 0.0), 0);
        hear(&mut memory, &pose(0.0, 0.0), FloorPoint::new(5.0, 0.0), 100);
        let left = memory.alignment(FloorPoint::new(-2.0, 0.0), 100, 25.0);
        let right = memory.alignment(FloorPoint::new(2.0, 0.0), 100, 25.0);
        assert!(right > 10.0 * left, "{left} {right}");
    }

    #[test]
    fn explored_beams_lose_weight() {
        let mut memory = BearingMemory::default();
        hear(&mut memory, &pose(0.0, 0.0), FloorPoint::new(0.0, -5.0), 0);
        let ahead = |memory: &BearingMemory| memory.alignment(FloorPoint::new(0.0, -3.0), 0, 25.0);
        let before = ahead(&memory);
        memory.weigh(|_| 6.0, |place| place.z < 0.0);
        assert!((ahead(&memory) - EXPLAINED * before).abs() < 1e-3);
        assert!(memory.alignment(FloorPoint::new(0.0, 3.0), 0, 25.0) > 0.95, "the mirrored beam remains");
    }

    #[test]
    fn observations_are_merged_and_limited() {
        let mut memory = BearingMemory::default();
        (0..9).for_each(|step| {
            hear(&mut memory, &pose(0.02 * step as f32, 0.0), FloorPoint::new(0.0, -50.0), step)
        });
        assert_eq!(memory.all.len(), 1);
        (0..999)
            .for_each(|step| hear(&mut memory, &pose(step as f32, 0.0), FloorPoint::new(0.0, -50.0), step));
        assert_eq!(memory.all.len(), MOST);
        memory.clear();
        assert!(memory.is_empty() && memory.alignment(FloorPoint::default(), 0, 25.0) == 0.0);
    }
}
