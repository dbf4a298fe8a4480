use super::sound::{SIDE, SoundField, center};
use super::{Cell, Occupancy, expected_level, range_m};
use crate::perception::{Heard, Place, Stand, sloped_itd_s};

/// Spread of the measured delay, seconds: its own error, and what is added per metre since places are only cells and
/// maps only known in part.
const ITD_SIGMA_S: f32 = 45e-6;
const ITD_SIGMA_PER_M_S: f32 = 8e-6;
/// Mean and spread of the logarithm of the expected level by the one that is heard: straight ways, and ways around corners,
/// which take level away, however short the detour is.
const STRAIGHT: [f32; 2] = [0.0, 0.45];
const BENT: [f32; 2] = [1.2, 0.9];
/// What speaks against furniture hiding a source to which no wall bars the way.
const HIDDEN: f32 = -2.5;
/// Worst that the delay of one sound can say against a place in sight and against one around a corner, and its level against
/// either, in units of log-likelihood.
const WORST_STRAIGHT: f32 = -6.0;
const WORST_BENT: f32 = -4.0;
const WORST_LEVEL: f32 = -4.0;
/// Weight of one sound: sounds of neighbouring steps err alike.
const WEIGHT: f32 = 0.25;
/// What is kept of older evidence at each sound: it was judged by an older map.
const KEPT: f32 = 0.97;
/// Range up to which a sound has its full weight, metres: what comes from farther has been around corners.
const CLEAR_M: f32 = 3.0;
/// What speaks against a place where the floor has been seen free, where nothing has been seen, per
/// metre outside of the rectangle of all that has been seen, and per metre of way.
const FREE: f32 = -1.5;
const UNKNOWN: f32 = -1.0;
const OUTSIDE_PER_M: f32 = -1.5;
const PER_M: f32 = -0.1;
/// What a Submit that found nothing says against the places around it that can be seen from there, and how far, metres.
const MISSED: f32 = -12.0;
const MISSED_M: f32 = 1.8;
/// Mass within this distance of the best place is what is called certain, metres.
const CERTAIN_M: f32 = 0.75;

/// Where one source may be: a likelihood over the floor plan, accumulated from bearings and levels (the bearing memory
/// of the paper).
pub struct SourceBelief {
    scores: Vec<f32>,
}

/// The best guess about a source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Where it is believed to be.
    pub place: Place,
    /// Probability that it is within 0.75 m of `place`, 0 to 1.
    pub certainty: f32,
}

impl Default for SourceBelief {
    fn default() -> Self {
        Self { scores: vec![0.0; SIDE * SIDE] }
    }
}

