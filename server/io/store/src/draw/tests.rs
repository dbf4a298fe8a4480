use super::*;
use crate::GoalText;
use std::collections::{BTreeMap, BTreeSet};

const SECRET: PhaseSecret = PhaseSecret([7; 32]);

/// Episodes of two to four goals whose first is told in any way.
fn pool(size: usize) -> Vec<PhaseEpisode> {
    let ways = [Modality::Category, Modality::Description, Modality::Image];
    let goal = |modality| GoalText { modality, text: None };
    let episode = |index: usize| {
        let mut goals = vec![goal(ways[index % 3])];
        goals.resize(2 + index / 3 % 3, goal(Modality::Category));
        PhaseEpisode { episode: format!("e{index}"), scene: String::new(), goals }
    };
    (0..size).map(episode).collect()
}

fn sampling(episodes: u32, anchors: u32) -> Sampling {
    Sampling { shuffle: true, sample: Some(Sample { episodes, anchors }) }
}

fn run(number: usize) -> String {
    format!("run_{number}")
}

#[test]
fn the_same_secret_and_run_draw_the_same_and_others_do_not() {
    let pool = pool(90);
    let first = draw(&pool, sampling(30, 6), &SECRET, "run_1");
    assert_eq!(first, draw(&pool, sampling(30, 6), &SECRET, "run_1"));
    assert_ne!(first, draw(&pool, sampling(30, 6), &SECRET, "run_2"));
    assert_ne!(first, draw(&pool, sampling(30, 6), &PhaseSecret([8; 32]), "run_1"));
    assert_eq!(draw(&pool, Sampling::default(), &SECRET, "run_1"), (0..90).collect::<Vec<_>>());
}

#[test]
fn runs_share_the_anchors_and_no_episode_comes_twice() {
    let pool = pool(200);
    let mut common: Option<BTreeSet<usize>> = None;
    for number in 0..60 {
        let drawn = draw(&pool, sampling(40, 10), &SECRET, &run(number));
        let set: BTreeSet<usize> = drawn.iter().copied().collect();
        assert_eq!((drawn.len(), set.len()), (40, 40));
        common = Some(common.map_or(set.clone(), |common| common.intersection(&set).copied().collect()));
    }
    assert_eq!(common.map(|common| common.len()), Some(10));
}

#[test]
fn every_stratum_has_its_share_in_every_sample() {
    let pool = pool(270);
    for number in 0..40 {
        let mut counts: BTreeMap<[usize; 4], i64> = BTreeMap::new();
        for index in draw(&pool, sampling(90, 0), &SECRET, &run(number)) {
            *counts.entry(stratum(&pool[index])).or_default() += 1;
        }
        // Nine strata of 30 episodes each, a third of which is drawn.
        assert_eq!(counts.len(), 9);
        assert!(counts.values().all(|count| (count - 10).abs() <= 1), "{counts:?}");
    }
}

#[test]
fn every_episode_is_as_likely_as_any_other() {
    let (pool, runs) = (pool(60), 3000);
    let mut times = vec![0_u32; pool.len()];
    for number in 0..runs {
        for index in draw(&pool, sampling(20, 0), &SECRET, &run(number)) {
            times[index] += 1;
        }
    }
    // Binomial with 3000 draws at a third: mean 1000, standard deviation 26; five of them on either side.
    assert!(times.iter().all(|count| count.abs_diff(1000) < 130), "{times:?}");
}

#[test]
fn the_place_in_the_order_tells_nothing_of_the_episode() {
    let (pool, runs, sampling) = (pool(8), 4000, Sampling { shuffle: true, sample: None });
    let mut times = [[0_f64; 8]; 8];
    for number in 0..runs {
        for (place, index) in draw(&pool, sampling, &SECRET, &run(number)).into_iter().enumerate() {
            times[place][index] += 1.0;
        }
    }
    let expected = runs as f64 / 8.0;
    let chi_square: f64 = times.iter().flatten().map(|count| (count - expected).powi(2) / expected).sum();
    // 49 degrees of freedom: 99.99 % of draws lie below 95.
    assert!((15.0..95.0).contains(&chi_square), "{chi_square}");
}

#[test]
fn no_two_runs_places_or_attempts_share_a_handle() {
    let mut handles = BTreeSet::new();
    for (number, ordinal) in (0..50).flat_map(|number| (0..20).map(move |ordinal| (number, ordinal))) {
        for attempt in 1..=3 {
            let handle = SECRET.handle(&run(number), ordinal, attempt);
            assert_eq!(handle.len(), 35);
            assert!(handles.insert(handle));
        }
    }
}
