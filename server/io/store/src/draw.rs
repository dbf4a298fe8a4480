//! Which episodes a run plays and in which order: a function of the phase's secret and the run's id, and of nothing else.

use crate::{PhaseEpisode, Sample, Sampling};
use avln_episode::Modality;

/// What keys all draws of a phase.
#[derive(Clone, Copy)]
pub(crate) struct PhaseSecret(pub(crate) [u8; 32]);

/// What a draw is for; draws for different things have nothing to do with each other.
#[derive(Clone, Copy)]
enum Purpose {
    Anchors,
    Sample,
    Order,
    Handle,
}

impl PhaseSecret {
    /// BLAKE3 keyed by the secret, over what the draw is for, the run and a name.
    fn hash(&self, purpose: Purpose, run: &str, name: &str) -> [u8; 32] {
        let mut hasher = blake3::Hasher::new_keyed(&self.0);
        hasher.update(&[purpose as u8]);
        for part in [run, name] {
            hasher.update(&(part.len() as u64).to_le_bytes()).update(part.as_bytes());
        }
        *hasher.finalize().as_bytes()
    }

    /// The name under which an agent sees an attempt at an episode: 128 bits, `ep_` and hexadecimal.
    pub(crate) fn handle(&self, run: &str, ordinal: i64, attempt: i64) -> String {
        let hash = self.hash(Purpose::Handle, run, &format!("{ordinal} {attempt}"));
        let hex: String = hash[..16].iter().map(|byte| format!("{byte:02x}")).collect();
        format!("ep_{hex}")
    }
}

/// Places in `pool` of the episodes of a run, in the order in which it plays them.
pub(crate) fn draw(pool: &[PhaseEpisode], sampling: Sampling, secret: &PhaseSecret, run: &str) -> Vec<usize> {
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

/// The anchors, which are the same for every run, and the rest of the sample; in the order of the pool.
fn sampled(
    pool: &[PhaseEpisode],
    all: Vec<usize>,
    sample: Sample,
    secret: &PhaseSecret,
    run: &str,
) -> Vec<usize> {
    let anchors = sample.anchors.min(sample.episodes) as usize;
    let mut drawn = stratified(pool, &all, anchors, secret, Purpose::Anchors, "");
    drawn.sort_unstable();
    let rest: Vec<usize> = all.into_iter().filter(|index| drawn.binary_search(index).is_err()).collect();
    let own = sample.episodes as usize - anchors;
    drawn.extend(stratified(pool, &rest, own, secret, Purpose::Sample, run));
    drawn.sort_unstable();
    drawn
}

/// Takes `wanted` of `from`, each with the same probability and each stratum by its share: a systematic sample
/// with a random start of the list sorted by stratum and, inside of it, by chance (W. G. Cochran, Sampling
/// Techniques, chapter 8).
fn stratified(
    pool: &[PhaseEpisode],
    from: &[usize],
    wanted: usize,
    secret: &PhaseSecret,
    purpose: Purpose,
    run: &str,
) -> Vec<usize> {
    if from.is_empty() {
        return vec![];
    }
    let mut sorted = from.to_vec();
    sorted.sort_by_cached_key(|&index| {
        (stratum(&pool[index]), secret.hash(purpose, run, &pool[index].episode))
    });
    let hash = secret.hash(purpose, run, "start");
    let start = u64::from_le_bytes(hash[..8].try_into().unwrap_or_default()) as usize % sorted.len();
    (0..wanted.min(sorted.len())).map(|index| sorted[(index * sorted.len() + start) / wanted]).collect()
}

/// Episodes of one stratum have as many goals, told in the same ways.
fn stratum(episode: &PhaseEpisode) -> [usize; 4] {
    let told = |modality| episode.goals.iter().filter(|goal| goal.modality == modality).count();
    [episode.goals.len(), told(Modality::Category), told(Modality::Description), told(Modality::Image)]
}

#[cfg(test)]
mod tests;
