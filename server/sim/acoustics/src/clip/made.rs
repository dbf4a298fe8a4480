//! Synthesised clips.

use super::{Clip, families::FAMILIES, finish::Finish};
use crate::SAMPLE_RATE_HZ;
use avln_geom::Rng;
use std::sync::OnceLock;

/// Length of every clip, samples: six seconds.
pub(super) const CLIP_SAMPLES: usize = 6 * SAMPLE_RATE_HZ as usize;

/// Clips per family.
pub(super) const CLIPS_PER_FAMILY: usize = 10;

/// Total number of clips.
pub(super) const COUNT: usize = FAMILIES.len() * CLIPS_PER_FAMILY;

/// Seed of all clips.
const SEED: u64 = 0x61_766c_6e01;

/// Returns the clip at `index`, family by family, synthesised on first use.
///
/// # Panics
/// If `index` is out of range.
pub(super) fn clip(index: usize) -> &'static Clip {
    static CLIPS: [OnceLock<Clip>; COUNT] = [const { OnceLock::new() }; COUNT];
    CLIPS[index].get_or_init(|| make(index))
}

/// Name of the clip at `index`: family and number.
pub(super) fn name(index: usize) -> String {
    format!("{}-{}", FAMILIES[index / CLIPS_PER_FAMILY].name, index % CLIPS_PER_FAMILY)
}

/// Synthesises the clip at `index`.
pub(super) fn make(index: usize) -> Clip {
    static FINISH: OnceLock<Finish> = OnceLock::new();
    let family = &FAMILIES[index / CLIPS_PER_FAMILY];
    let name = name(index);
    let mut samples = (family.make)(&mut Rng::new(SEED).fork(&name));
    FINISH.get_or_init(|| Finish::new(CLIP_SAMPLES)).apply(&mut samples);
    Clip { name, samples: samples.into() }
}
