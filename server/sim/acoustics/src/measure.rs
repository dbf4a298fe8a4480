//! Room acoustic measures of impulse responses (ISO 3382-1).

mod decay;
mod expected;
mod lag;
mod octave;

use crate::{ImpulseResponse, SAMPLE_RATE_HZ, SURFACE_BANDS};
use decay::Decay;
pub use expected::expected_reverberation_s;
use octave::{Octaves, band_energies, core_share, power_share};
use std::ops::Range;

/// End of the direct sound after the first wave, seconds.
const DIRECT_S: f64 = 0.0025;

/// End of the early sound after the first wave, seconds.
const EARLY_S: f64 = 0.05;

/// Octaves for the direct-to-reverberant ratio: 500, 1000 and 2000 Hz.
const MIDDLE: Range<usize> = 2..5;

/// Measures of an impulse response. `None` is undefined: no decay, a response too short for it, or a ratio to
/// silence.
#[derive(Clone, Debug, PartialEq)]
pub struct Measures {
    /// Energy until 2.5 ms after the first wave relative to the rest, decibels: both ears, octaves 500, 1000
    /// and 2000 Hz with equal weight.
    pub drr_db: Option<f64>,
    /// 125, 250, 500, 1000, 2000 and 4000 Hz.
    pub bands: [BandMeasures; SURFACE_BANDS],
}

/// Measures of an octave band: a third-order Butterworth band pass, as magnitude, without delay.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BandMeasures {
    /// Energy, mean of both ears, relative to the free-field pressure 1 m from the source, decibels.
    pub level_db: Option<f64>,
    /// Reverberation time from the decay between -5 and -25 dB, seconds; energies of both ears are added.
    /// Uses the octave core of 0.45 octaves to either side, to exclude slower neighbours.
    pub t20_s: Option<f64>,
    /// As above between -5 and -35 dB.
    pub t30_s: Option<f64>,
    /// Early decay time: from the first wave to -10 dB, of the whole octave.
    pub edt_s: Option<f64>,
    /// Energy until 50 ms after the first wave relative to the rest, decibels; both ears.
    pub c50_db: Option<f64>,
    /// Energy at the left ear relative to the right ear, decibels.
    pub ild_db: Option<f64>,
}

impl Measures {
    /// Measures `response`, with the first wave at the head centre `first_arrival_s` after emission and a
    /// length of `length_s`.
    ///
    /// Decays are straight lines fitted to Schroeder's backward integral (1965, J. Acoust. Soc. Am. 37), if
    /// the response continues for 15 dB below the fit range. The early part is cut before filtering.
    pub fn of(response: &ImpulseResponse, first_arrival_s: f64, length_s: f64) -> Self {
        let ears = [response.left.as_slice(), response.right.as_slice()];
        let split = |after_s: f64| {
            let end = ((first_arrival_s + after_s) * f64::from(SAMPLE_RATE_HZ)).max(0.0) as usize;
            ears.map(|ear| ear.split_at(end.min(ear.len())))
        };
        let all = ears.map(band_energies);
        let direct = split(DIRECT_S);
        let (direct, rest) = (direct.map(|cut| band_energies(cut.0)), direct.map(|cut| band_energies(cut.1)));
        let early = split(EARLY_S);
        let (early, late) = (early.map(|cut| band_energies(cut.0)), early.map(|cut| band_energies(cut.1)));
        let middle = |energies: &Ears| MIDDLE.map(|band| both(energies, band)).sum::<f64>();
        let octaves = ears.map(Octaves::new);
        Self {
            drr_db: ratio_db(middle(&direct), middle(&rest)),
            bands: std::array::from_fn(|band| {
                let decay = |share: fn(usize, f64) -> f64| {
                    let squared = octaves.each_ref().map(|ear| ear.squared(|hz| share(band, hz)));
                    Decay::of(&squared, first_arrival_s, length_s, band)
                };
                let (whole, core) = (decay(power_share), decay(core_share));
                BandMeasures {
                    level_db: ratio_db(both(&all, band) / 2.0, 1.0),
                    t20_s: core.time_s(-5.0, -25.0),
                    t30_s: core.time_s(-5.0, -35.0),
                    edt_s: whole.time_s(0.0, -10.0),
                    c50_db: ratio_db(both(&early, band), both(&late, band)),
                    ild_db: ratio_db(all[0][band], all[1][band]),
                }
            }),
        }
    }
}

/// Interaural delay of a wave, seconds: positive if it reaches the left ear first. The peak of the
/// cross-correlation below 1500 Hz, within 1 ms; `None` if an ear is silent.
pub fn interaural_delay_s(wave: &ImpulseResponse) -> Option<f64> {
    lag::lead_s(&wave.left, &wave.right)
}

/// Energies of both ears by band.
type Ears = [[f64; SURFACE_BANDS]; 2];

fn both(energies: &Ears, band: usize) -> f64 {
    energies[0][band] + energies[1][band]
}

/// Energy ratio in decibels; `None` unless both are positive.
fn ratio_db(energy: f64, other: f64) -> Option<f64> {
    // Residual of finite-precision filters, relative to a unit pulse.
    const NOTHING: f64 = 1e-16;
    (energy > NOTHING && other > NOTHING).then(|| 10.0 * libm::log10(energy / other))
}

#[cfg(test)]
mod tests;
