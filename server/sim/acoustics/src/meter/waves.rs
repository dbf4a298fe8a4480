//! Energy of the waves at a place, and its share at both ears.

use super::{Bands, FirstSound, LEVEL_BANDS};
use crate::SPEED_OF_SOUND_M_S;
use crate::head::{Head, filter::FAR_M};
use crate::impulse::{Arrival, Listener};
use crate::late::slices::{Slice, middle_s};
use crate::late::tail::{DIRECTED, GROUP, directed_share};
use crate::source::Source;
use avln_geom::{Point3, Vector3};

/// Direct sound, metres after the first wave: 2.5 ms, as in [`Measures`](crate::Measures).
const DIRECT_M: f32 = 0.0025 * SPEED_OF_SOUND_M_S;

/// Octaves for the direct-to-reverberant ratio: 500, 1000 and 2000 Hz.
const MIDDLE: std::ops::Range<usize> = 2..5;

/// Smallest energy in ratios, relative to the direct wave at 1 m.
const NOTHING: f32 = 1e-12;

/// All waves from a source at a place, for every heading.
pub(super) struct Waves {
    pub(super) place: Point3<f32>,
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
pub(super) struct ResponseEnergy {
    pub(super) listener: Listener,
    /// By step since the emission, ear, left first, and band.
    pub(super) by_step: Vec<[Bands; 2]>,
    pub(super) first: Option<FirstSound>,
}

impl Waves {
    /// Finds the waves at a place. Sound of a step of `step_s` seconds with constant power arrives in two steps.
    pub(super) fn new(source: &Source, place: &Point3<f32>, step_s: f32) -> Self {
        let heard = source.heard_at(place);
        let steps = 1 + (source.response_samples() as f32 / (step_s * crate::SAMPLE_RATE_HZ as f32)) as usize;
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
    pub(super) fn response(&self, head: &Head, listener: &Listener) -> ResponseEnergy {
        let diffuse = head.heard_field().energy();
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
    fn add_wave(&self, parts: std::ops::Range<usize>, gains: &[Bands; 2], by_step: &mut [[Bands; 2]]) -> f32 {
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
