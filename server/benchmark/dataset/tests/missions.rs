//! Hundreds of missions in one house keep every constraint; a mission that breaks one is caught, with its name.

use avln_dataset::{
    Constraint, CueSpec, Depth, Description, EpisodeSpec, Fault, Instance, MissionRules, SceneSource,
    SceneSpec, StepGoal, SurveyOptions, check_scene, sample_missions, survey,
};
use avln_episode::{Modality, Rules};
use avln_geom::Point3;
use avln_houses::Pool;
use avln_world::SceneAssets;
use std::{collections::BTreeMap, sync::LazyLock};

const MISSIONS: usize = 1500;
const ALL: Depth = Depth { every: 1, survey: None };

struct House {
    assets: SceneAssets,
    instances: Vec<Instance>,
    rules: Rules,
    limits: MissionRules,
    missions: Vec<EpisodeSpec>,
}

static HOUSE: LazyLock<House> = LazyLock::new(|| {
    let source = SceneSource::Procedural { seed: 21, rooms: 7..=8, storeys: 1..=1, pool: Pool::Train };
    let rules = Rules::paper();
    let (spec, _) = SceneSpec::new("house", source).expect("a house");
    let assets = spec.open(&rules).expect("it can be lived in");
    let instances = survey(&assets, &rules);
    let limits = MissionRules {
        goals: [2, 4],
        min_start_m: 1.5,
        min_separation_m: 1.0,
        distractors: [0, 255],
        steps: None,
    };
    let missions = sample_missions(&assets, &instances, &rules, &limits.options(MISSIONS, 5));
    House { assets, instances, rules, limits, missions }
});

fn check(missions: &[EpisodeSpec], depth: Depth) -> Vec<Fault> {
    check_scene(&HOUSE.assets, &HOUSE.rules, &HOUSE.limits, missions, depth)
}

#[test]
fn every_mission_keeps_every_constraint() {
    assert_eq!(HOUSE.missions.len(), MISSIONS);
    let survey = SurveyOptions::default();
    assert_eq!(check(&HOUSE.missions, Depth { every: 25, survey: Some(&survey) }), []);
}

#[test]
fn goal_counts_and_modalities_come_in_thirds_and_targets_take_turns() {
    let mut counts = BTreeMap::new();
    HOUSE.missions.iter().for_each(|mission| *counts.entry(mission.goals.len()).or_insert(0) += 1);
    assert!(counts.values().all(|&count| count > MISSIONS / 4), "{counts:?}");
    let goals = || HOUSE.missions.iter().flat_map(|mission| &mission.goals);
    let total = goals().count();
    for modality in [Modality::Category, Modality::Description, Modality::Image] {
        let count = goals().filter(|goal| goal.cue.modality() == modality).count();
        assert!((total * 3 / 10..total * 37 / 100).contains(&count), "{modality:?}: {count} of {total}");
    }
    let mut uses: BTreeMap<u32, usize> = BTreeMap::new();
    goals().for_each(|goal| *uses.entry(goal.target.instance).or_default() += 1);
    assert!(uses.len() * 10 >= HOUSE.instances.len() * 9, "{} of {} used", uses.len(), HOUSE.instances.len());
    let mean = total / uses.len();
    assert!(uses.values().all(|&count| count <= 3 * mean), "{uses:?}");
}

#[test]
fn a_seed_gives_the_same_missions_and_more_of_them_begin_alike() {
    let draw = |count, seed| {
        sample_missions(&HOUSE.assets, &HOUSE.instances, &HOUSE.rules, &HOUSE.limits.options(count, seed))
    };
    assert_eq!(draw(40, 5), HOUSE.missions[..40]);
    assert_ne!(draw(40, 6), HOUSE.missions[..40]);
}

#[test]
fn wanted_steps_are_drawn_near() {
    let mean = |steps: Option<StepGoal>| {
        let limits = MissionRules { steps, ..HOUSE.limits.clone() };
        let missions =
            sample_missions(&HOUSE.assets, &HOUSE.instances, &HOUSE.rules, &limits.options(120, 3));
        missions.iter().map(|mission| f64::from(mission.ordered.steps)).sum::<f64>() / 120.0
    };
    let as_they_come = mean(None);
    let wanted = 1.2 * as_they_come;
    let drawn = mean(Some(StepGoal { mean: wanted, spread: 0.3, draws: 8 }));
    assert!((drawn - wanted).abs() < 0.1 * wanted, "{drawn} for {wanted}; {as_they_come} as they come");
}

/// The first mission after a change, and what the check says of it.
fn broken(change: impl FnOnce(&mut EpisodeSpec)) -> Vec<Constraint> {
    let mut mission = HOUSE.missions[0].clone();
    change(&mut mission);
    let faults = check(&[mission], ALL);
    assert!(faults.iter().all(|fault| fault.mission == "house-0000"), "{faults:?}");
    faults.into_iter().map(|fault| fault.constraint).collect()
}

