//! Sound levels at two ears, from the energy of the arriving waves: no impulse response, no convolution.

use crate::clip::Clip;
use crate::ears::Emitter;
use crate::head::Head;
use crate::head::filter::FAR_M;
use crate::impulse::{Arrival, Listener};
use crate::late::cells::{Slice, middle_s};
use crate::late::tail::{DIRECTED, GROUP, directed_share};
use crate::measure::MIDDLE;
use crate::measure::octave::{Octaves, power_share};
use crate::source::Source;
use crate::surfaces::SURFACE_BANDS;
use crate::{SAMPLE_RATE_HZ, SPEED_OF_SOUND_M_S};
use avln_geom::{Point3, Vector3};
use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;

/// Octave bands of levels: 125, 250, 500, 1000, 2000 and 4000 Hz.
pub const LEVEL_BANDS: usize = SURFACE_BANDS;

/// A number per octave band.
type Bands = [f32; LEVEL_BANDS];

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
    fn power(&self, start: usize, count: usize) -> Bands {
        if self.length == 0 {
            return Bands::default();
        }
        let start = start % self.length;
        let end = start + count;
        let (from, to) = (self.energy_before(start), self.energy_before(end % self.length));
        let (turns, whole) = ((end / self.length) as f64, self.before[self.before.len() - 1]);
        std::array::from_fn(|band| ((to[band] + turns * whole[band] - from[band]) / count as f64) as f32)
    }

    /// Band energy from the clip's start to a sample in it, linear within a hop.
    fn energy_before(&self, sample: usize) -> [f64; LEVEL_BANDS] {
        let hop = sample / HOP;
        let width = (self.length - hop * HOP).min(HOP);
        let share = (sample - hop * HOP) as f64 / width as f64;
        let [low, high] = [&self.before[hop], &self.before[hop + 1]];
        std::array::from_fn(|band| low[band] + (high[band] - low[band]) * share)
    }
}

/// Direct sound, metres after the first wave: 2.5 ms, as in [`Measures`](crate::Measures).
const DIRECT_M: f32 = 0.0025 * SPEED_OF_SOUND_M_S;

/// Smallest energy in ratios, relative to the direct wave at 1 m.
const NOTHING: f32 = 1e-12;

/// All waves from a source at a place, for every heading.
struct Waves {
    place: Point3<f32>,
    waves: Vec<Wave>,
    /// Energies by step, wave after wave.
    parts: Vec<Part>,
    /// Steps of the response.
    steps: usize,
}

struct Wave {
    /// Unit vector towards the wave's origin, world frame.
    direction: Vector3<f32>,
    range_m: f32,
    /// Share with this direction, 0 to 1; the rest is diffuse.
    share: f32,
    is_direct: bool,
    /// End of its energies in [`Waves::parts`].
    end: usize,
}

/// Energy in a step after the emission. The direct wave at 1 m has energy 1.
struct Part {
    step: usize,
    energy: Bands,
}

/// Energy at both ears at a pose.
struct ResponseEnergy {
    listener: Listener,
    /// By step since the emission, ear, left first, and band.
    by_step: Vec<[Bands; 2]>,
    first: Option<FirstSound>,
}

impl Waves {
    /// Finds the waves at a place. Sound of a step of `step_s` seconds with constant power arrives in two steps.
    fn new(source: &Source, place: &Point3<f32>, step_s: f32) -> Self {
        let heard = source.heard_at(place);
        let steps = 1 + (source.response_samples() as f32 / (step_s * SAMPLE_RATE_HZ as f32)) as usize;
        let mut waves = Self { place: *place, waves: Vec::new(), parts: Vec::new(), steps };
        let direct_m = heard.arrivals.first().map_or(0.0, |first| first.length_m + DIRECT_M);
        heard.arrivals.iter().for_each(|arrival| waves.add_arrival(arrival, direct_m, step_s));
        let (early, late) = heard.echo.split_at(heard.echo.len().min(DIRECTED));
        early.chunks(1).enumerate().for_each(|(slice, group)| waves.add_late(slice, group, step_s));
        for (group, slices) in late.chunks(GROUP).enumerate() {
            waves.add_late(DIRECTED + group * GROUP, slices, step_s);
        }
        waves
    }

