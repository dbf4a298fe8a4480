//! An episode's sound clips and sources.

use avln_episode::{Rules, SoundClip, Sounds};
use avln_truth::{DistractorSource, EpisodeTruth, Target};
use avln_world::{Bank, ClipPool, Point3, Rng, SoundSource, Vector3};

/// Too few clips for the rules.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[error("rules '{rules}' need {needed} clips per episode, the bank has {found}; add sounds to the bank")]
pub struct TooFewClips {
    rules: String,
    needed: usize,
    found: usize,
}

/// Returns the procedural bank for `sounds`; `None` for recordings.
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

/// Returns the source position per target, world frame, metres.
pub fn source_positions(rules: &Rules, targets: &[Target]) -> Vec<Point3<f32>> {
    let lifted = |target: &Target| target.source + Vector3::y() * rules.source_lift_m;
    targets.iter().map(lifted).collect()
}

/// Returns the positions of all sources in an episode, world frame, metres: targets, then distractors.
pub fn episode_sources(rules: &Rules, truth: &EpisodeTruth) -> Vec<Point3<f32>> {
    let lifted = |distractor: &DistractorSource| distractor.source + Vector3::y() * rules.source_lift_m;
    let distractors = truth.distractor_sources.iter().map(lifted);
    source_positions(rules, &truth.targets).into_iter().chain(distractors).collect()
}

/// Returns the sounds of an episode as its referee plays them: targets, then the distractors of the rules.
///
/// # Errors
/// If the bank has too few clips.
pub fn episode_sounds(
    rules: &Rules,
    truth: &EpisodeTruth,
    bank: &Bank,
) -> Result<Vec<SoundSource>, TooFewClips> {
    let mut sounds = sources(rules, truth, bank, &mut Rng::new(truth.seed).fork("clips"))?;
    sounds.truncate(rules.sounding_sources(truth.targets.len()));
    Ok(sounds)
}

/// Returns a sound per source, all with the same clip offset.
pub(crate) fn sources(
    rules: &Rules,
    truth: &EpisodeTruth,
    bank: &Bank,
    rng: &mut Rng,
) -> Result<Vec<SoundSource>, TooFewClips> {
    let clips = clips(rules, truth, bank.len(), rng)?;
    let offset_samples = (rng.next_u64() >> 32) as usize;
    let source = |(position, clip)| Some(SoundSource { position, clip: bank.clip(clip)?, offset_samples });
    let positions = episode_sources(rules, truth);
    Ok(positions.into_iter().zip(clips).filter_map(source).collect())
}

/// Returns the clip index per source. Only leaking rules depend on the source.
fn clips(
    rules: &Rules,
    truth: &EpisodeTruth,
    count: usize,
    rng: &mut Rng,
) -> Result<Vec<usize>, TooFewClips> {
    let needed = rules.clips_of_episode(truth.targets.len());
    if count < needed {
        return Err(TooFewClips { rules: rules.name.clone(), needed, found: count });
    }
    let sources = truth.targets.len() + truth.distractor_sources.len();
    Ok(match rules.sound_clip {
        SoundClip::Anonymous => vec![rng.below(count); sources],
        SoundClip::Distinct => different(count, sources, rng),
        SoundClip::ByCategory => {
            let targets = truth.targets.iter().map(|target| &target.category);
            let distractors = truth.distractor_sources.iter().map(|distractor| &distractor.category);
            targets.chain(distractors).map(|category| of_category(category, count)).collect()
        }
    })
}

/// Draws `wanted` distinct indices below `count`.
fn different(count: usize, wanted: usize, rng: &mut Rng) -> Vec<usize> {
    let mut indices: Vec<_> = (0..count).collect();
    rng.shuffle(&mut indices);
    indices.truncate(wanted);
    indices
}