#[test]
fn composition_is_checked() {
    assert_eq!(broken(|_| {}), []);
    assert!(broken(|m| m.goals.truncate(1)).contains(&Constraint::GoalCount));
    let alike = broken(|m| m.goals.iter_mut().for_each(|goal| goal.cue = CueSpec::Category));
    assert_eq!(alike, [Constraint::Modalities]);
    let twice = broken(|m| m.goals[1].target = m.goals[0].target.clone());
    assert!(twice.contains(&Constraint::Categories) && twice.contains(&Constraint::Separation), "{twice:?}");
    assert_eq!(broken(|m| m.goals[0].distractors += 1), [Constraint::Distractors]);
    let twins = [HOUSE.missions[0].clone(), HOUSE.missions[0].clone()];
    assert_eq!(check(&twins, ALL)[0].constraint, Constraint::UniqueIds);
}

#[test]
fn targets_and_cues_are_checked_against_the_scene() {
    assert!(broken(|m| m.goals[0].target.instance = 99_999).contains(&Constraint::Target));
    let box_moved = broken(|m| m.goals[0].target.bounds.max.x += 0.5);
    assert!(box_moved.contains(&Constraint::Target), "{box_moved:?}");
    assert_eq!(broken(|m| m.goals[0].target.source.y += 9.0), [Constraint::Source]);
    let far = broken(|m| m.goals[0].target.region.push(m.start.position));
    assert!(far.contains(&Constraint::Region), "{far:?}");
    let nowhere = broken(|m| m.goals[0].target.region.push(Point3::new(500.0, 0.0, 0.0)));
    assert!(nowhere.contains(&Constraint::Region), "{nowhere:?}");
    let text = String::new();
    let silent =
        broken(|m| m.goals[0].cue = CueSpec::Description(Description { text: text.clone(), claims: None }));
    assert!(silent.contains(&Constraint::Cue), "{silent:?}");
}

#[test]
fn cues_must_tell_their_target_from_its_kind() {
    let survey = SurveyOptions::default();
    let faults = |change: &dyn Fn(&Instance, &Instance) -> Option<CueSpec>| {
        let all = HOUSE.missions.iter().flat_map(|m| (0..m.goals.len()).map(move |goal| (m, goal)));
        let swapped = all.filter_map(|(mission, goal)| {
            let of = |id: u32| HOUSE.instances.iter().find(|instance| instance.target.instance == id);
            let own = of(mission.goals[goal].target.instance)?;
            let twin = HOUSE.instances.iter().find(|other| {
                other.target.category == own.target.category && other.target.instance != own.target.instance
            })?;
            let mut mission = mission.clone();
            mission.goals[goal].cue = change(own, twin)?;
            Some(mission)
        });
        let missions: Vec<EpisodeSpec> = swapped.take(10).collect();
        assert_eq!(missions.len(), 10);
        let found = check(&missions, Depth { every: 1000, survey: Some(&survey) });
        found.iter().filter(|fault| fault.constraint == Constraint::Cue).count()
    };
    let sentence_of = |instance: &Instance| instance.sentences.first().cloned().map(CueSpec::Description);
    let picture_of = |instance: &Instance| instance.images.first().copied().map(CueSpec::Image);
    assert_eq!(faults(&|own, _| sentence_of(own)), 0);
    assert!(faults(&|_, twin| sentence_of(twin)) > 0);
    assert!(faults(&|_, twin| picture_of(twin)) > 0);
    let unsaid = |own: &Instance, twin: &Instance| {
        let text = twin.sentences.first()?.text.clone();
        Some(CueSpec::Description(Description { text, claims: own.sentences.first()?.claims.clone() }))
    };
    assert!(faults(&unsaid) > 0);
}

#[test]
fn distances_and_references_are_computed_again() {
    assert_eq!(broken(|m| m.ordered.length_m += 0.01), [Constraint::ReferenceLength]);
    assert!(broken(|m| m.unordered.length_m = f64::NAN).contains(&Constraint::ReferenceLength));
    assert_eq!(broken(|m| m.ordered.steps += 1), [Constraint::ReferenceSteps]);
    assert_eq!(broken(|m| m.goals[0].target.start_distance_m += 0.01), [Constraint::StartDistance]);
    let away = broken(|m| m.start.position.y += 50.0);
    assert_eq!(away, [Constraint::Start]);
    let path = broken(|m| m.ordered.path.truncate(1));
    assert!(path.contains(&Constraint::ReferencePath), "{path:?}");
    let limits = MissionRules { min_start_m: 30.0, min_separation_m: 30.0, ..HOUSE.limits.clone() };
    let strict = check_scene(&HOUSE.assets, &HOUSE.rules, &limits, &HOUSE.missions[..3], ALL);
    for constraint in [Constraint::StartDistance, Constraint::Separation] {
        assert!(strict.iter().any(|fault| fault.constraint == constraint), "{constraint:?}");
    }
}
