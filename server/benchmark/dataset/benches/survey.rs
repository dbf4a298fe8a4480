//! Seconds for a house survey on a single core, and the results: `cargo bench -p avln-dataset`.
//!
//! `-- words` also prints the sentences for the first house.

#![expect(clippy::disallowed_methods, reason = "a bench reads the clock")]

use avln_dataset::{Instance, survey};
use avln_episode::Rules;
use avln_houses::{HouseOptions, house};
use avln_scene::categories;
use avln_world::{Body, SceneAssets};
use std::time::Instant;

const HOUSES: u64 = 3;

fn main() {
    let words = std::env::args().any(|argument| argument == "words");
    for seed in 0..HOUSES {
        let assets = prepare(seed);
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

fn prepare(seed: u64) -> SceneAssets {
    let rules = Rules::paper();
    let body = Body { radius_m: rules.body_radius_m, height_m: rules.body_height_m, ..Body::default() };
    let options = HouseOptions { rooms: 12..=12, ..HouseOptions::default() };
    SceneAssets::prepare(house("bench", seed, &options), &body).expect("a house can be lived in")
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
