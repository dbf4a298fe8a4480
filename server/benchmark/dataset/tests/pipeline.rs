//! The whole pipeline on a procedural house: survey, missions, split file, and the constraints on each mission.

use avln_dataset::{CueSpec, EpisodeSpec, MissionOptions, SceneSource, Split};
use avln_episode::{GoalCue, Order, Rules};
use avln_houses::Pool;
use avln_scene::InstanceId;
use avln_world::SceneAssets;
use std::{collections::BTreeSet, sync::LazyLock};

struct Made {
    split: Split,
    assets: SceneAssets,
    options: MissionOptions,
}

fn make() -> Made {
    let mut split = Split::new("test", &Rules::paper());
    let options = MissionOptions::new(6, 11);
    let source = SceneSource::Procedural { seed: 3, rooms: 5..=6, storeys: 1..=1, pool: Pool::Train };
    let assets = split
        .add_scene("test-house", source, &Rules::paper(), &options, None)
        .expect("a house holds missions");
    Made { split, assets, options }
}

static MADE: LazyLock<Made> = LazyLock::new(make);

fn each_episode(check: impl Fn(&EpisodeSpec)) {
    assert_eq!(MADE.split.episodes.len(), 6);
    MADE.split.episodes.iter().for_each(check);
}

#[test]
fn missions_mix_modalities_and_repeat_no_category() {
    each_episode(|episode| {
        assert!((2..=4).contains(&episode.goals.len()));
        let modalities: BTreeSet<_> = episode.goals.iter().map(|goal| goal.cue.modality()).collect();
        assert!(modalities.len() >= 2, "{}: {modalities:?}", episode.id);
        let categories: BTreeSet<_> = episode.goals.iter().map(|goal| &goal.target.category).collect();
        assert_eq!(categories.len(), episode.goals.len(), "{}: {categories:?}", episode.id);
    });
}

#[test]
fn targets_are_reachable_and_far_from_the_start() {
    each_episode(|episode| {
        for goal in &episode.goals {
            assert!(goal.target.start_distance_m >= MADE.options.min_start_m);
            assert!(!goal.target.viewpoints.is_empty());
        }
    });
}

#[test]
fn every_sampled_place_of_a_region_is_in_the_region() {
    let rules = Rules::paper();
    each_episode(|episode| {
        for target in episode.goals.iter().map(|goal| &goal.target) {
            let sees =
                |eye: &_, half_view_rad| MADE.assets.sees(eye, InstanceId(target.instance), half_view_rad);
            assert!(
                target.region.iter().all(|base| target.distance_within_region(base, &rules, sees).is_some())
            );
        }
    });
}

#[test]
fn references_are_ordered_by_freedom_and_bounded_by_their_legs() {
    each_episode(|episode| {
        let farthest = episode.goals.iter().map(|goal| goal.target.start_distance_m).fold(0.0, f64::max);
        let (ordered, unordered) = (episode.ordered.length_m, episode.unordered.length_m);
        assert!(unordered <= ordered + 1e-6, "{}: {unordered} > {ordered}", episode.id);
        assert!(unordered >= farthest - 1e-6, "{}: {unordered} < {farthest}", episode.id);
        for tour in [&episode.ordered, &episode.unordered] {
            let walked: f32 = tour.path.windows(2).map(|leg| (leg[1] - leg[0]).norm()).sum();
            assert!(
                (f64::from(walked) - tour.length_m).abs() < 0.02,
                "{}: {walked} for {}",
                episode.id,
                tour.length_m
            );
        }
    });
}

#[test]
fn an_ordered_tour_is_no_shorter_than_the_way_to_its_first_goal() {
    each_episode(|episode| {
        assert!(
            episode.ordered.length_m >= episode.goals[0].target.start_distance_m - 1e-6,
            "{}",
            episode.id
        );
    });
}

#[test]
fn cues_tell_what_they_should_and_no_more() {
    let rules = Rules::paper();
    each_episode(|episode| {
        let mission = episode.mission(&MADE.assets, &rules, Order::Ordered);
        for (goal, cue) in episode.goals.iter().zip(&mission.goals) {
            match (&goal.cue, cue) {
                (CueSpec::Category, GoalCue::Category(label)) => assert_eq!(label, &goal.target.category),
                (CueSpec::Description(said), GoalCue::Description(text)) => assert_eq!(&said.text, text),
                (CueSpec::Image(view), GoalCue::Image(image)) => {
                    assert_eq!(image.pixels.len() as u32, 3 * view.side_px * view.side_px);
                    assert!(image.pixels.iter().any(|&byte| byte != image.pixels[0]), "a picture of nothing");
                }
                other => panic!("{other:?}"),
            }
        }
    });
}

#[test]
fn the_same_seed_makes_the_same_split() {
    assert_eq!(make().split, MADE.split);
}

#[test]
fn a_changed_scene_is_refused() {
    let mut scene = MADE.split.scenes[0].clone();
    assert!(scene.open(&Rules::paper()).is_ok());
    scene.digest = "0".repeat(64);
    let error = scene.open(&Rules::paper()).err().expect("another digest").to_string();
    assert!(error.contains("test-house") && error.contains("make the split again"), "{error}");
}
