//! The bundled perception network was trained on houses outside every evaluation split.

use avln_dataset::{Recipe, SceneSource};
use avln_perception::VisionNetwork;
use std::collections::BTreeSet;

/// Seeds of all houses that may be drawn for the splits of the program's recipes: those of `split`, or those of all others.
fn seeds(recipe: &Recipe, wanted: impl Fn(&str) -> bool) -> BTreeSet<u64> {
    let jobs = recipe.jobs().filter(|job| wanted(&recipe.splits[job.split].name));
    let draws = jobs.flat_map(|job| (0..Recipe::HOUSE_DRAWS).map(move |attempt| (job, attempt)));
    let seed = |(job, attempt)| match recipe.house(job, attempt) {
        Ok(SceneSource::Procedural { seed, .. }) => seed,
        other => panic!("a house is drawn, not {other:?}"),
    };
    draws.map(seed).collect()
}

#[test]
fn network_was_not_trained_on_evaluation_houses() {
    let network = VisionNetwork::new().expect("the bundled weights are valid");
    let training = &network.info().training;
    let learnt: BTreeSet<u64> = training.seeds.iter().copied().collect();
    assert_eq!(training.split, "train");
    assert!(!learnt.is_empty());
    for (name, text) in Recipe::EMBEDDED {
        let recipe = Recipe::from_json(text).expect("a recipe");
        let evaluated = seeds(&recipe, |split| split != "train");
        assert!(!evaluated.is_empty() && learnt.is_disjoint(&evaluated), "recipe {name}");
        if name == training.recipe {
            assert!(learnt.is_subset(&seeds(&recipe, |split| split == "train")));
        }
    }
}
