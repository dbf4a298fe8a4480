//! Energy decay curves.

use super::octave::bandwidth_hz;
use crate::SAMPLE_RATE_HZ;

/// Required decay below the fit range, decibels: a cut there moves the end of the range by 0.14 dB.
const BEYOND_DB: f64 = 15.0;

/// Smallest product of bandwidth and decay time distinguishable from the filter: a pulse has 10.8.
const LEAST_BANDWIDTH_TIME: f64 = 11.0;

/// Shortest plausible decay, seconds.
const LEAST_TIME_S: f64 = 0.02;

/// Remaining energy of a band over time.
pub(super) struct Decay {
    /// Decibels of the remaining energy relative to the total, per sample from the first wave.
    left_db: Vec<f64>,
    /// End of the response, seconds after the first wave.
    end_s: f64,
    least_time_s: f64,
}

impl Decay {
    /// The decay of the squared signals of both ears.
    pub(super) fn of(squared: &[Vec<f64>; 2], first_arrival_s: f64, length_s: f64, band: usize) -> Self {
        let samples = squared[0].len().max(squared[1].len());
        let at = |sample: usize| squared.iter().filter_map(|ear| ear.get(sample)).sum::<f64>();
        let mut left = vec![0.0; samples];
        let mut sum = 0.0;
        for sample in (0..samples).rev() {
            sum += at(sample);
            left[sample] = sum;
        }
        let first = ((first_arrival_s * f64::from(SAMPLE_RATE_HZ)).max(0.0) as usize).min(samples);
        let level_db = |energy: &f64| 10.0 * libm::log10(*energy / sum);
        let left_db = left[first..].iter().take_while(|energy| **energy > 0.0).map(level_db).collect();
        let least_time_s = (LEAST_BANDWIDTH_TIME / bandwidth_hz(band)).max(LEAST_TIME_S);
        Self { left_db, end_s: length_s - first_arrival_s, least_time_s }
    }

    /// Time for 60 dB on the line through the curve between two levels in decibels.
    pub(super) fn time_s(&self, from_db: f64, to_db: f64) -> Option<f64> {
        let first_below = |level_db: f64| self.left_db.iter().position(|db| *db < level_db);
        let start = if from_db < 0.0 { first_below(from_db)? } else { 0 };
        let end = first_below(to_db)?;
        let (level_db, slope_db_s) = line(self.left_db.get(start..end)?, start)?;
        let time_s = -60.0 / slope_db_s;
        let shown_s = (to_db - BEYOND_DB - level_db) / slope_db_s;
        (slope_db_s < 0.0 && time_s >= self.least_time_s && shown_s <= self.end_s).then_some(time_s)
    }
}

/// Least-squares line through `levels_db`, starting at sample `start`: level at time 0 and slope per second.
fn line(levels_db: &[f64], start: usize) -> Option<(f64, f64)> {
    let count = levels_db.len() as f64;
    let mean_time = start as f64 + (count - 1.0) / 2.0;
    let mean_db = levels_db.iter().sum::<f64>() / count;
    let (mut both, mut times) = (0.0, 0.0);
    for (offset, db) in levels_db.iter().enumerate() {
        let time = (start + offset) as f64 - mean_time;
        both += time * (db - mean_db);
        times += time * time;
    }
    let slope_db = both / times;
    (times > 0.0).then(|| (mean_db - slope_db * mean_time, slope_db * f64::from(SAMPLE_RATE_HZ)))
}