/// Returns a category's clip index, equal in all episodes.
fn of_category(category: &str, count: usize) -> usize {
    Rng::new(0).fork(category).below(count)
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_episode::{Modality, Order, Pose};
    use avln_world::{Aabb, Point3};
    use std::sync::LazyLock;

    const EPISODES: u64 = 10_000;
    const CATEGORIES: usize = 21;
    /// Clips per bank; families have ten consecutive clips.
    const CLIPS: usize = 100;
    const FAMILIES: usize = 10;

    /// Drawn clip and hidden facts for a target.
    struct Heard {
        clip: usize,
        category: usize,
        modality: usize,
        goal: usize,
        /// Distance, whole metres.
        distance: usize,
        /// Class by instance id.
        identity: usize,
    }

    /// Hidden fact with the value count.
    type Fact = (&'static str, usize, fn(&Heard) -> usize);

    const FACTS: [Fact; 5] = [
        ("category", CATEGORIES, |heard| heard.category),
        ("modality", 3, |heard| heard.modality),
        ("goal", 4, |heard| heard.goal),
        ("distance", 16, |heard| heard.distance),
        ("identity", 8, |heard| heard.identity),
    ];

    fn target(rng: &mut Rng) -> Target {
        let place = Point3::new(rng.range(-20.0, 20.0), 1.0, rng.range(-20.0, 20.0));
        let modalities = [Modality::Category, Modality::Description, Modality::Image];
        Target {
            instance: 1 + rng.below(400) as u32,
            category: format!("category {}", rng.below(CATEGORIES)),
            modality: modalities[rng.below(3)],
            bounds: Aabb::new(place, place),
            source: place,
            floor_y_m: 0.0,
            region: Vec::new(),
            viewpoints: Vec::new(),
            start_distance_m: rng.unit() * 16.0,
        }
    }

    fn episode(rng: &mut Rng) -> EpisodeTruth {
        EpisodeTruth {
            episode: String::new(),
            scene: String::new(),
            seed: rng.next_u64(),
            start: Pose::new(Point3::origin(), 0.0),
            order: Order::Ordered,
            targets: (0..4).map(|_| target(rng)).collect(),
            distractor_sources: Vec::new(),
            reference_m: 0.0,
            reference_path: Vec::new(),
        }
    }

    /// Draws a target per episode, so that all are independent.
    fn heard(sound_clip: SoundClip) -> Vec<Heard> {
        let rules = Rules { sound_clip, ..Rules::paper() };
        let mut rng = Rng::new(2);
        let one = |number: u64| {
            let truth = episode(&mut rng);
            let clips = clips(&rules, &truth, CLIPS, &mut Rng::new(truth.seed).fork("clips"));
            let goal = number as usize % truth.targets.len();
            let target = &truth.targets[goal];
            Heard {
                clip: clips.expect("enough clips")[goal],
                category: target
                    .category
                    .rsplit(' ')
                    .next()
                    .and_then(|number| number.parse().ok())
                    .expect("a number"),
                modality: target.modality as usize,
                goal,
                distance: target.start_distance_m as usize,
                identity: target.instance as usize % 8,
            }
        };
        (0..EPISODES).map(one).collect()
    }

    /// Pearson's chi-square and mutual information in bits for a contingency table, corrected for chance (Miller 1955).
    fn dependence(pairs: &[(usize, usize)], rows: usize, columns: usize) -> (f64, f64) {
        let mut table = vec![0.0; rows * columns];
        pairs.iter().for_each(|&(row, column)| table[row * columns + column] += 1.0);
        let total = pairs.len() as f64;
        let row_sum = |row: usize| table[row * columns..][..columns].iter().sum::<f64>();
        let column_sum = |column: usize| table.iter().skip(column).step_by(columns).sum::<f64>();
        let (mut chi_square, mut bits) = (0.0, 0.0);
        for (place, &count) in table.iter().enumerate() {
            let expected = row_sum(place / columns) * column_sum(place % columns) / total;
            chi_square += (count - expected) * (count - expected) / expected.max(1e-9);
            bits += if count > 0.0 { count / total * f64::log2(count / expected) } else { 0.0 };
        }
        let freedom = ((rows - 1) * (columns - 1)) as f64;
        (chi_square, bits - freedom / (2.0 * total * std::f64::consts::LN_2))
    }

    /// Standard deviations above the chi-square mean (Wilson and Hilferty 1931): 2.33 has a probability of 1 %.
    fn deviations(chi_square: f64, freedom: f64) -> f64 {
        let spread = 2.0 / (9.0 * freedom);
        ((chi_square / freedom).cbrt() - (1.0 - spread)) / spread.sqrt()
    }

    #[test]
    fn clips_are_independent_of_hidden_facts() {
        for mode in [SoundClip::Anonymous, SoundClip::Distinct] {
            let heard = heard(mode);
            for (name, values, fact) in FACTS {
                let pairs: Vec<_> =
                    heard.iter().map(|heard| (heard.clip * FAMILIES / CLIPS, fact(heard))).collect();
                let (chi_square, bits) = dependence(&pairs, FAMILIES, values);
                let deviations = deviations(chi_square, ((FAMILIES - 1) * (values - 1)) as f64);
                assert!(deviations < 2.33, "{mode:?}, {name}: {deviations} standard deviations from chance");
                assert!(bits < 0.01, "{mode:?}: a clip reveals {bits} bits of the {name}");
            }
        }
    }

    #[test]
    fn clips_do_not_distinguish_distractors() {
        let mut rng = Rng::new(6);
        let distractor = |rng: &mut Rng| {
            let Target { instance, category, source, .. } = target(rng);
            DistractorSource { instance, category, source }
        };
        for sound_clip in [SoundClip::Anonymous, SoundClip::Distinct] {
            let rules = Rules { sound_clip, ..Rules::hard() };
            let one = |number: u64| {
                let distractor_sources = (0..4).map(|_| distractor(&mut rng)).collect();
                let truth = EpisodeTruth { distractor_sources, ..episode(&mut rng) };
                let clips = clips(&rules, &truth, CLIPS, &mut Rng::new(truth.seed).fork("clips"));
                let (clips, source) = (clips.expect("enough clips"), number as usize % 8);
                assert_eq!(clips.len(), 8);
                (clips[source] * FAMILIES / CLIPS, usize::from(source < 4))
            };
            let pairs: Vec<_> = (0..EPISODES).map(one).collect();
            let (chi_square, bits) = dependence(&pairs, FAMILIES, 2);
            let deviations = deviations(chi_square, (FAMILIES - 1) as f64);
            assert!(deviations < 2.33 && bits < 0.01, "{sound_clip:?}: {deviations} deviations, {bits} bits");
        }
    }

    #[test]
    fn clips_by_category_are_seen_to_leak() {
        let heard = heard(SoundClip::ByCategory);
        let pairs: Vec<_> =
            heard.iter().map(|heard| (heard.clip * FAMILIES / CLIPS, heard.category)).collect();
        let (chi_square, bits) = dependence(&pairs, FAMILIES, CATEGORIES);
        assert!(deviations(chi_square, 180.0) > 100.0 && bits > 2.0, "{bits} bits");
    }

    #[test]
    fn clips_are_equal_or_distinct_by_the_rules() {
        let mut rng = Rng::new(3);
        for _ in 0..1000 {
            let truth = episode(&mut rng);
            let draw = |sound_clip| {
                let rules = Rules { sound_clip, ..Rules::paper() };
                clips(&rules, &truth, CLIPS, &mut Rng::new(truth.seed)).expect("enough clips")
            };
            let same = draw(SoundClip::Anonymous);
            assert!(same.iter().all(|&clip| clip == same[0]));
            let mut different = draw(SoundClip::Distinct);
            different.sort_unstable();
            different.dedup();
            assert_eq!(different.len(), 4);
        }
    }

    #[test]
    fn sources_share_one_clip_offset() {
        let truth = episode(&mut Rng::new(4));
        let bank = Bank::default();
        for rules in [Rules::paper(), Rules::authors(), Rules::distinct()] {
            let sources = sources(&rules, &truth, &bank, &mut Rng::new(5)).expect("enough clips");
            assert_eq!(sources.len(), 4);
            assert!(sources.iter().all(|source| source.offset_samples == sources[0].offset_samples));
            assert!((1..1 << 32).contains(&sources[0].offset_samples), "drawn from 32 bits");
            let lift = |(source, target): (&SoundSource, &Target)| source.position.y - target.source.y;
            assert!(
                sources
                    .iter()
                    .zip(&truth.targets)
                    .map(lift)
                    .all(|lift| (lift - rules.source_lift_m).abs() < 1e-5)
            );
        }
    }

    /// Features of a dry sound: autocorrelation, peak sharpness, level variation.
    fn features(samples: &[f32]) -> [f32; 10] {
        let mean = |values: &mut dyn Iterator<Item = f32>| values.sum::<f32>() / samples.len() as f32;
        let power = mean(&mut samples.iter().map(|sample| sample * sample));
        let alike = |lag: usize| mean(&mut samples.iter().zip(&samples[lag..]).map(|(a, b)| a * b)) / power;
        let fourth = mean(&mut samples.iter().map(|sample| sample.powi(4))) / (power * power);
        let swing = |frame: usize| {
            let level =
                |frame: &[f32]| frame.iter().map(|sample| sample * sample).sum::<f32>() / frame.len() as f32;
            let square = |frame: &[f32]| (level(frame) / power).powi(2) * frame.len() as f32;
            mean(&mut samples.chunks(frame).map(square))
        };
        [
            alike(1),
            alike(2),
            alike(3),
            alike(5),
            alike(8),
            alike(20),
            fourth,
            swing(80),
            swing(400),
            swing(2000),
        ]
    }

    /// Features for two seconds of all clips, normalised to mean 0 and deviation 1.
    static FEATURES: LazyLock<Vec<[f32; 10]>> = LazyLock::new(|| {
        let mut all: Vec<_> = Bank::default().clips().map(|clip| features(&clip.samples[..32_000])).collect();
        for feature in 0..10 {
            let mean = all.iter().map(|row| row[feature]).sum::<f32>() / CLIPS as f32;
            let variance = all.iter().map(|row| (row[feature] - mean).powi(2)).sum::<f32>() / CLIPS as f32;
            all.iter_mut().for_each(|row| row[feature] = (row[feature] - mean) / variance.sqrt());
        }
        all
    });

    /// Accuracy of a nearest-mean classifier on the second half of `heard`, and of the most common value.
    fn guessed(heard: &[Heard], values: usize, fact: fn(&Heard) -> usize) -> (f64, f64) {
        let (known, unknown) = heard.split_at(heard.len() / 2);
        let mean = |value: usize| {
            let rows: Vec<_> =
                known.iter().filter(|heard| fact(heard) == value).map(|heard| FEATURES[heard.clip]).collect();
            std::array::from_fn(|feature| {
                rows.iter().map(|row| row[feature]).sum::<f32>() / rows.len() as f32
            })
        };
        let means: Vec<[f32; 10]> = (0..values).map(mean).collect();
        let far = |heard: &Heard, value: usize| -> f32 {
            FEATURES[heard.clip].iter().zip(&means[value]).map(|(a, b)| (a - b).powi(2)).sum()
        };
        let guess = |heard: &Heard| (0..values).min_by(|&a, &b| far(heard, a).total_cmp(&far(heard, b)));
        let share = |right: &dyn Fn(&&Heard) -> bool| {
            unknown.iter().filter(right).count() as f64 / unknown.len() as f64
        };
        let commonest = (0..values).map(|value| share(&|heard| fact(heard) == value)).fold(0.0, f64::max);
        (share(&|heard| guess(heard) == Some(fact(heard))), commonest)
    }

    #[test]
    fn dry_sound_reveals_no_hidden_fact() {
        for mode in [SoundClip::Anonymous, SoundClip::Distinct] {
            let heard = heard(mode);
            for (name, values, fact) in FACTS {
                let (right, chance) = guessed(&heard, values, fact);
                let deviation = (chance * (1.0 - chance) / (EPISODES / 2) as f64).sqrt();
                assert!(
                    right <= chance + 3.0 * deviation,
                    "{mode:?}, {name}: {right} are right, {chance} by chance"
                );
            }
        }
        let (right, chance) = guessed(&heard(SoundClip::ByCategory), CATEGORIES, |heard| heard.category);
        assert!(right > 0.8, "this test sees a leak: {right} are right, {chance} by chance");
    }
}
