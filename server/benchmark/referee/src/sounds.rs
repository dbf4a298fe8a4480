use avln_episode::{Rules, SoundClip, Sounds};
use avln_truth::{EpisodeTruth, Target};
use avln_world::{Bank, ClipPool, Point3, Rng, SoundSource, Vector3};

/// Fewer clips than the rules ask for.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[error("rules '{rules}' draw {needed} clips for an episode and the bank holds {found}; give it more sounds")]
pub struct TooFewClips {
    rules: String,
    needed: usize,
    found: usize,
}

/// The bank that `sounds` names; `None` for recordings, which have to be read.
pub fn made_bank(sounds: &Sounds) -> Option<Bank> {
    let pool = match sounds {
        Sounds::All => ClipPool::All,
        Sounds::Train => ClipPool::Train,
        Sounds::Validation => ClipPool::Validation,
        Sounds::Test => ClipPool::Test,
        Sounds::Own(_) => return None,
    };
    Some(Bank::of(pool))
}

/// Where each target sounds from, world frame, metres.
pub fn source_positions(rules: &Rules, targets: &[Target]) -> Vec<Point3<f32>> {
    let lifted = |target: &Target| target.source + Vector3::y() * rules.source_lift_m;
    targets.iter().map(lifted).collect()
}

/// One source for each target. All begin at the same place of their clips.
pub(crate) fn sources(
    rules: &Rules,
    truth: &EpisodeTruth,
    bank: &Bank,
    rng: &mut Rng,
) -> Result<Vec<SoundSource>, TooFewClips> {
    let clips = clips(rules, &truth.targets, bank.len(), rng)?;
    let offset_samples = (rng.next_u64() >> 32) as usize;
    let source = |(position, clip)| Some(SoundSource { position, clip: bank.clip(clip)?, offset_samples });
    let positions = source_positions(rules, &truth.targets);
    Ok(positions.into_iter().zip(clips).filter_map(source).collect())
}

/// For each target the index of its clip, of `count`. Only by rules that leak are targets looked at.
fn clips(rules: &Rules, targets: &[Target], count: usize, rng: &mut Rng) -> Result<Vec<usize>, TooFewClips> {
    let needed = rules.clips_of_episode(targets.len());
    if count < needed {
        return Err(TooFewClips { rules: rules.name.clone(), needed, found: count });
    }
    Ok(match rules.sound_clip {
        SoundClip::Anonymous => vec![rng.below(count); targets.len()],
        SoundClip::Distinct => different(count, targets.len(), rng),
        SoundClip::ByCategory => targets.iter().map(|target| of_category(&target.category, count)).collect(),
    })
}

/// `wanted` different indices below `count`.
fn different(count: usize, wanted: usize, rng: &mut Rng) -> Vec<usize> {
    let mut indices: Vec<_> = (0..count).collect();
    rng.shuffle(&mut indices);
    indices.truncate(wanted);
    indices
}

/// The same in all episodes.
fn of_category(category: &str, count: usize) -> usize {
    Rng::new(0).fork(category).below(count)
}

#[cfg(test)]
mod tests;
