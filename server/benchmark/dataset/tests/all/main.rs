//! Data sets from outside the crate; the survey of a house and hundreds of missions in it; the golden numbers and digests of the embedded data set `mini`.
//!
//! They change with the houses and the pipeline, never by accident: `AVLN_BLESS=1 cargo test -p avln-dataset --test all mini`
//! rewrites them, and the changelog states the reason.

mod dataset;
mod distractors;

use avln_dataset::{
    BuiltScene, Constraint, CueSpec, CueView, Depth, Description, DetectorView, EpisodeSpec, Fault, Instance,
    MissionRules, Recipe, Removals, SceneSource, SceneSpec, Statistics, StepGoal, Survey, SurveyOptions,
    ThresholdsOnly, Verifier, VerifierId, build_scene, build_scene_with, check_recognition, check_scene,
    sample_missions, summary, survey, survey_with,
};
use avln_episode::{Modality, Rules};
use avln_formats::open::open;
use avln_geom::Point3;
use avln_houses::{HouseOptions, Pool, house};
use avln_scene::Object;
use avln_world::{Body, Camera, CameraImage, SceneAssets};
use std::{
    collections::{BTreeMap, BTreeSet},
    ops::RangeInclusive,
    path::Path,
    sync::{
        LazyLock,
        atomic::{AtomicUsize, Ordering},
    },
};

/// Returns an embedded recipe.
fn recipe(name: &str) -> Recipe {
    Recipe::from_json(Recipe::embedded(name).expect("it is embedded")).expect("a recipe")
}

fn mini() -> Vec<BuiltScene> {
    let recipe = recipe("mini");
    recipe.jobs().map(|job| build_scene(&recipe, job, None).expect("a scene with missions")).collect()
}

/// A line per number, then a line per scene with geometry and file digests.
fn report(scenes: &[BuiltScene]) -> String {
    let mut sum = Statistics::default();
    scenes.iter().for_each(|scene| sum.add(&scene.statistics));
    let numbers = summary(&sum).into_iter().map(|(label, value)| format!("{label}: {value}\n"));
    let digests = scenes.iter().map(|scene| {
        let line = &scene.line;
        format!("{}: building {}, missions {}, sealed {}\n", line.name, line.digest, line.public, line.sealed)
    });
    numbers.chain(digests).collect()
}

#[test]
fn mini_data_set_is_unchanged() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/mini.txt");
    let found = report(&mini());
    if std::env::var_os("AVLN_BLESS").is_some() {
        std::fs::write(&path, &found).expect("writable");
    }
    let golden = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(found == golden, "{} has\n{golden}\nbut the data set has\n{found}", path.display());
}

const MISSIONS: usize = 1500;
const ALL: Depth = Depth { every: 1, survey: None };

struct House {
    assets: SceneAssets,
    instances: Vec<Instance>,
    rules: Rules,
    limits: MissionRules,
    missions: Vec<EpisodeSpec>,
}

impl House {
    fn new(
        seed: u64,
        rooms: RangeInclusive<u8>,
        storeys: RangeInclusive<u8>,
        pool: Pool,
        limits: MissionRules,
        count: usize,
    ) -> Self {
        let source = SceneSource::Procedural { seed, rooms, storeys, pool };
        let rules = Rules::paper();
        let (spec, _) = SceneSpec::new("house", source).expect("a house");
        let assets = spec.open(&rules).expect("it can be lived in");
        let instances = survey(&assets, &rules);
        let missions = sample_missions(&assets, &instances, &rules, &limits.options(count, 5));
        Self { assets, instances, rules, limits, missions }
    }
}

static HOUSE: LazyLock<House> = LazyLock::new(|| {
    let limits = MissionRules {
        goals: [2, 4],
        min_start_m: 1.5,
        min_separation_m: 1.0,
        distractors: [0, 255],
        steps: None,
    };
    House::new(21, 7..=8, 1..=1, Pool::Train, limits, MISSIONS)
});

fn check(missions: &[EpisodeSpec], depth: Depth) -> Vec<Fault> {
    check_scene(&HOUSE.assets, &HOUSE.rules, &HOUSE.limits, missions, depth)
}

#[test]
fn missions_satisfy_all_constraints() {
    assert_eq!(HOUSE.missions.len(), MISSIONS);
    let survey = SurveyOptions::default();
    assert_eq!(check(&HOUSE.missions, Depth { every: 25, survey: Some(&survey) }), []);
}