impl SourceBelief {
    /// Adds one sound of the source, heard at `stand`, from where `field` spreads.
    pub fn hear(&mut self, field: &SoundField, stand: &Stand, heard: &Heard) {
        let clear = (CLEAR_M / range_m(heard.level)).min(1.0);
        let (kept, weight) = (KEPT.powf(clear), WEIGHT * clear);
        for (index, score) in self.scores.iter_mut().enumerate() {
            let said = field.ray(index).map_or(WORST_BENT + WORST_LEVEL, |ray| {
                let sigma_s = ITD_SIGMA_S + ITD_SIGMA_PER_M_S * ray.length_m;
                let delay_s = sloped_itd_s(stand.bearing_rad(ray.from), ray.length_m);
                let late = (delay_s - heard.itd_s) / sigma_s;
                let loss = (expected_level(ray.length_m.max(0.2)) / heard.level.max(1e-6)).ln();
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

    /// The best place by all that was heard, in view of what is known of the map; `None` when sound reaches nothing.
    pub fn estimate(&self, field: &SoundField, map: &Occupancy, missed: &[Place]) -> Option<Estimate> {
        let is_missed = |place: Place| {
            missed.iter().any(|&from| from.distance_m(place) <= MISSED_M && map.hears(from, place))
        };
        let top = self.scores.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let plausible = self.scores.iter().enumerate().filter(|(_, score)| **score > top - 8.0);
        let weighed: Vec<(Place, f32)> = plausible
            .filter_map(|(index, score)| {
                let place = center(index);
                let prior = match Cell::at(place) {
                    cell if map.is_free(cell) => FREE,
                    cell if map.is_unknown(cell) => UNKNOWN,
                    _ => 0.0,
                };
                let prior = prior + if is_missed(place) { MISSED } else { 0.0 };
                let prior = prior + OUTSIDE_PER_M * map.outside_m(place);
                Some((place, (score - top + prior + PER_M * field.ray(index)?.length_m).exp()))
            })
            .collect();
        let (best, _) = *weighed.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let (mut mass, mut x, mut z) = (0.0, 0.0, 0.0);
        for (place, weight) in weighed.iter().filter(|(place, _)| place.distance_m(best) <= CERTAIN_M) {
            (mass, x, z) = (mass + weight, x + weight * place.x, z + weight * place.z);
        }
        let total: f32 = weighed.iter().map(|(_, weight)| weight).sum();
        Some(Estimate { place: Place::new(x / mass, z / mass), certainty: mass / total })
    }
}

/// Logarithm of a bell curve of height 1.
fn bell(value: f32, [mean, sigma]: [f32; 2]) -> f32 {
    let off = (value - mean) / sigma;
    -0.5 * off * off
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_client::Pose;

    const AREA: [Place; 2] = [Place { x: -8.0, z: -8.0 }, Place { x: 8.0, z: 8.0 }];

    fn heard_from(stand: &Stand, source: Place) -> Heard {
        let distance_m = stand.place.distance_m(source);
        let itd_s = sloped_itd_s(stand.bearing_rad(source), distance_m);
        let level = expected_level(distance_m);
        Heard { itd_s, level }
    }

    #[test]
    fn bearings_from_several_headings_and_places_find_the_source() {
        for source in [Place::new(3.0, -4.0), Place::new(-2.0, 5.0), Place::new(0.5, 1.5)] {
            let (mut belief, mut field) = (SourceBelief::default(), None);
            for step in 0..24 {
                let heading_rad = step as f32 * 30_f32.to_radians();
                let position = [0.1 * step as f32, 0.0, -0.05 * step as f32];
                let stand = Stand::new(&Pose { position, heading_rad });
                let spread = SoundField::new(&Occupancy::default(), stand.place, AREA);
                belief.hear(&spread, &stand, &heard_from(&stand, source));
                field = Some(spread);
            }
            let found = belief.estimate(&field.unwrap(), &Occupancy::default().with_area(AREA), &[]).unwrap();
            assert!(found.place.distance_m(source) < 0.4, "{found:?} for {source:?}");
            assert!(found.certainty > 0.3, "{found:?}");
        }
    }

    #[test]
    fn one_heading_leaves_front_and_back_open() {
        let mut belief = SourceBelief::default();
        let stand = Stand::new(&Pose::default());
        let field = SoundField::new(&Occupancy::default(), stand.place, AREA);
        (0..4).for_each(|_| belief.hear(&field, &stand, &heard_from(&stand, Place::new(0.0, -4.0))));
        assert!(belief.estimate(&field, &Occupancy::default().with_area(AREA), &[]).unwrap().certainty < 0.5);
        let ahead = [Place::new(-7.9, -7.9), Place::new(7.9, -0.1)];
        let map = Occupancy::default().with_area(AREA).with_floor(ahead[0], ahead[1]);
        let behind = belief.estimate(&field, &map, &[]).unwrap();
        assert!(behind.place.z > 2.0, "{behind:?}");
    }

    #[test]
    fn it_is_not_where_it_was_sought_in_vain() {
        let (mut belief, map) = (SourceBelief::default(), Occupancy::default().with_area(AREA));
        let stand = Stand::new(&Pose::default());
        let field = SoundField::new(&map, stand.place, AREA);
        belief.hear(&field, &stand, &heard_from(&stand, Place::new(-1.5, 0.0)));
        let before = belief.estimate(&field, &map, &[]).unwrap().place;
        assert!(before.distance_m(Place::new(-1.5, 0.0)) < 0.4, "{before:?}");
        let after = belief.estimate(&field, &map, &[stand.place]).unwrap().place;
        assert!(after.distance_m(stand.place) > MISSED_M - 0.2, "{after:?}");
    }
}