    fn add_arrival(&mut self, arrival: &Arrival, direct_m: f32, step_s: f32) {
        let range_m = arrival.length_m.max(0.1);
        let energy =
            std::array::from_fn(|band| libm::exp10f(-0.1 * arrival.loss[band]) / (range_m * range_m));
        self.add_part(arrival.delay_s() as f32 / step_s, &energy);
        let is_direct = arrival.length_m <= direct_m;
        self.end_wave(arrival.direction, range_m, 1.0, is_direct);
    }

    /// Adds slices with a common direction.
    fn add_late(&mut self, first: usize, slices: &[Slice], step_s: f32) {
        let total: f32 = slices.iter().map(Slice::total).sum();
        if total <= 0.0 {
            return;
        }
        let flow = slices.iter().map(|slice| slice.flow * slice.total()).sum::<Vector3<f32>>() / total;
        for (slice, heard) in slices.iter().enumerate() {
            let energy = std::array::from_fn(|band| heard.energy[band]);
            self.add_part(middle_s(first + slice) / step_s, &energy);
        }
        let direction = (-flow).try_normalize(1e-6).unwrap_or_default();
        self.end_wave(direction, FAR_M, directed_share(&flow), false);
    }

    /// Divides energy that arrives after `delay_steps` between two steps.
    fn add_part(&mut self, delay_steps: f32, energy: &Bands) {
        let step = delay_steps as usize;
        let later = delay_steps - step as f32;
        self.add_energy(step, energy.map(|energy| energy * (1.0 - later)));
        self.add_energy(step + 1, energy.map(|energy| energy * later));
    }

    fn add_energy(&mut self, step: usize, energy: Bands) {
        if step >= self.steps {
            return;
        }
        let begun = self.waves.last().map_or(0, |wave| wave.end);
        match self.parts[begun..].iter_mut().find(|part| part.step == step) {
            Some(part) => part.energy.iter_mut().zip(energy).for_each(|(sum, energy)| *sum += energy),
            None => self.parts.push(Part { step, energy }),
        }
    }

    fn end_wave(&mut self, direction: Vector3<f32>, range_m: f32, share: f32, is_direct: bool) {
        self.waves.push(Wave { direction, range_m, share, is_direct, end: self.parts.len() });
    }

    /// Returns the energy at both ears of a head at this place.
    fn response(&self, head: &Head, listener: &Listener) -> ResponseEnergy {
        let diffuse = &head.heard_field().energy;
        let mut by_step = vec![[Bands::default(); 2]; self.steps];
        let (mut direct, mut rest, mut lead) = (0.0, 0.0, 0.0);
        let mut begun = 0;
        for wave in &self.waves {
            let heard = head.energies(&wave.direction, listener.heading_rad, wave.range_m);
            let gains = heard.map(|heard| -> Bands {
                std::array::from_fn(|band| wave.share * heard[band] + (1.0 - wave.share) * diffuse[band])
            });
            let middle = self.add_wave(begun..wave.end, &gains, &mut by_step);
            if wave.is_direct {
                direct += middle;
                lead += middle * head.lead_s(&wave.direction, listener.heading_rad, wave.range_m) as f32;
            } else {
                rest += middle;
            }
            begun = wave.end;
        }
        let direct_db = 10.0 * libm::log10f((direct + NOTHING) / (rest + NOTHING));
        let first = (direct > NOTHING).then(|| FirstSound { lead_s: lead / direct, direct_db });
        ResponseEnergy { listener: *listener, by_step, first }
    }

    /// Adds a wave with gains per ear; returns its energy in the middle octaves.
    fn add_wave(&self, parts: Range<usize>, gains: &[Bands; 2], by_step: &mut [[Bands; 2]]) -> f32 {
        let mut middle = 0.0;
        for part in &self.parts[parts] {
            for (sum, gains) in by_step[part.step].iter_mut().zip(gains) {
                for band in 0..LEVEL_BANDS {
                    sum[band] += part.energy[band] * gains[band];
                }
                middle += MIDDLE.map(|band| part.energy[band] * gains[band]).sum::<f32>();
            }
        }
        middle
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
