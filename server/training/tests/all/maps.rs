//! Images with ids, maps, and parts of pictures.

use crate::memory::{OwnRow, audio, follow_teacher, small_houses, small_options};
use avln_training::{Env, EnvOptions, EpisodeSource, RowSource};

const SIDE: usize = 512;
const CELL_M: f32 = 0.1;

fn env() -> Env {
    let options = EnvOptions { ids: true, top_down: true, ..small_options() };
    let source = EpisodeSource::open(&small_houses(1)).expect("a source");
    Env::new(0, source, options, audio()).expect("an environment")
}

#[test]
fn ids_show_targets_in_sight() {
    let mut env = env();
    let layout = env.layout().clone();
    let mut row = OwnRow::new(&layout);
    let mut seen = 0;
    for _ in 0..3 {
        env.reset(&mut row.row()).expect("an episode");
        follow_teacher(&mut env, &mut row);
        let targets = row.shorts(&layout, "target_instance");
        let goals = env.truth().expect("an episode").targets.len();
        assert!(
            targets[..goals].iter().all(|target| *target > 0) && targets[goals..].iter().all(|t| *t == 0)
        );
        let (instances, semantic) = (row.shorts(&layout, "instance"), row.bytes(&layout, "semantic"));
        assert_eq!((instances.len(), semantic.len()), (64 * 64, 64 * 64));
        let pixels = || instances.iter().zip(&semantic);
        assert!(pixels().all(|(instance, category)| *instance > 0 || *category == 0));
        let is_target = |instance: &i32| targets[..goals].contains(instance);
        seen += usize::from(pixels().any(|(instance, category)| is_target(instance) && *category > 0));
    }
    assert!(seen > 0, "no final view shows a target");
}

#[test]
fn ids_are_equal_without_other_images() {
    let rows = [true, false].map(|has_images| {
        let mut options = EnvOptions { ids: true, ..small_options() };
        (options.sensors.rgb, options.sensors.depth) = (has_images, false);
        let source = EpisodeSource::open(&small_houses(1)).expect("a source");
        let mut env = Env::new(0, source, options, audio()).expect("an environment");
        let layout = env.layout().clone();
        let mut row = OwnRow::new(&layout);
        env.reset(&mut row.row()).expect("an episode");
        env.step(1, &mut row.row()).expect("a step");
        (row.shorts(&layout, "instance"), row.bytes(&layout, "semantic"))
    });
    assert_eq!(rows[0], rows[1]);
    assert!(rows[0].0.iter().any(|instance| *instance > 0));
}

#[test]
fn maps_show_walked_places_as_walkable() {
    let mut env = env();
    let layout = env.layout().clone();
    let mut row = OwnRow::new(&layout);
    env.reset(&mut row.row()).expect("an episode");
    let map = row.bytes(&layout, "top_down");
    assert_eq!(map.len(), SIDE * SIDE);
    let count = |kind: u8| map.iter().filter(|cell| **cell == kind).count() as f32 * CELL_M * CELL_M;
    let (free_m2, obstacle_m2) = (count(1), count(2));
    assert!(
        (10.0..300.0).contains(&free_m2) && (5.0..300.0).contains(&obstacle_m2),
        "{free_m2} {obstacle_m2}"
    );
    for action in [0, 0, 1, 0, 0, 2, 2, 0, 0] {
        env.step(action, &mut row.row()).expect("a step");
        let pose = row.floats(&layout, "pose");
        let cell = |along_m: f32| (along_m / CELL_M + 0.5 * SIDE as f32).floor() as usize;
        let (column, line) = (cell(pose[0]), cell(pose[2]));
        // The body may stand on the rim of a cell whose centre is off the floor.
        let near =
            (line - 1..=line + 1).flat_map(|line| (column - 1..=column + 1).map(move |c| line * SIDE + c));
        assert!(near.into_iter().any(|index| map[index] == 1), "{pose:?}");
    }
}

#[test]
fn overviews_have_path_and_targets() {
    let mut env = env();
    assert!(env.overview(64).is_err());
    let layout = env.layout().clone();
    let mut row = OwnRow::new(&layout);
    env.reset(&mut row.row()).expect("an episode");
    assert!(env.overview(1).is_err());
    for action in [0, 0, 1, 0] {
        env.step(action, &mut row.row()).expect("a step");
    }
    let overview = env.overview(32).expect("an episode");
    assert_eq!(
        (overview.view.len(), overview.map.len()),
        (32 * 32 * 3, overview.map_side * overview.map_side)
    );
    assert_eq!(overview.paths.iter().map(Vec::len).sum::<usize>(), 5);
    assert_eq!(overview.paths[0].last(), Some(&overview.agent));
    assert_eq!(overview.targets.len(), env.truth().expect("an episode").targets.len());
    assert!(overview.targets.iter().all(|target| target.is_open && target.is_here));
    assert_eq!(overview, env.overview(32).expect("the same state"));
}
