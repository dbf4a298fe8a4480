//! Data sets from outside the crate; the golden numbers and digests of the embedded data set `mini`.
//!
//! They change with the houses and the pipeline, never by accident: `AVLN_BLESS=1 cargo test -p avln-dataset --test all mini`
//! rewrites them, and the changelog states the reason.

mod dataset;
mod missions;

use avln_dataset::{BuiltScene, Recipe, Statistics, build_scene, summary};
use std::path::Path;

fn mini() -> Vec<BuiltScene> {
    let (_, text) = Recipe::EMBEDDED.into_iter().find(|(name, _)| *name == "mini").expect("it is embedded");
    let recipe = Recipe::from_json(text).expect("a recipe");
    recipe.jobs().map(|job| build_scene(&recipe, job, None).expect("a scene with missions")).collect()
}

/// One line per number, then one per scene with geometry and file digests.
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
