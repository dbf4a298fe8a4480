//! The sense `ears`: levels and bearing evidence of a step's sound, without a waveform.

use avln_world::{LEVEL_BANDS, LevelMeter, Listener, Pose, Vector3};

/// Numbers of the sense: levels of both ears, interaural delay, direct sound, onset.
pub(crate) const NUMBERS: usize = 2 * LEVEL_BANDS + 3;

/// Level of silence, decibels re full scale: a root mean square of 1e-5.
const SILENCE_DB: f32 = -100.0;
/// Largest direct-to-reverberant ratio, either way, decibels.
const MOST_DIRECT_DB: f32 = 30.0;
/// Level rise of an onset, decibels.
const ONSET_DB: f32 = 6.0;

/// Levels at both ears during an episode.
pub(crate) struct EarLevels {
    meter: LevelMeter,
    height_m: f32,
    /// Level of the last step, both ears and all bands, decibels above silence.
    level_db: f32,
    numbers: [f32; NUMBERS],
}

impl EarLevels {
    /// Creates silent ears at this height above the base.
    pub(crate) fn new(meter: LevelMeter, height_m: f32) -> Self {
        Self { meter, height_m, level_db: 0.0, numbers: [0.0; NUMBERS] }
    }

    /// Hears a step at a pose; only source `sounding` plays.
    pub(crate) fn hear(&mut self, pose: &Pose, sounding: Option<usize>) {
        let position = pose.position + Vector3::y() * self.height_m;
        let listener = Listener { position, heading_rad: pose.heading_rad };
        let heard = self.meter.hear(&listener, sounding);
        let level_db = above_silence_db(0.5 * heard.power.as_flattened().iter().sum::<f32>());
        let is_onset = level_db >= self.level_db + ONSET_DB;
        self.level_db = level_db;
        self.numbers = [0.0; NUMBERS];
        if level_db == 0.0 {
            return;
        }
        for (number, power) in self.numbers.iter_mut().zip(heard.power.as_flattened()) {
            *number = above_silence_db(*power);
        }
        let first = heard.first.unwrap_or_default();
        let rest = [
            1e3 * first.lead_s,
            first.direct_db.clamp(-MOST_DIRECT_DB, MOST_DIRECT_DB),
            f32::from(u8::from(is_onset)),
        ];
        self.numbers[2 * LEVEL_BANDS..].copy_from_slice(&rest);
    }

    /// Returns the numbers of the last step.
    pub(crate) fn numbers(&self) -> &[f32; NUMBERS] {
        &self.numbers
    }
}

/// Converts a mean square to decibels above silence, at least 0.
fn above_silence_db(power: f32) -> f32 {
    let least = 1e-10;
    if power <= least { 0.0 } else { 10.0 * libm::log10f(power) - SILENCE_DB }
}
