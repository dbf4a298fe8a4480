//! Band levels of a clip over time.

use super::{Bands, LEVEL_BANDS};
use crate::clip::Clip;
use crate::measure::octave::{Octaves, power_share};

/// Samples per entry: 10 ms.
const HOP: usize = 160;

/// Band power of a repeated clip over time.
#[derive(Clone, Debug, PartialEq)]
pub struct ClipLevels {
    /// Band energy before each hop, with a final sentinel.
    before: Vec<[f64; LEVEL_BANDS]>,
    /// Clip length, samples.
    length: usize,
}

impl ClipLevels {
    /// Filters a clip: third-order octave filters without delay, 10 ms resolution.
    pub fn new(clip: &Clip) -> Self {
        let length = clip.samples.len();
        let octaves = Octaves::new(&clip.samples);
        let mut before = vec![[0.0; LEVEL_BANDS]; length.div_ceil(HOP) + 1];
        let squared: [_; LEVEL_BANDS] =
            std::array::from_fn(|band| octaves.squared(|frequency_hz| power_share(band, frequency_hz)));
        for hop in 0..before.len() - 1 {
            let samples = hop * HOP..((hop + 1) * HOP).min(length);
            let energy = |band: usize| squared[band][samples.clone()].iter().sum::<f64>();
            before[hop + 1] = std::array::from_fn(|band| before[hop][band] + energy(band));
        }
        Self { before, length }
    }

    /// Returns the mean band power of `count` samples, at least 1, from sample `start` of the repeated clip.
    pub(super) fn power(&self, start: usize, count: usize) -> Bands {
        if self.length == 0 {
            return Bands::default();
        }
        let (from, whole) = (self.energy_before(start), self.energy_before(self.length));
        let end = start % self.length + count;
        let to = self.energy_before(end);
        let turns = (end / self.length) as f64;
        std::array::from_fn(|band| ((to[band] + turns * whole[band] - from[band]) / count as f64) as f32)
    }

    /// Band energy from the clip's start to a sample, linear within a hop.
    fn energy_before(&self, sample: usize) -> [f64; LEVEL_BANDS] {
        let place = if sample == self.length { sample } else { sample % self.length };
        let hop = (place / HOP).min(self.before.len() - 2);
        let width = (self.length - hop * HOP).min(HOP);
        let share = (place - hop * HOP) as f64 / width as f64;
        let [low, high] = [&self.before[hop], &self.before[hop + 1]];
        std::array::from_fn(|band| low[band] + (high[band] - low[band]) * share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tone(samples: usize) -> ClipLevels {
        let sample = |n: usize| libm::sinf(std::f32::consts::TAU * 1000.0 * n as f32 / 16_000.0);
        ClipLevels::new(&Clip { name: "tone".to_owned(), samples: (0..samples).map(sample).collect() })
    }

    #[test]
    fn tone_power_is_in_its_octave() {
        let levels = tone(48_000);
        let power = levels.power(4000, 4000);
        assert!((power[3] - 0.5).abs() < 0.005, "{power:?}");
        assert!(power[2] < 0.01 && power[4] < 0.01, "{power:?}");
    }

    #[test]
    fn power_continues_at_the_clip_end() {
        let levels = tone(10_000);
        for start in [0, 7000, 9999, 10_000, 123_456] {
            let power = levels.power(start, 4000);
            assert!((power[3] - 0.5).abs() < 0.02, "{start}: {power:?}");
        }
        assert!((levels.power(3, 25_000)[3] - 0.5).abs() < 0.02);
    }
}
