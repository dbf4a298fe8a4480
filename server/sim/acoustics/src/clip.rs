//! Sound clips: synthesised, with equal bits on every machine, or recorded.
//!
//! Synthesised clips are localisable: broadband, with several onsets per second and no long gap. All clips
//! are equally loud, so that level depends on distance only.

mod families;
mod recording;
mod synthesis;

pub use recording::RecordingError;

use avln_geom::Rng;
use families::FAMILIES;
use std::sync::{Arc, OnceLock};
use synthesis::{CLIP_SAMPLES, Mastering};

/// A seamless sound loop.
#[derive(Clone, Debug, PartialEq)]
pub struct Clip {
    /// Family and number, `pink-bursts-0`, or a recording name.
    pub name: String,
    /// Mono pressure at 1 m, at [`SAMPLE_RATE_HZ`](crate::SAMPLE_RATE_HZ).
    pub samples: Arc<[f32]>,
}

/// A share of the synthesised clips. The three disjoint pools have clips from every family.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClipPool {
    /// All 100 clips.
    All,
    /// 70 clips.
    Train,
    /// 15 other clips.
    Validation,
    /// The remaining 15 clips.
    Test,
}

/// A clip list.
#[derive(Clone, Debug)]
pub struct Bank(Arc<[Entry]>);

#[derive(Clone, Debug)]
enum Entry {
    Synthesized(usize),
    Given(Clip),
}

impl Bank {
    /// Returns the clips in `pool`: 6 s long, from ten families. Clips are synthesised on first use and cached.
    pub fn of(pool: ClipPool) -> Self {
        Self((0..COUNT).filter(|&index| pool.contains(index)).map(Entry::Synthesized).collect())
    }

    /// Creates a bank with `clips` in the given order.
    pub fn from_clips(clips: Vec<Clip>) -> Self {
        Self(clips.into_iter().map(Entry::Given).collect())
    }

    /// Number of clips.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Returns true without clips.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Returns the clip at `index`; `None` if out of range.
    pub fn clip(&self, index: usize) -> Option<Clip> {
        self.0.get(index).map(Entry::clip)
    }

    /// Returns all names in order, without synthesis.
    pub fn names(&self) -> Vec<String> {
        self.0.iter().map(Entry::name).collect()
    }

    /// Returns all clips in order.
    pub fn clips(&self) -> impl Iterator<Item = Clip> {
        self.0.iter().map(Entry::clip)
    }
}

impl Entry {
    fn clip(&self) -> Clip {
        match self {
            Self::Synthesized(index) => clip(*index).clone(),
            Self::Given(clip) => clip.clone(),
        }
    }

    fn name(&self) -> String {
        match self {
            Self::Synthesized(index) => name(*index),
            Self::Given(clip) => clip.name.clone(),
        }
    }
}

impl Default for Bank {
    fn default() -> Self {
        Self::of(ClipPool::All)
    }
}

impl ClipPool {
    fn contains(self, index: usize) -> bool {
        // Seven clips per family are for training; validation and test share three, with the larger part in turn.
        let (family, number) = (index / CLIPS_PER_FAMILY, index % CLIPS_PER_FAMILY);
        let validation_end = 8 + family % 2;
        match self {
            Self::All => true,
            Self::Train => number < 7,
            Self::Validation => (7..validation_end).contains(&number),
            Self::Test => number >= validation_end,
        }
    }
}

const CLIPS_PER_FAMILY: usize = 10;
const COUNT: usize = FAMILIES.len() * CLIPS_PER_FAMILY;
const SEED: u64 = 0x61_766c_6e01;

/// Returns the clip at `index`, synthesised on first use.
fn clip(index: usize) -> &'static Clip {
    static CLIPS: [OnceLock<Clip>; COUNT] = [const { OnceLock::new() }; COUNT];
    CLIPS[index].get_or_init(|| synthesize(index))
}

fn name(index: usize) -> String {
    format!("{}-{}", FAMILIES[index / CLIPS_PER_FAMILY].name, index % CLIPS_PER_FAMILY)
}

