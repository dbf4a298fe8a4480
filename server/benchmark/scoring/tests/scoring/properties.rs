//! Properties of every score, on random records.

use crate::script::{Did, record, truth};
use avln_episode::{Action, EndReason, Order, Rules};
use avln_scoring::{Entry, EpisodeScore, Key, RankedEntry, Summary, rank, score, summarise};

/// A small generator for test data (Knuth's MMIX constants).
struct Draw(u64);

impl Draw {
    fn below(&mut self, count: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % count
    }
    fn chance(&mut self, percent: u64) -> bool {
        self.below(100) < percent
    }
}

fn random_did(draw: &mut Draw, goals: u64) -> Did {
    let action = Action::ALL[draw.below(5) as usize];
    let completed = draw.chance(40).then(|| draw.below(goals) as u8);
    let moved_m = if action == Action::MoveForward { draw.below(100) as f32 / 400.0 } else { 0.0 };
    let in_region = if draw.chance(5) { draw.below(16) as u8 } else { 0 };
    Did { action, moved_m, collided: draw.chance(10), in_region, completed, wrong_instance: None }
}

fn random_score(draw: &mut Draw, index: u64) -> EpisodeScore {
    let goals = 2 + draw.below(3);
    let script: Vec<Did> = (0..draw.below(60)).map(|_| random_did(draw, goals)).collect();
    let start = (0..goals).map(|_| draw.chance(5)).collect();
    let (episode, scene) = (format!("e{index}"), format!("s{}", index % 7));
    let reference_m = draw.below(40) as f64 * 0.1;
    let truth = truth(&episode, &scene, Order::Unordered, goals as usize, reference_m);
    let metrics = score(&truth, &record(&script, start, EndReason::StepLimit), &Rules::paper());
    EpisodeScore { episode, scene, order: Order::Unordered, metrics }
}

fn random_scores(seed: u64, count: u64) -> Vec<EpisodeScore> {
    let mut draw = Draw(seed);
    (0..count).map(|index| random_score(&mut draw, index)).collect()
}

#[test]
fn metrics_satisfy_their_inequalities() {
    let mut successes = 0;
    for s in random_scores(3, 2000) {
        let m = &s.metrics;
        assert!(m.isr <= m.osr && m.osr_all <= m.osr, "{m:?}");
        assert!(m.spl <= m.sr && m.sr <= m.isr && m.sna <= m.sr, "{m:?}");
        assert!(m.spl <= m.soft_spl && m.soft_spl <= m.isr, "{m:?}");
        assert!(
            [m.sr, m.isr, m.osr, m.spl, m.soft_spl, m.sna].iter().all(|v| (0.0..=1.0).contains(v)),
            "{m:?}"
        );
        successes += m.sr as u32;
    }
    assert!(successes > 100, "only {successes} successes");
}

#[test]
fn summary_is_independent_of_episode_order() {
    let scores = random_scores(5, 200);
    let mut permuted = scores.clone();
    permuted.reverse();
    permuted.rotate_left(77);
    assert_eq!(summarise(&scores, 4), summarise(&permuted, 4));
    assert_eq!(summarise(&[], 4), None);
}

#[test]
fn means_lie_in_their_intervals() {
    for seed in 0..20 {
        let summary = summarise(&random_scores(seed, 1 + seed * 3), seed).expect("some episodes");
        for estimate in [summary.sr, summary.isr, summary.osr, summary.spl, summary.soft_spl, summary.sna] {
            assert!(estimate.low <= estimate.value && estimate.value <= estimate.high, "{estimate:?}");
        }
        assert!(summary.spl.value <= summary.sr.value && summary.isr.value <= summary.osr.value);
    }
}

fn with_isr(scores: &[EpisodeScore], change: impl Fn(usize, f64) -> f64) -> Vec<EpisodeScore> {
    let mut scores = scores.to_vec();
    for (index, s) in scores.iter_mut().enumerate() {
        s.metrics.isr = change(index, s.metrics.isr);
    }
    scores
}

fn competing<'a>(summary: &'a Summary, scores: &'a [EpisodeScore]) -> Entry<'a> {
    Entry { summary, scores, is_ranked: true }
}

/// Rank and tie group of a competing entry.
fn rank_and_group(place: &RankedEntry) -> (u32, u32) {
    place.standing.map(|standing| (standing.rank, standing.tie_group)).expect("a rank")
}

#[test]
fn references_are_sorted_without_a_rank() {
    let base = random_scores(8, 140);
    let runs = [0.0, 0.5, 0.25].map(|more| with_isr(&base, |_, isr| isr + more));
    let summaries = runs.each_ref().map(|run| summarise(run, 1).expect("episodes"));
    let mut entries = [0, 1, 2].map(|index| competing(&summaries[index], &runs[index]));
    entries[1].is_ranked = false;
    let places = rank(&entries, Key::Isr, 1);
    assert_eq!(places.iter().map(|place| place.entry).collect::<Vec<_>>(), [1, 2, 0]);
    assert_eq!(
        (places[0].standing, rank_and_group(&places[1]), rank_and_group(&places[2])),
        (None, (1, 1), (2, 2))
    );
}

#[test]
fn equal_entries_share_a_rank() {
    let base = random_scores(8, 140);
    let runs =
        [with_isr(&base, |_, isr| isr), with_isr(&base, |_, isr| isr + 0.5), with_isr(&base, |_, isr| isr)];
    let summaries: Vec<Summary> = runs.iter().map(|run| summarise(run, 1).expect("episodes")).collect();
    let entries: Vec<Entry<'_>> =
        summaries.iter().zip(&runs).map(|(summary, scores)| competing(summary, scores)).collect();
    let places = rank(&entries, Key::Isr, 1);
    let standings: Vec<_> = places.iter().map(|place| (place.entry, rank_and_group(place))).collect();
    assert_eq!(standings, [(1, (1, 1)), (0, (2, 2)), (2, (2, 2))]);
}

#[test]
fn insignificant_difference_keeps_one_tie_group() {
    let base = random_scores(8, 140);
    // Up in one half of the scenes, a little less down in the other.
    let noisy = with_isr(&base, |index, isr| isr + if (index % 7) < 4 { 0.2 } else { -0.25 });
    let summaries = [summarise(&base, 1).expect("episodes"), summarise(&noisy, 1).expect("episodes")];
    let entries = [competing(&summaries[0], &base), competing(&summaries[1], &noisy)];
    let places = rank(&entries, Key::Isr, 1);
    assert_eq!((places[0].entry, places[1].entry), (1, 0));
    assert_eq!(rank_and_group(&places[1]), (2, 1));
}

#[test]
fn fewer_steps_rank_higher() {
    let quick = random_scores(1, 20);
    let mut slow = quick.clone();
    slow.iter_mut().for_each(|s| s.metrics.steps += 50);
    let summaries = [summarise(&slow, 1).expect("episodes"), summarise(&quick, 1).expect("episodes")];
    let entries = [competing(&summaries[0], &slow), competing(&summaries[1], &quick)];
    let places = rank(&entries, Key::Steps, 1);
    assert_eq!(
        (places[0].entry, rank_and_group(&places[0]), rank_and_group(&places[1])),
        (1, (1, 1), (2, 2))
    );
}
