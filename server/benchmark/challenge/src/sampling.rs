//! Selection and order of a run's episodes: a pure function of secret and run id. Everyone can repeat it once the secret is published.

use avln_episode::Modality;
use serde::{Deserialize, Serialize};

/// An episode in a phase.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PhaseEpisode {
    /// Episode id inside the split.
    pub episode: String,
    /// Scene name.
    pub scene: String,
    /// Goals in mission order.
    pub goals: Vec<GoalText>,
}

/// A goal cue in words.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct GoalText {
    /// Cue kind.
    pub modality: Modality,
    /// The category's label or the sentence; `None` for an image.
    pub text: Option<String>,
}

/// Episode selection and order per run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Sampling {
    /// True if the order is drawn per run.
    pub shuffle: bool,
    /// Sample size; `None` for all episodes.
    pub sample: Option<Sample>,
}

impl Sampling {
    /// Returns a run's episode count in a phase with `all` episodes.
    pub fn episodes_of_run(&self, all: u32) -> u32 {
        self.sample.map_or(all, |sample| sample.episodes.min(all))
    }
}

/// A run's sample size.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sample {
    /// Episodes per run.
    pub episodes: u32,
    /// Episodes among these that all runs share, for paired comparisons.
    #[serde(default)]
    pub anchors: u32,
}

/// The values behind a phase's commitment.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CommitmentValues {
    /// Digest over the phase's split and episode ids ([`pool_digest`]), hex.
    pub pool: String,
    /// Benchmark version.
    pub scorer: String,
    /// Key for samples, orders and handles ([`PhaseSecret`]), hex.
    pub secret: String,
}

impl CommitmentValues {
    /// Hashes the values by BLAKE3, in hex. A 64-bit little-endian length precedes every value.
    pub fn commitment(&self) -> String {
        let parts = [&self.pool, &self.scorer, &self.secret];
        hash_parts("avln 2026 phase commitment", parts.into_iter().map(String::as_str))
    }
}

/// Hashes a split's digest and a phase's episode ids in order, hex.
pub fn pool_digest<'a>(split_digest: &'a str, episodes: impl IntoIterator<Item = &'a str>) -> String {
    hash_parts("avln 2026 phase pool", std::iter::once(split_digest).chain(episodes))
}

fn hash_parts<'a>(context: &str, parts: impl Iterator<Item = &'a str>) -> String {
    let mut hasher = blake3::Hasher::new_derive_key(context);
    for part in parts {
        // Lengths keep ("ab", "c") and ("a", "bc") apart.
        hasher.update(&(part.len() as u64).to_le_bytes()).update(part.as_bytes());
    }
    hasher.finalize().to_hex().to_string()
}

/// The 256-bit key for a phase's draws.
#[derive(Clone, Copy)]
pub struct PhaseSecret([u8; 32]);

/// A hash purpose. Draws with different purposes are independent.
#[derive(Clone, Copy)]
enum Purpose {
    Anchors,
    Sample,
    Order,
    Handle,
    Split,
}

impl PhaseSecret {
    /// Parses 64 hexadecimal digits; `None` for other text.
    pub fn from_hex(text: &str) -> Option<Self> {
        let mut bytes = [0; 32];
        hex::decode_to_slice(text, &mut bytes).ok()?;
        Some(Self(bytes))
    }

    /// Hashes purpose, run and name by keyed BLAKE3.
    fn hash(&self, purpose: Purpose, run: &str, name: &str) -> [u8; 32] {
        let mut hasher = blake3::Hasher::new_keyed(&self.0);
        hasher.update(&[purpose as u8]);
        for part in [run, name] {
            hasher.update(&(part.len() as u64).to_le_bytes()).update(part.as_bytes());
        }
        *hasher.finalize().as_bytes()
    }

