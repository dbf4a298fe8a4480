//! The sounds that sources play: made by rule, the same on every machine.
//!
//! Every clip can be placed by ear: broadband, with several onsets a second and no long gap. All have the same
//! length and level, so that neither tells one clip's use from another's.

use crate::SAMPLE_RATE_HZ;
use avln_geom::Rng;
use std::sync::{Arc, OnceLock};

mod families;
mod finish;
mod synth;

/// Length of every clip, samples: six seconds.
const CLIP_SAMPLES: usize = 6 * SAMPLE_RATE_HZ as usize;

/// Clips of each family.
const CLIPS_PER_FAMILY: usize = 5;

/// Seed of the bank; another one is another bank.
const BANK_SEED: u64 = 0x61_766c_6e01;

/// A sound that repeats without a seam.
#[derive(Clone, Debug, PartialEq)]
pub struct Clip {
    /// Family and number: `pink-bursts-0`.
    pub name: String,
    /// Pressure at 1 m, mono, at [`SAMPLE_RATE_HZ`]; the last sample is followed by the first.
    pub samples: Arc<[f32]>,
}

/// All clips, in a fixed order: 30 of them in six families, six seconds each, root mean square 0.05.
///
/// Made on the first call; cheap after it.
pub fn clip_bank() -> Vec<Clip> {
    static BANK: OnceLock<Vec<Clip>> = OnceLock::new();
    BANK.get_or_init(make_bank).clone()
}

fn make_bank() -> Vec<Clip> {
    let finish = finish::Finish::new(CLIP_SAMPLES);
    let numbers = |family| (0..CLIPS_PER_FAMILY).map(move |number| (family, number));
    families::FAMILIES
        .iter()
        .flat_map(numbers)
        .map(|(family, number)| make(family, number, &finish))
        .collect()
}

fn make(family: &families::Family, number: usize, finish: &finish::Finish) -> Clip {
    let name = format!("{}-{number}", family.name);
    let mut samples = (family.make)(&mut Rng::new(BANK_SEED).fork(&name));
    finish.apply(&mut samples);
    Clip { name, samples: samples.into() }
}

#[cfg(test)]
mod tests;
