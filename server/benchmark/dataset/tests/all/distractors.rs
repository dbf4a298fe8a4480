//! Distractor sources of the missions in a house: constraints, and position as a cue.

use crate::{HOUSE, House};
use avln_dataset::{EpisodeSpec, MissionRules, SceneMissions, StepGoal, sample_missions};
use avln_geom::Point3;
use avln_houses::Pool;
use avln_truth::DistractorSource;
use std::{collections::BTreeSet, sync::LazyLock};

/// Missions of the house with distractors.
const PLAYED: usize = 200;

/// A house with two storeys, as in the recipe `paper`.
static STOREYS: LazyLock<House> = LazyLock::new(|| {
    let limits = MissionRules {
        goals: [2, 4],
        min_start_m: 3.0,
        min_separation_m: 2.0,
        distractors: [1, 6],
        steps: Some(StepGoal { mean: 172.5, spread: 0.5, draws: 6 }),
    };
    House::new(3, 9..=10, 2..=2, Pool::Validation, limits, PLAYED)
});

/// All missions of the house.
static SCENE: LazyLock<SceneMissions> = LazyLock::new(|| SceneMissions::new(HOUSE.missions.clone()));

/// Distractors of the first missions of the house.
static DRAWN: LazyLock<Vec<Drawn<'static>>> = LazyLock::new(|| drawn(&HOUSE, &SCENE));

/// A mission with its distractors.
type Drawn<'a> = (&'a EpisodeSpec, Vec<DistractorSource>);

fn drawn<'a>(house: &House, scene: &'a SceneMissions) -> Vec<Drawn<'a>> {
    let draw = |episode: &'a EpisodeSpec| {
        (episode, scene.distractor_sources(episode, &house.assets, episode.goals.len()))
    };
    scene.episodes().iter().take(PLAYED).map(draw).collect()
}

#[test]
fn distractors_are_distinct_targets_of_other_missions() {
    let pool: BTreeSet<u32> =
        HOUSE.missions.iter().flat_map(|mission| &mission.goals).map(|goal| goal.target.instance).collect();
    for (episode, distractors) in DRAWN.iter() {
        let goals: BTreeSet<u32> = episode.goals.iter().map(|goal| goal.target.instance).collect();
        let ids: BTreeSet<u32> = distractors.iter().map(|distractor| distractor.instance).collect();
        assert_eq!(ids.len(), goals.len(), "{}", episode.id);
        assert!(ids.is_subset(&pool) && ids.is_disjoint(&goals), "{}", episode.id);
        assert_eq!(SCENE.distractor_candidates(episode), pool.len() - goals.len());
    }
}

#[test]
fn distractor_draw_ignores_goal_order_and_cues() {
    for episode in HOUSE.missions.iter().take(20) {
        let mut other = episode.clone();
        let (first, last) = (0, other.goals.len() - 1);
        let cues = [other.goals[first].cue.clone(), other.goals[last].cue.clone()];
        [other.goals[last].cue, other.goals[first].cue] = cues;
        other.goals.iter_mut().for_each(|goal| goal.target.category = "other".to_owned());
        let draw = |episode| SCENE.distractor_sources(episode, &HOUSE.assets, 3);
        assert_eq!(draw(episode), draw(&other), "{}", episode.id);
    }
}

#[test]
fn small_scenes_have_fewer_candidates() {
    let first = &HOUSE.missions[0];
    let scene = SceneMissions::new(vec![first.clone()]);
    assert_eq!(scene.distractor_candidates(first), 0);
    assert_eq!(scene.distractor_sources(first, &HOUSE.assets, 3), []);
    assert_eq!(SCENE.distractor_sources(first, &HOUSE.assets, 0), []);
}

/// Number that a position shows, given the start and the other sources.
type Feature = fn(&Point3<f32>, &Point3<f32>, &[Point3<f32>]) -> f32;

