//! Mean reference steps of the recipe `paper` in fixed samples of houses.

use avln_dataset::{Job, Recipe, build_scene};

/// Mean ordered steps in the paper.
const PAPER_STEPS: f64 = 172.17;

/// Returns the mean ordered steps in the first `houses` of a split, with `missions` per house.
fn mean_steps(split: &str, houses: usize, missions: usize) -> f64 {
    let (_, text) = Recipe::EMBEDDED[0];
    let mut recipe = Recipe::from_json(text).expect("a recipe");
    // This crate contains no detector. Detectors remove few instances, and the wanted steps do not depend on them.
    recipe.verifier = None;
    let index = recipe.splits.iter().position(|line| line.name == split).expect("a split");
    recipe.splits[index].missions_per_scene = missions;
    let jobs: Vec<Job> = (0..houses).map(|scene| Job { split: index, scene }).collect();
    let built = std::thread::scope(|scope| {
        let recipe = &recipe;
        let build =
            move |job: &Job| build_scene(recipe, *job, None).expect("a house").statistics.ordered_steps;
        let handles: Vec<_> = jobs
            .chunks(jobs.len().div_ceil(2))
            .map(|part| scope.spawn(move || part.iter().map(build).collect::<Vec<_>>()))
            .collect();
        handles.into_iter().flat_map(|handle| handle.join().expect("no panic")).collect::<Vec<_>>()
    });
    let (sum, count) =
        built.iter().fold((0.0, 0), |(sum, count), steps| (sum + steps.sum, count + steps.count));
    sum / count as f64
}

fn check(houses: [usize; 3], missions: usize, tolerance: f64) {
    let splits = ["val", "test", "train"].into_iter().zip(houses);
    let means: Vec<_> = splits.map(|(split, houses)| (split, mean_steps(split, houses, missions))).collect();
    let is_near = |mean: f64| (mean / PAPER_STEPS - 1.0).abs() <= tolerance;
    assert!(means.iter().all(|(_, mean)| is_near(*mean)), "{means:.1?} for {PAPER_STEPS}");
}

#[test]
fn steps_are_near_the_papers_mean() {
    // Houses differ by about 20 steps, so that few houses allow no narrow limit.
    check([4, 4, 4], 12, 0.1);
}

#[test]
#[ignore = "takes minutes"]
fn steps_are_near_the_papers_mean_in_many_houses() {
    check([11, 18, 40], 50, 0.03);
}
