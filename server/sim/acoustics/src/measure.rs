//! What rooms are described by, from impulse responses (ISO 3382-1).

mod decay;
mod expected;
mod lag;
mod octave;

use crate::{ImpulseResponse, SAMPLE_RATE_HZ, SURFACE_BANDS};
use decay::Decay;
pub use expected::expected_reverberation_s;
use octave::{Octaves, band_energies, core_share, power_share};
use std::ops::Range;

/// What arrives no later than this after the first wave is direct sound, seconds.
const DIRECT_S: f64 = 0.0025;

/// What arrives no later than this after the first wave is early, seconds.
const EARLY_S: f64 = 0.05;

/// Octaves over which direct sound and the rest are compared: 500, 1000 and 2000 Hz.
const MIDDLE: Range<usize> = 2..5;

/// The measures of one impulse response. `None` is what does not exist: a decay that does not take place or that the
/// response is too short to show, a ratio to silence.
#[derive(Clone, Debug, PartialEq)]
pub struct Measures {
    /// Energy until 2.5 ms after the first wave over that of the rest, decibels: both ears, the octaves of 500, 1000 and
    /// 2000 Hz with equal weight.
    pub drr_db: Option<f64>,
    /// 125, 250, 500, 1000, 2000 and 4000 Hz.
    pub bands: [BandMeasures; SURFACE_BANDS],
}

/// What is measured in one octave band: a Butterworth band pass of third order, as magnitude, without delay.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BandMeasures {
    /// Energy, mean of both ears, over that of the free-field pressure 1 m from the source, decibels.
    pub level_db: Option<f64>,
    /// Reverberation time from the decay between -5 and -25 dB, seconds; energies of both ears are added. Of the core of
    /// the octave, 0.45 octaves to either side, so that slower neighbours are not taken for it.
    pub t20_s: Option<f64>,
    /// The same between -5 and -35 dB.
    pub t30_s: Option<f64>,
    /// Early decay time: the same from the first wave to -10 dB, of the whole octave.
    pub edt_s: Option<f64>,
    /// Energy until 50 ms after the first wave over that of the rest, decibels; both ears.
    pub c50_db: Option<f64>,
    /// Energy at the left ear over that at the right ear, decibels.
    pub ild_db: Option<f64>,
}

impl Measures {
    /// Measures `response`, whose first wave passes the centre of the head `first_arrival_s` after it was emitted and
    /// which was cut at `length_s`.
    ///
    /// Decays are straight lines fitted to Schroeder's backward integral (1965, J. Acoust. Soc. Am. 37). A response shows
    /// one when it goes on for 15 dB below the range of the fit. The early part is cut out before it is filtered.
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

/// Interaural delay of a wave, seconds: positive when it reaches the left ear first. The peak of the cross-correlation of
/// the ears below 1500 Hz, within 1 ms either way; `None` when an ear hears nothing.
pub fn interaural_delay_s(wave: &ImpulseResponse) -> Option<f64> {
    lag::lead_s(&wave.left, &wave.right)
}

/// Energies of both ears by band.
type Ears = [[f64; SURFACE_BANDS]; 2];

fn both(energies: &Ears, band: usize) -> f64 {
    energies[0][band] + energies[1][band]
}

/// Decibels of an energy over another; `None` unless both are more than nothing.
fn ratio_db(energy: f64, other: f64) -> Option<f64> {
    // Filters of finite precision leave this much of a unit pulse where there is nothing.
    const NOTHING: f64 = 1e-16;
    (energy > NOTHING && other > NOTHING).then(|| 10.0 * libm::log10(energy / other))
}

#[cfg(test)]
mod tests;
