//! The numbers and the bytes of the data set that comes with the program as `mini`. They may change with the houses and the
//! pipeline, never by accident: `AVLN_BLESS=1 cargo test -p avln-dataset --test golden` writes them anew, and the changelog
//! says why.

use avln_dataset::{BuiltScene, Recipe, Statistics, build_scene, summary};
use std::path::Path;

fn mini() -> Vec<BuiltScene> {
    let (_, text) = Recipe::EMBEDDED.into_iter().find(|(name, _)| *name == "mini").expect("it is embedded");
    let recipe = Recipe::from_json(text).expect("a recipe");
    recipe.jobs().map(|job| build_scene(&recipe, job, None).expect("a scene with missions")).collect()
}

/// A line a number, then a line a scene with the digests of its building and its files.
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
fn the_mini_data_set_is_what_it_was() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/mini.txt");
    let found = report(&mini());
    if std::env::var_os("AVLN_BLESS").is_some() {
        std::fs::write(&path, &found).expect("writable");
    }
    let told = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(found == told, "{} says\n{told}\nand now it is\n{found}", path.display());
}