#[test]
fn goal_counts_modalities_and_targets_are_balanced() {
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
fn equal_seeds_give_equal_mission_prefixes() {
    let draw = |count, seed| {
        sample_missions(&HOUSE.assets, &HOUSE.instances, &HOUSE.rules, &HOUSE.limits.options(count, seed))
    };
    assert_eq!(draw(40, 5), HOUSE.missions[..40]);
    assert_ne!(draw(40, 6), HOUSE.missions[..40]);
}

#[test]
fn drawn_steps_are_near_the_wanted_mean() {
    let mean = |steps: Option<StepGoal>| {
        let limits = MissionRules { steps, ..HOUSE.limits.clone() };
        let missions =
            sample_missions(&HOUSE.assets, &HOUSE.instances, &HOUSE.rules, &limits.options(120, 3));
        missions.iter().map(|mission| f64::from(mission.ordered.steps)).sum::<f64>() / 120.0
    };
    let as_they_come = mean(None);
    let wanted = 1.2 * as_they_come;
    let drawn = mean(Some(StepGoal { mean: wanted, spread: 0.3, draws: 16 }));
    assert!((drawn - wanted).abs() < 0.03 * wanted, "{drawn} for {wanted}; {as_they_come} as they come");
}

/// Changes the first mission; returns the violated constraints.
fn broken(change: impl FnOnce(&mut EpisodeSpec)) -> Vec<Constraint> {
    let mut mission = HOUSE.missions[0].clone();
    change(&mut mission);
    let faults = check(&[mission], ALL);
    assert!(faults.iter().all(|fault| fault.mission == "house-0000"), "{faults:?}");
    faults.into_iter().map(|fault| fault.constraint).collect()
}

#[test]
fn check_finds_wrong_composition() {
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
fn check_finds_wrong_targets_and_cues() {
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
fn check_finds_ambiguous_cues() {
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
fn check_recomputes_distances_and_references() {
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

static ASSETS: LazyLock<SceneAssets> = LazyLock::new(|| {
    let rules = Rules::paper();
    let body = Body { radius_m: rules.body_radius_m, height_m: rules.body_height_m, ..Body::default() };
    let options = HouseOptions { rooms: 4..=5, ..HouseOptions::default() };
    SceneAssets::prepare(house("survey", 5, &options), &body).expect("a house can be lived in")
});

static FOUND: LazyLock<Vec<Instance>> = LazyLock::new(|| found(&ThresholdsOnly).instances);

/// Any number of distractors.
const ANY: RangeInclusive<u8> = 0..=u8::MAX;

fn found(verifier: &dyn Verifier) -> Survey {
    survey_with(&ASSETS, &Rules::paper(), &SurveyOptions::default(), verifier, &ANY).expect("no failure")
}

fn render(view: &CueView, side_px: u32) -> CameraImage {
    let rules = Rules::paper();
    let mut eye = view.pose.position;
    eye.y += rules.camera_height_m;
    ASSETS.render(&Camera {
        eye,
        world_from_camera: view.pose.rotation(),
        width: side_px,
        height: side_px,
        hfov_rad: view.hfov_rad,
        depth_max_m: rules.depth_max_m,
    })
}

#[test]
fn views_and_pictures_show_their_instance() {
    assert!(FOUND.len() > 20, "{}", FOUND.len());
    for instance in FOUND.iter() {
        assert!((1..=6).contains(&instance.views.len()) && instance.images.len() <= 3);
        for view in instance.views.iter().chain(&instance.images) {
            let frame = render(view, 128);
            let own = frame.instances.iter().filter(|id| id.0 == instance.target.instance).count();
            assert!(own as f32 >= 0.005 * 128.0 * 128.0, "{} fills {own} pixels", instance.target.category);
        }
        let viewpoints: Vec<_> = instance.views.iter().map(|view| view.pose).collect();
        assert_eq!(viewpoints, instance.target.viewpoints);
    }
}

#[test]
fn survey_records_margins_and_distractors() {
    for instance in FOUND.iter() {
        let category = &instance.target.category;
        let others = ASSETS.scene.objects.iter().filter(|object| object.category == *category).count() - 1;
        assert_eq!(usize::from(instance.distractors), others, "{category}");
        let range = if instance.images.is_empty() { 0.0..=0.0 } else { 0.35..=1.0 };
        assert!(range.contains(&instance.image_margin), "{category}: {}", instance.image_margin);
    }
    let with = |has: fn(&Instance) -> bool| FOUND.iter().filter(|instance| has(instance)).count();
    assert!(with(|instance| !instance.images.is_empty()) * 2 > FOUND.len());
    assert!(with(|instance| !instance.sentences.is_empty()) * 2 > FOUND.len());
}

#[test]
fn survey_is_deterministic() {
    assert_eq!(found(&ThresholdsOnly).instances, *FOUND);
}

/// Recognises objects in a single category, and counts the pictures.
struct Only {
    category: &'static str,
    pictures: AtomicUsize,
}

impl Only {
    fn new(category: &'static str) -> Self {
        Self { category, pictures: AtomicUsize::new(0) }
    }
}

impl Verifier for Only {
    fn id(&self) -> Option<VerifierId> {
        Some(VerifierId { name: self.category.to_owned(), digest: None })
    }

    fn recognises(&self, view: &DetectorView, objects: &[&Object]) -> Result<Vec<bool>, String> {
        self.pictures.fetch_add(1, Ordering::Relaxed);
        assert_eq!((view.frame.width, view.frame.height), (256, 256));
        assert!(objects.iter().all(|object| view.frame.instances.contains(&object.id)));
        if self.category == "broken" {
            return Err("no memory".to_owned());
        }
        Ok(objects.iter().map(|object| object.category == self.category).collect())
    }
}

#[test]
fn verifier_can_reject_instances() {
    let category = FOUND[0].target.category.as_str();
    let only = found(&Only::new(category));
    assert!(only.instances.iter().all(|instance| instance.target.category == category));
    let all = FOUND.iter().filter(|instance| instance.target.category == category);
    // Pictures are compared with all instances in the category, so that they do not depend on the verifier.
    assert!(only.instances.iter().eq(all) && only.instances.len() < FOUND.len());
    assert_eq!(only.removals.verifier as usize, FOUND.len() - only.instances.len());
    let plain = found(&ThresholdsOnly).removals;
    assert_eq!(plain, Removals { verifier: 0, ..only.removals });
    assert!(plain.by_test().iter().map(|(_, count)| count).sum::<u32>() > 0, "{plain:?}");
}

#[test]
fn distractor_limits_remove_instances() {
    let (rules, options) = (Rules::paper(), SurveyOptions::default());
    let few = survey_with(&ASSETS, &rules, &options, &ThresholdsOnly, &(1..=2)).expect("no failure");
    let is_allowed = |instance: &&Instance| (1..=2).contains(&instance.distractors);
    let targets = |instances: &[Instance]| -> Vec<_> {
        instances.iter().filter(is_allowed).map(|instance| instance.target.clone()).collect()
    };
    assert!(!few.instances.is_empty() && few.instances.iter().all(|instance| is_allowed(&instance)));
    assert_eq!(targets(&few.instances), targets(&FOUND));
    assert!(few.removals.distractors as usize >= FOUND.len() - few.instances.len());
}

#[test]
fn neighbours_share_pictures() {
    let every = Every(AtomicUsize::new(0));
    assert_eq!(found(&every).instances, *FOUND);
    let pictures = every.0.load(Ordering::Relaxed);
    assert!(pictures < FOUND.len(), "{pictures} pictures for {} instances", FOUND.len());
}

/// Recognises everything.
struct Every(AtomicUsize);

impl Verifier for Every {
    fn id(&self) -> Option<VerifierId> {
        Some(VerifierId { name: "every".to_owned(), digest: None })
    }

    fn recognises(&self, _: &DetectorView, objects: &[&Object]) -> Result<Vec<bool>, String> {
        self.0.fetch_add(1, Ordering::Relaxed);
        Ok(vec![true; objects.len()])
    }
}

#[test]
fn failed_verifier_stops_the_survey() {
    let broken = Only::new("broken");
    let error =
        survey_with(&ASSETS, &Rules::paper(), &SurveyOptions::default(), &broken, &ANY).expect_err("failed");
    assert_eq!(error.to_string(), "the verifier failed: no memory");
    assert_eq!(broken.pictures.load(Ordering::Relaxed), 1);
}

#[test]
fn check_finds_unrecognised_targets() {
    let check = |verifier: &dyn Verifier| {
        let options = SurveyOptions::default();
        check_recognition(
            &HOUSE.assets,
            &HOUSE.rules,
            &HOUSE.limits,
            &HOUSE.missions[..20],
            (&options, verifier),
        )
        .expect("no failure")
    };
    assert_eq!(check(&Every(AtomicUsize::new(0))), []);
    let faults = check(&Only::new("unicorn"));
    let targets: BTreeSet<u32> =
        HOUSE.missions[..20].iter().flat_map(|m| &m.goals).map(|goal| goal.target.instance).collect();
    assert_eq!(faults.len(), targets.len());
    assert!(faults.iter().all(|fault| fault.constraint == Constraint::Recognised));
}

#[test]
fn recipe_and_verifier_must_agree() {
    let mut recipe = recipe("mini");
    let job = recipe.jobs().next().expect("a scene");
    recipe.verifier = Some(VerifierId { name: "network".to_owned(), digest: None });
    let error = build_scene(&recipe, job, None).expect_err("another verifier").to_string();
    assert!(error.contains("`verifier` is network") && error.contains("none"), "{error}");
    let every = Every(AtomicUsize::new(0));
    recipe.verifier = every.id();
    assert!(build_scene_with(&recipe, job, &every, None).is_ok());
}

#[test]
fn modelled_house_can_be_surveyed() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../../../shared/scenes/aws_small_house/hm3d_style/00000-SmallHouse");
    if !path.exists() {
        // Not `println!`, which the test harness hides.
        let _ = std::io::Write::write_fmt(
            &mut std::io::stderr(),
            format_args!("skipped: survey of a modelled house; put scenes into ../shared/scenes\n"),
        );
        return;
    }
    let scene = open(&path).expect("a house in the layout of HM3D");
    let rules = Rules::paper();
    let body = Body { radius_m: rules.body_radius_m, height_m: rules.body_height_m, ..Body::default() };
    let assets = SceneAssets::prepare(scene, &body).expect("one can live in it");
    let instances = survey(&assets, &rules);
    let sentences: Vec<&String> =
        instances.iter().flat_map(|instance| &instance.sentences).map(|sentence| &sentence.text).collect();
    assert!(instances.len() >= 10 && sentences.len() >= 10, "{} instances, {sentences:#?}", instances.len());
    assert!(sentences.iter().all(|text| !text.contains('_')), "{sentences:#?}");
}