fn synthesize(index: usize) -> Clip {
    static MASTERING: OnceLock<Mastering> = OnceLock::new();
    let family = &FAMILIES[index / CLIPS_PER_FAMILY];
    let name = name(index);
    let mut samples = (family.generate)(&mut Rng::new(SEED).fork(&name));
    MASTERING.get_or_init(|| Mastering::new(CLIP_SAMPLES)).apply(&mut samples);
    Clip { name, samples: samples.into() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SAMPLE_RATE_HZ;
    use realfft::{RealFftPlanner, num_complex::Complex32};

    /// Mean square per 10 ms frame.
    fn frames(clip: &Clip) -> Vec<f32> {
        let mean_square =
            |frame: &[f32]| frame.iter().map(|sample| sample * sample).sum::<f32>() / frame.len() as f32;
        clip.samples.chunks(SAMPLE_RATE_HZ as usize / 100).map(mean_square).collect()
    }

    fn spectrum(clip: &Clip) -> Vec<Complex32> {
        let forward = RealFftPlanner::<f32>::new().plan_fft_forward(clip.samples.len());
        let mut spectrum = forward.make_output_vec();
        forward.process(&mut clip.samples.to_vec(), &mut spectrum).expect("lengths agree");
        spectrum
    }

    fn energy(bins: &[Complex32]) -> f32 {
        bins.iter().map(|bin| bin.norm_sqr()).sum()
    }

    /// Energy share between two frequencies in a spectrum up to 8 kHz.
    fn share_of_energy(spectrum: &[Complex32], from_hz: f32, to_hz: f32) -> f32 {
        let bin = |frequency_hz: f32| (frequency_hz / 8000.0 * (spectrum.len() - 1) as f32) as usize;
        energy(&spectrum[bin(from_hz)..bin(to_hz)]) / energy(spectrum)
    }

    fn frequency_below_which(spectrum: &[Complex32], share: f32) -> f32 {
        let (whole, mut sum) = (energy(spectrum), 0.0);
        let is_below = |bin: &&Complex32| {
            sum += bin.norm_sqr();
            sum < share * whole
        };
        spectrum.iter().take_while(is_below).count() as f32 * 8000.0 / (spectrum.len() - 1) as f32
    }

    fn bank() -> Vec<Clip> {
        Bank::default().clips().collect()
    }

    #[test]
    fn bank_has_a_hundred_distinct_clips() {
        let bank = bank();
        assert_eq!((bank.len(), families::FAMILIES.len()), (100, 10));
        for (index, clip) in bank.iter().enumerate() {
            assert_eq!(clip.samples.len(), 6 * SAMPLE_RATE_HZ as usize);
            assert!(
                bank[..index].iter().all(|other| other.name != clip.name && other.samples != clip.samples)
            );
        }
        assert_eq!(synthesize(42), bank[42]);
        assert_eq!(bank[42].name, "babble-2");
    }

    #[test]
    fn pools_are_disjoint_and_contain_every_family() {
        let names = |pool| Bank::of(pool).clips().map(|clip| clip.name).collect::<Vec<_>>();
        let pools = [ClipPool::Train, ClipPool::Validation, ClipPool::Test].map(names);
        assert_eq!(pools.each_ref().map(Vec::len), [70, 15, 15]);
        let mut all = pools.concat();
        all.sort();
        let mut whole = names(ClipPool::All);
        whole.sort();
        assert_eq!(all, whole);
        for family in &families::FAMILIES {
            let is_in = |pool: &Vec<String>| pool.iter().any(|name| name.starts_with(family.name));
            assert!(pools.iter().all(is_in), "{}", family.name);
        }
    }

    #[test]
    fn clips_are_equally_loud_with_limited_peaks() {
        let mut power = 0.0;
        for clip in bank() {
            let mean_square = frames(&clip).iter().sum::<f32>() / frames(&clip).len() as f32;
            let level_db = 10.0 * (mean_square / (0.05 * 0.05)).log10();
            assert!(level_db.abs() < 3.0, "{}: {level_db} dB off", clip.name);
            let loudness_db =
                10.0 * (synthesis::weighted_mean_square(&spectrum(&clip), clip.samples.len())).log10();
            let wanted_db = 20.0 * f64::from(synthesis::LOUDNESS).log10();
            assert!((loudness_db - wanted_db).abs() < 0.01, "{}: {loudness_db} dB", clip.name);
            let peak = clip.samples.iter().fold(0.0_f32, |peak, sample| peak.max(sample.abs()));
            let crest_db = 10.0 * (peak * peak / mean_square).log10();
            assert!((3.0..=14.0).contains(&crest_db), "{}: crest {crest_db} dB", clip.name);
            power += mean_square / 100.0;
        }
        let level_db = 10.0 * (power / (0.05 * 0.05)).log10();
        assert!(level_db.abs() < 0.1, "the mean over all clips is {level_db} dB off");
    }

    #[test]
    fn clips_are_more_than_three_octaves_wide() {
        for clip in bank() {
            let spectrum = spectrum(&clip);
            let (low, high) =
                (share_of_energy(&spectrum, 0.0, 1200.0), share_of_energy(&spectrum, 2000.0, 8000.0));
            assert!(low >= 0.2 && high >= 0.2, "{}: {low} low, {high} high", clip.name);
            let edges = [0.05, 0.95].map(|share| frequency_below_which(&spectrum, share));
            let octaves = (edges[1] / edges[0]).log2();
            assert!(octaves >= 3.0, "{}: 90 % of its energy lies in {octaves} octaves", clip.name);
        }
    }

    #[test]
    fn clips_have_onsets_and_no_long_gap() {
        for clip in bank() {
            let frames = frames(&clip);
            let around = |index: usize| frames[index % frames.len()];
            let (mut onsets, mut gap, mut longest_gap, mut armed) = (0, 0, 0, true);
            for index in 8..frames.len() + 8 {
                let before = (1..=6).map(|back| around(index - back)).fold(f32::INFINITY, f32::min);
                let rises = around(index) > 4.0 * before && around(index) > 0.25 * 0.05 * 0.05;
                onsets += usize::from(rises && armed);
                armed = !rises;
                gap = if around(index) < 1e-4 * 0.05 * 0.05 { gap + 1 } else { 0 };
                longest_gap = longest_gap.max(gap);
            }
            assert!(onsets >= 18, "{}: {onsets} onsets in 6 s", clip.name);
            assert!(longest_gap <= 15, "{}: silent for {longest_gap}0 ms", clip.name);
        }
    }

    #[test]
    fn clips_loop_without_a_step() {
        for clip in bank() {
            let last = clip.samples.len() - 1;
            let mut bends: Vec<f32> =
                clip.samples.windows(3).map(|w| (w[0] - 2.0 * w[1] + w[2]).abs()).collect();
            bends.sort_by(f32::total_cmp);
            let seam = (clip.samples[last - 1] - 2.0 * clip.samples[last] + clip.samples[0]).abs();
            assert!(seam <= bends[bends.len() * 999 / 1000], "{}: a step of {seam}", clip.name);
        }
    }
}
