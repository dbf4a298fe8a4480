//! Clips that are made by rule.

use super::{Clip, families::FAMILIES, finish::Finish};
use crate::SAMPLE_RATE_HZ;
use avln_geom::Rng;
use std::sync::OnceLock;

/// Length of every clip, samples: six seconds.
pub(super) const CLIP_SAMPLES: usize = 6 * SAMPLE_RATE_HZ as usize;

/// Clips of each family.
pub(super) const CLIPS_PER_FAMILY: usize = 10;

/// How many clips there are.
pub(super) const COUNT: usize = FAMILIES.len() * CLIPS_PER_FAMILY;

/// Seed of all clips; another one makes others.
const SEED: u64 = 0x61_766c_6e01;

/// The clip at `index`, family by family; made when somebody first asks for it.
///
/// # Panics
/// When there is none of that index.
pub(super) fn clip(index: usize) -> &'static Clip {
    static CLIPS: [OnceLock<Clip>; COUNT] = [const { OnceLock::new() }; COUNT];
    CLIPS[index].get_or_init(|| make(index))
}

/// The name of the clip at `index`: its family's and its number in it.
pub(super) fn name(index: usize) -> String {
    format!("{}-{}", FAMILIES[index / CLIPS_PER_FAMILY].name, index % CLIPS_PER_FAMILY)
}

/// Makes the clip at `index`.
pub(super) fn make(index: usize) -> Clip {
    static FINISH: OnceLock<Finish> = OnceLock::new();
    let family = &FAMILIES[index / CLIPS_PER_FAMILY];
    let name = name(index);
    let mut samples = (family.make)(&mut Rng::new(SEED).fork(&name));
    FINISH.get_or_init(|| Finish::new(CLIP_SAMPLES)).apply(&mut samples);
    Clip { name, samples: samples.into() }
}
