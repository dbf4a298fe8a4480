//! Seconds per stage for a scene in the recipe `paper` on a single core, against half an hour on two cores for the whole
//! recipe, and the results of surveys: `cargo bench -p avln-dataset --bench build`.
//!
//! `-- words` also prints the sentences for the first surveyed house.

#![expect(clippy::disallowed_methods, reason = "a bench reads the clock")]

use avln_dataset::{
    Instance, Recipe, SceneChoice, SceneSource, SceneSpec, format::write_scene, sample_missions, survey,
};
use avln_episode::Rules;
use avln_houses::{HouseOptions, Pool, house};
use avln_scene::{Scene, categories};
use avln_world::{Body, SceneAssets};
use std::time::Instant;

const HOUSES: u64 = 8;
/// Houses whose survey is reported.
const SURVEYED: u64 = 3;
/// Half an hour on two cores, seconds.
const LIMIT_S: f64 = 2.0 * 1800.0;
const STAGES: [&str; 5] = ["house", "prepare", "survey", "missions", "files"];

fn main() {
    let (_, text) = Recipe::EMBEDDED[0];
    let recipe = Recipe::from_json(text).expect("a recipe that comes with the program");
    let scenes: usize = recipe.splits.iter().map(|split| split.scene_count()).sum();
    let mut sums = [0.0; STAGES.len()];
    for seed in 0..HOUSES {
        let seconds = build(&recipe, seed);
        (0..STAGES.len()).for_each(|stage| sums[stage] += seconds[stage]);
    }
    for (stage, sum) in STAGES.iter().zip(sums) {
        println!("{stage:>10} {:7.3} s a scene", sum / HOUSES as f64);
    }
    let all = sums.iter().sum::<f64>() / HOUSES as f64;
    let share = all * scenes as f64 / LIMIT_S;
    println!("{:>10} {all:7.3} s a scene: {share:.2} of the limit for {scenes} scenes", "all");
    report_surveys();
}

/// Builds a training scene; returns seconds per stage.
fn build(recipe: &Recipe, seed: u64) -> [f64; STAGES.len()] {
    let rules = recipe.rules().expect("known rules");
    let split = recipe.splits.iter().find(|split| split.name == "train").expect("a training split");
    let SceneChoice::Houses { rooms, storeys, .. } = &split.scenes else { panic!("houses") };
    let (rooms, storeys) = (rooms[0]..=rooms[1], storeys[0]..=storeys[1]);
    let mut marks = vec![Instant::now()];
    let source = SceneSource::Procedural { seed, rooms, storeys, pool: Pool::Train };
    let (spec, scene) = SceneSpec::new(&format!("bench-{seed}"), source).expect("a house");
    marks.push(Instant::now());
    let assets = prepare(scene, &rules);
    marks.push(Instant::now());
    let instances = survey(&assets, &rules);
    marks.push(Instant::now());
    let options = recipe.mission_rules(split).options(split.missions_per_scene, seed);
    let missions = sample_missions(&assets, &instances, &rules, &options);
    marks.push(Instant::now());
    let bytes = write_scene(&spec, None, &missions)
        .map_or(0, |written| written.missions.len() + written.sealed.len());
    marks.push(Instant::now());
    let steps = missions.iter().map(|mission| f64::from(mission.ordered.steps)).sum::<f64>()
        / missions.len().max(1) as f64;
    println!(
        "house {seed}: {} rooms, {} objects, {} targets, {} missions of {steps:.0} steps, {bytes} bytes",
        assets.scene.regions.len(),
        assets.scene.objects.len(),
        instances.len(),
        missions.len(),
    );
    std::array::from_fn(|stage| (marks[stage + 1] - marks[stage]).as_secs_f64())
}

fn prepare(scene: Scene, rules: &Rules) -> SceneAssets {
    let body = Body { radius_m: rules.body_radius_m, height_m: rules.body_height_m, ..Body::default() };
    SceneAssets::prepare(scene, &body).expect("a house can be lived in")
}

/// Surveys houses of twelve rooms.
fn report_surveys() {
    let words = std::env::args().any(|argument| argument == "words");
    for seed in 0..SURVEYED {
        let options = HouseOptions { rooms: 12..=12, ..HouseOptions::default() };
        let assets = prepare(house("bench", seed, &options), &Rules::paper());
        let start = Instant::now();
        let instances = survey(&assets, &Rules::paper());
        let seconds = start.elapsed().as_secs_f64();
        report(seed, &assets, &instances, seconds);
        if words && seed == 0 {
            instances
                .iter()
                .flat_map(|instance| &instance.sentences)
                .for_each(|sentence| println!("  {}", sentence.text));
        }
    }
}

fn report(seed: u64, assets: &SceneAssets, instances: &[Instance], seconds: f64) {
    let objects = assets.scene.objects.iter();
    let targets = objects.filter(|object| categories::is_target(&object.category)).count();
    let told = instances.iter().filter(|instance| !instance.sentences.is_empty()).count();
    let shown = instances.iter().filter(|instance| !instance.images.is_empty()).count();
    let sentences: usize = instances.iter().map(|instance| instance.sentences.len()).sum();
    println!(
        "house {seed}: {} objects, {targets} of target categories, {} recognised, {told} told by {sentences} sentences, \
         {shown} by pictures, in {seconds:.2} s",
        assets.scene.objects.len(),
        instances.len(),
    );
}
