//! Sound levels at two ears, from the energy of the arriving waves: no impulse response, no convolution.

mod clip;
mod waves;

pub use clip::ClipLevels;

use crate::SAMPLE_RATE_HZ;
use crate::ears::Emitter;
use crate::impulse::Listener;
use crate::surfaces::SURFACE_BANDS;
use std::collections::VecDeque;
use std::sync::Arc;
use waves::{ResponseEnergy, Waves};

/// Octave bands of levels: 125, 250, 500, 1000, 2000 and 4000 Hz.
pub const LEVEL_BANDS: usize = SURFACE_BANDS;

/// A number per octave band.
pub(crate) type Bands = [f32; LEVEL_BANDS];

/// The sound of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HeardLevels {
    /// Mean square pressure by ear, left first, and octave band.
    pub power: [[f32; LEVEL_BANDS]; 2],
    /// Direct sound of the sounding source; `None` in silence, or without a path.
    pub first: Option<FirstSound>,
}

/// Direct sound: the waves until 2.5 ms after the first wave through the air.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FirstSound {
    /// Interaural delay, seconds; positive if the left ear leads. Mean over the waves, weighted by energy.
    pub lead_s: f32,
    /// Energy of the direct sound relative to the rest, decibels: both ears, octaves 500 to 2000 Hz.
    pub direct_db: f32,
}

/// A meter for the levels of [`Ears`](crate::Ears), step by step.
///
/// The power of a step is the sum over all sources and the steps before, within a response length: the clip's power in that step
/// times the response's energy at this delay. Phases and the fades of the first milliseconds are neglected.
pub struct LevelMeter {
    emitters: Vec<MeteredEmitter>,
    samples_per_step: usize,
    steps: usize,
}

/// An emitter with its recent sound.
struct MeteredEmitter {
    emitter: Emitter,
    levels: Arc<ClipLevels>,
    /// Emitted power by step, newest first.
    emitted: VecDeque<Bands>,
    waves: Option<Waves>,
    response: Option<ResponseEnergy>,
}

impl LevelMeter {
    /// Creates a meter at time 0. `levels` has an entry per emitter; `samples_per_step` is at least 1.
    pub fn new(emitters: Vec<(Emitter, Arc<ClipLevels>)>, samples_per_step: usize) -> Self {
        let metered = |(emitter, levels)| MeteredEmitter {
            emitter,
            levels,
            emitted: VecDeque::new(),
            waves: None,
            response: None,
        };
        let emitters = emitters.into_iter().map(metered).collect();
        Self { emitters, samples_per_step: samples_per_step.max(1), steps: 0 }
    }

    /// Returns the levels of the next step. `listener` is the pose during the whole step; only emitter `sounding` plays.
    pub fn hear(&mut self, listener: &Listener, sounding: Option<usize>) -> HeardLevels {
        let mut heard = HeardLevels::default();
        let start = self.steps * self.samples_per_step;
        for (index, emitter) in self.emitters.iter_mut().enumerate() {
            let sounds = sounding == Some(index);
            if !emitter.feed(start, self.samples_per_step, sounds) {
                continue;
            }
            let response = emitter.response_at(listener, self.samples_per_step);
            if sounds {
                heard.first = response.first;
            }
            emitter.add_power(&mut heard.power);
        }
        self.steps += 1;
        heard
    }
}

impl MeteredEmitter {
    /// Appends a step; returns false in silence.
    fn feed(&mut self, start: usize, count: usize, sounds: bool) -> bool {
        let place = self.emitter.offset_samples.wrapping_add(start);
        self.emitted.push_front(if sounds { self.levels.power(place, count) } else { Bands::default() });
        self.emitted.truncate(self.emitter.source.response_samples().div_ceil(count) + 1);
        let is_silent = self.emitted.iter().flatten().all(|power| *power == 0.0);
        if is_silent {
            (self.waves, self.response) = (None, None);
        }
        !is_silent
    }

    /// Returns the response at a pose; that of the last sound for a source that only rings, as the ears do.
    fn response_at(&mut self, listener: &Listener, count: usize) -> &ResponseEnergy {
        let only_rings = self.emitted.iter().take(2).flatten().all(|power| *power == 0.0);
        let known = self.response.take().filter(|known| only_rings || known.listener == *listener);
        let response = known.unwrap_or_else(|| {
            let step_s = count as f32 / SAMPLE_RATE_HZ as f32;
            let near = self.waves.take().filter(|waves| waves.place == listener.position);
            let waves = near.unwrap_or_else(|| Waves::new(&self.emitter.source, &listener.position, step_s));
            let waves = self.waves.insert(waves);
            waves.response(self.emitter.source.head(), listener)
        });
        self.response.insert(response)
    }

    fn add_power(&self, power: &mut [Bands; 2]) {
        let Some(response) = &self.response else { return };
        for (emitted, energies) in self.emitted.iter().zip(&response.by_step) {
            for (ear, energy) in power.iter_mut().zip(energies) {
                for band in 0..LEVEL_BANDS {
                    ear[band] += emitted[band] * energy[band];
                }
            }
        }
    }
}