const FEATURES: [(&str, Feature); 4] = [
    ("distance from the start", |source, start, _| (source - start).norm()),
    ("height", |source, start, _| source.y - start.y),
    ("distance to the nearest source", |source, _, others| {
        others.iter().map(|other| (source - other).norm()).fold(f32::INFINITY, f32::min)
    }),
    ("mean distance to sources", |source, _, others| {
        others.iter().map(|other| (source - other).norm()).sum::<f32>() / others.len() as f32
    }),
];

/// Returns the mean share of pairs of a target and a distractor in which the target has the larger value, and the standard
/// deviation of the mean.
fn share(drawn: &[Drawn], feature: Feature) -> (f64, f64) {
    let of_episode = |(episode, distractors): &Drawn| {
        let targets = episode.goals.iter().map(|goal| goal.target.source);
        let all: Vec<_> = targets.chain(distractors.iter().map(|distractor| distractor.source)).collect();
        let value = |source: usize| {
            let others: Vec<_> = all
                .iter()
                .enumerate()
                .filter(|(index, _)| *index != source)
                .map(|(_, place)| *place)
                .collect();
            feature(&all[source], &episode.start.position, &others)
        };
        let goals = episode.goals.len();
        let pairs =
            (0..goals).flat_map(|target| (goals..all.len()).map(move |other| (value(target), value(other))));
        let larger = pairs
            .map(|(target, other)| if target == other { 0.5 } else { f64::from(u8::from(target > other)) });
        larger.sum::<f64>() / (goals * distractors.len()) as f64
    };
    let shares: Vec<f64> = drawn.iter().map(of_episode).collect();
    let count = shares.len() as f64;
    let mean = shares.iter().sum::<f64>() / count;
    let variance = shares.iter().map(|share| (share - mean).powi(2)).sum::<f64>() / count;
    (mean, (variance / count).sqrt())
}

/// Bias that the finite number of objects in a house causes, besides chance.
const TOLERANCE: f64 = 0.05;

fn check_positions(drawn: &[Drawn]) {
    for (name, feature) in FEATURES {
        let (share, deviation) = share(drawn, feature);
        let most = TOLERANCE + 3.0 * deviation;
        assert!(
            (share - 0.5).abs() <= most,
            "{name}: targets are larger in {share:.3} of the pairs, {deviation:.3}"
        );
    }
}

#[test]
fn position_does_not_distinguish_distractors() {
    check_positions(&DRAWN);
}

#[test]
fn positions_of_long_missions_do_not_distinguish_distractors() {
    // Targets of missions with a wanted length are farther apart than objects drawn without it.
    let mut options = HOUSE.limits.options(PLAYED, 9);
    options.steps = Some(StepGoal { mean: 110.0, spread: 0.2, draws: 12 });
    let missions = sample_missions(&HOUSE.assets, &HOUSE.instances, &HOUSE.rules, &options);
    check_positions(&drawn(&HOUSE, &SceneMissions::new(missions)));
}

#[test]
fn positions_in_two_storeys_do_not_distinguish_distractors() {
    check_positions(&drawn(&STOREYS, &SceneMissions::new(STOREYS.missions.clone())));
}

#[test]
fn position_of_the_nearest_objects_is_seen_to_leak() {
    let nearest = |episode: &'static EpisodeSpec| {
        let goals = HOUSE.missions.iter().flat_map(|mission| &mission.goals).map(|goal| &goal.target);
        let is_goal = |id: u32| episode.goals.iter().any(|goal| goal.target.instance == id);
        let away_m = |source: &Point3<f32>| (source - episode.start.position).norm();
        let mut all: Vec<_> = goals.filter(|target| !is_goal(target.instance)).collect();
        all.sort_by(|a, b| away_m(&a.source).total_cmp(&away_m(&b.source)).then(a.instance.cmp(&b.instance)));
        all.dedup_by_key(|target| target.instance);
        let source = |target: &avln_truth::Target| DistractorSource {
            instance: target.instance,
            category: target.category.clone(),
            source: target.source,
        };
        (episode, all.into_iter().take(episode.goals.len()).map(source).collect::<Vec<_>>())
    };
    let drawn: Vec<_> = HOUSE.missions.iter().take(100).map(nearest).collect();
    assert!(share(&drawn, FEATURES[0].1).0 > 0.8, "this test sees a leak");
}