    /// Returns an attempt's agent-visible name: `ep_` and 128 bits, hex.
    pub fn handle(&self, run: &str, ordinal: i64, attempt: i64) -> String {
        let hash = self.hash(Purpose::Handle, run, &format!("{ordinal} {attempt}"));
        format!("ep_{}", hex::encode(&hash[..16]))
    }

    /// Returns a split's agent-visible digest, hex. It confirms no guess of the split.
    pub fn split_digest(&self, digest: &str) -> String {
        hex::encode(self.hash(Purpose::Split, "", digest))
    }
}

/// Draws a run's episodes: indices in `pool` in playing order.
pub fn draw(pool: &[PhaseEpisode], sampling: Sampling, secret: &PhaseSecret, run: &str) -> Vec<usize> {
    let all: Vec<usize> = (0..pool.len()).collect();
    let mut drawn = match sampling.sample {
        Some(sample) if (sample.episodes as usize) < pool.len() => sampled(pool, all, sample, secret, run),
        _ => all,
    };
    if sampling.shuffle {
        drawn.sort_by_cached_key(|&index| secret.hash(Purpose::Order, run, &pool[index].episode));
    }
    drawn
}

/// Returns the anchors and the run's own sample, in pool order.
fn sampled(
    pool: &[PhaseEpisode],
    all: Vec<usize>,
    sample: Sample,
    secret: &PhaseSecret,
    run: &str,
) -> Vec<usize> {
    let anchors = sample.anchors.min(sample.episodes) as usize;
    // The empty run id makes the anchors equal for all runs.
    let mut drawn = stratified(pool, &all, anchors, |name| secret.hash(Purpose::Anchors, "", name));
    drawn.sort_unstable();
    let rest: Vec<usize> = all.into_iter().filter(|index| drawn.binary_search(index).is_err()).collect();
    let own = sample.episodes as usize - anchors;
    drawn.extend(stratified(pool, &rest, own, |name| secret.hash(Purpose::Sample, run, name)));
    drawn.sort_unstable();
    drawn
}

/// Draws `wanted` elements from `from` with equal probability, and with proportional strata: a systematic sample with a random
/// start of the list sorted by stratum and, inside a stratum, by hash (W. G. Cochran, Sampling Techniques, chapter 8).
fn stratified(
    pool: &[PhaseEpisode],
    from: &[usize],
    wanted: usize,
    hash: impl Fn(&str) -> [u8; 32],
) -> Vec<usize> {
    if from.is_empty() {
        return vec![];
    }
    let mut sorted = from.to_vec();
    sorted.sort_by_cached_key(|&index| (stratum(&pool[index]), hash(&pool[index].episode)));
    // The modulo bias is below 1e-16: 64 bits against some hundred episodes.
    let start_hash = hash("start");
    let start = u64::from_le_bytes(start_hash[..8].try_into().unwrap_or_default()) as usize % sorted.len();
    (0..wanted.min(sorted.len())).map(|index| sorted[(index * sorted.len() + start) / wanted]).collect()
}

/// Goal counts, in total and by modality.
fn stratum(episode: &PhaseEpisode) -> [usize; 4] {
    let count = |modality| episode.goals.iter().filter(|goal| goal.modality == modality).count();
    [episode.goals.len(), count(Modality::Category), count(Modality::Description), count(Modality::Image)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::{BTreeMap, BTreeSet};

    const SECRET: PhaseSecret = PhaseSecret([7; 32]);

    /// Returns episodes with two to four goals; the first goal cycles through the modalities.
    fn pool(size: usize) -> Vec<PhaseEpisode> {
        let modalities = [Modality::Category, Modality::Description, Modality::Image];
        let goal = |modality| GoalText { modality, text: None };
        let episode = |index: usize| {
            let mut goals = vec![goal(modalities[index % 3])];
            goals.resize(2 + index / 3 % 3, goal(Modality::Category));
            PhaseEpisode { episode: format!("e{index}"), scene: String::new(), goals }
        };
        (0..size).map(episode).collect()
    }

    fn sampling(episodes: u32, anchors: u32) -> Sampling {
        Sampling { shuffle: true, sample: Some(Sample { episodes, anchors }) }
    }

    fn run_id(number: usize) -> String {
        format!("run_{number}")
    }

    #[test]
    fn draw_depends_on_secret_and_run_alone() {
        let pool = pool(90);
        let first = draw(&pool, sampling(30, 6), &SECRET, "run_1");
        assert_eq!(first, draw(&pool, sampling(30, 6), &SECRET, "run_1"));
        assert_ne!(first, draw(&pool, sampling(30, 6), &SECRET, "run_2"));
        assert_ne!(first, draw(&pool, sampling(30, 6), &PhaseSecret([8; 32]), "run_1"));
        assert_eq!(draw(&pool, Sampling::default(), &SECRET, "run_1"), (0..90).collect::<Vec<_>>());
    }

    #[test]
    fn runs_share_anchors_and_repeat_no_episode() {
        let pool = pool(200);
        let mut common: Option<BTreeSet<usize>> = None;
        for number in 0..60 {
            let drawn = draw(&pool, sampling(40, 10), &SECRET, &run_id(number));
            let set: BTreeSet<usize> = drawn.iter().copied().collect();
            assert_eq!((drawn.len(), set.len()), (40, 40));
            common = Some(common.map_or(set.clone(), |common| common.intersection(&set).copied().collect()));
        }
        assert_eq!(common.map(|common| common.len()), Some(10));
    }

    #[test]
    fn strata_are_proportional_in_every_sample() {
        let pool = pool(270);
        for number in 0..40 {
            let mut counts: BTreeMap<[usize; 4], i64> = BTreeMap::new();
            for index in draw(&pool, sampling(90, 0), &SECRET, &run_id(number)) {
                *counts.entry(stratum(&pool[index])).or_default() += 1;
            }
            // Nine strata of 30 episodes; a third of them is drawn.
            assert_eq!(counts.len(), 9);
            assert!(counts.values().all(|count| (count - 10).abs() <= 1), "{counts:?}");
        }
    }

    #[test]
    fn episodes_are_drawn_with_equal_probability() {
        let (pool, runs) = (pool(60), 3000);
        let mut counts = vec![0_u32; pool.len()];
        for number in 0..runs {
            for index in draw(&pool, sampling(20, 0), &SECRET, &run_id(number)) {
                counts[index] += 1;
            }
        }
        // Binomial with 3000 draws at a third: mean 1000, standard deviation 26; the bound is five standard deviations.
        assert!(counts.iter().all(|count| count.abs_diff(1000) < 130), "{counts:?}");
    }

    #[test]
    fn shuffled_position_is_independent_of_episode() {
        let (pool, runs, sampling) = (pool(8), 4000, Sampling { shuffle: true, sample: None });
        let mut counts = [[0_f64; 8]; 8];
        for number in 0..runs {
            for (position, index) in draw(&pool, sampling, &SECRET, &run_id(number)).into_iter().enumerate() {
                counts[position][index] += 1.0;
            }
        }
        let expected = runs as f64 / 8.0;
        let chi_square: f64 =
            counts.iter().flatten().map(|count| (count - expected).powi(2) / expected).sum();
        // 49 degrees of freedom: 99.99 % of draws lie below 95.
        assert!((15.0..95.0).contains(&chi_square), "{chi_square}");
    }

    #[test]
    fn handles_are_unique() {
        let mut handles = BTreeSet::new();
        for (number, ordinal) in (0..50).flat_map(|number| (0..20).map(move |ordinal| (number, ordinal))) {
            for attempt in 1..=3 {
                let handle = SECRET.handle(&run_id(number), ordinal, attempt);
                assert_eq!(handle.len(), 35);
                assert!(handles.insert(handle));
            }
        }
    }
}
