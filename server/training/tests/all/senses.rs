//! Senses without images and waveforms, images with ids, maps, and parts of pictures.

use crate::{Entries, audio, follow_teacher, shared_env as env, shared_source, small_options};
use avln_episode::{Rules, Sensors};
use avln_training::{CheapSenses, Detail, Env, EnvOptions, Goals, Layout, OwnedRow, RowSource};

const ALL: CheapSenses = CheapSenses { lidar: true, ears: true, map: true };

/// Cheap senses alone.
fn options() -> EnvOptions {
    let sensors = Sensors { rgb: false, depth: false, audio: false, ..Sensors::all(64, 64) };
    EnvOptions { sensors, cheap: ALL, ..small_options() }
}

#[test]
fn restored_states_have_equal_senses() {
    let (mut env, mut other) = (env(options(), 0), env(options(), 2));
    let layout = env.layout().clone();
    let (mut row, mut copy) = (OwnedRow::new(&layout), OwnedRow::new(&layout));
    env.reset(&mut row.row()).expect("an episode");
    for action in [0, 0, 1, 0, 2, 3, 0] {
        env.step(action, &mut row.row()).expect("a step");
    }
    let state = env.state().expect("an episode");
    other.restore(&state, &mut copy.row()).expect("the same source");
    assert_eq!(row, copy);
    for action in [0, 1, 1, 0, 0, 3] {
        env.step(action, &mut row.row()).expect("a step");
        other.step(action, &mut copy.row()).expect("a step");
        assert_eq!(row, copy);
    }
}

#[test]
fn lidar_turns_with_the_agent() {
    let mut env = env(options(), 0);
    let layout = env.layout().clone();
    let mut row = OwnedRow::new(&layout);
    env.reset(&mut row.row()).expect("an episode");
    let before = row.floats(&layout, "lidar");
    env.step(1, &mut row.row()).expect("a step");
    let after = row.floats(&layout, "lidar");
    // A turn of 30 degrees to the left passes six rays.
    assert!((0..72).all(|ray| after[ray] == before[(ray + 6) % 72]), "{before:?} {after:?}");
    assert!(before.iter().all(|metres| (0.0..=10.0).contains(metres)) && before.iter().any(|m| *m > 0.3));
}

#[test]
fn lidar_agrees_with_the_depth_ahead() {
    let seen = Sensors { depth: true, ..options().sensors };
    let mut env = env(EnvOptions { sensors: seen, ..options() }, 0);
    let layout = env.layout().clone();
    let mut row = OwnedRow::new(&layout);
    env.reset(&mut row.row()).expect("an episode");
    let mut close = 0;
    for step in 0..24 {
        env.step(step % 3 % 2, &mut row.row()).expect("a step");
        let (lidar, depth) = (row.floats(&layout, "lidar"), row.floats(&layout, "depth"));
        let middle = 32 * 64 + 32;
        let around = [middle, middle - 1, middle - 64, middle - 65].map(|pixel| depth[pixel]);
        close += usize::from(around.iter().any(|metres| (metres - lidar[0]).abs() < 0.1 * lidar[0] + 0.02));
    }
    assert!(close >= 20, "{close} of 24 steps agree");
}

#[test]
fn map_grows_and_never_covers_the_agent() {
    let mut env = env(options(), 0);
    let layout = env.layout().clone();
    let mut row = OwnedRow::new(&layout);
    env.reset(&mut row.row()).expect("an episode");
    let known = |row: &OwnedRow| row.bytes(&layout, "map").iter().filter(|cell| **cell > 0).count();
    let first = known(&row);
    assert!(first > 10, "{first} cells");
    assert!(row.bytes(&layout, "map").iter().all(|cell| *cell <= 2));
    follow_teacher(&mut env, &mut row);
    let map = row.bytes(&layout, "map");
    // The four cells in the middle meet at the agent.
    assert!([15 * 32 + 15, 15 * 32 + 16, 16 * 32 + 15, 16 * 32 + 16].iter().any(|cell| map[*cell] == 1));
    assert!(known(&row) > first, "{first} cells, then {}", known(&row));
}

#[test]
fn ears_hear_the_sounding_target() {
    let mut env = env(options(), 0);
    let layout = env.layout().clone();
    let mut row = OwnedRow::new(&layout);
    env.reset(&mut row.row()).expect("an episode");
    let first = row.floats(&layout, "ears");
    assert_eq!(first.len(), 15);
    assert!(first[..12].iter().all(|db| (0.0..130.0).contains(db)), "{first:?}");
    assert!(first[..12].iter().any(|db| *db > 20.0) && first[14] == 1.0, "{first:?}");
    assert!(first[12].abs() < 0.8 && first[13].abs() <= 30.0, "{first:?}");
}

#[test]
fn ears_are_zero_after_the_last_target() {
    let mut env = env(options(), 0);
    let layout = env.layout().clone();
    let mut row = OwnedRow::new(&layout);
    let mut silent = false;
    for _ in 0..4 {
        env.reset(&mut row.row()).expect("an episode");
        follow_teacher(&mut env, &mut row);
        // The tail of the last target still rings in the last step.
        silent |= row.integer(&layout, "sounding") == -1 && row.floats(&layout, "ears")[12..] == [0.0; 3];
    }
    assert!(silent);
}

#[test]
fn cheap_senses_do_not_change_the_others() {
    let plain = EnvOptions { cheap: CheapSenses::default(), ..small_options() };
    let (mut one, mut other) = (env(plain, 0), env(EnvOptions { cheap: ALL, ..small_options() }, 0));
    let layouts = [one.layout().clone(), other.layout().clone()];
    let (mut row, mut copy) = (OwnedRow::new(&layouts[0]), OwnedRow::new(&layouts[1]));
    one.reset(&mut row.row()).expect("an episode");
    other.reset(&mut copy.row()).expect("an episode");
    for action in [0, 1, 0, 3] {
        let flags = one.step(action, &mut row.row()).expect("a step");
        assert_eq!(flags, other.step(action, &mut copy.row()).expect("a step"));
        for (spec, values) in layouts[0].arrays().iter().zip(&row.arrays) {
            let place = layouts[1].arrays().iter().position(|other| other.name == spec.name);
            assert_eq!(values, &copy.arrays[place.expect("an entry")], "{}", spec.name);
        }
    }
}

#[test]
fn digests_name_the_definition() {
    let digest = |options: &EnvOptions| Layout::new(options).digest(options);
    let with = |cheap: CheapSenses| EnvOptions { cheap, ..options() };
    let known = digest(&options());
    assert_eq!(known.len(), 16);
    assert_eq!(known, digest(&EnvOptions { privileged: false, ..options() }), "no part of the observation");
    assert_ne!(known, digest(&with(CheapSenses { map: false, ..ALL })));
    let far = Rules { depth_max_m: 5.0, ..Rules::paper() };
    assert_ne!(known, digest(&EnvOptions { rules: far, ..options() }));
    let half_pixel = EnvOptions { detail: Detail::HalfPixel, ..small_options() };
    assert_ne!(digest(&half_pixel), digest(&small_options()));
    let blind = EnvOptions {
        sensors: Sensors { rgb: false, depth: false, ..half_pixel.sensors.clone() },
        ..half_pixel
    };
    let exact = EnvOptions { detail: Detail::Exact, ..blind.clone() };
    assert_eq!(digest(&blind), digest(&exact), "no images");
}

#[test]
fn odd_turns_are_refused_with_rays() {
    let rules = Rules { turn_deg: 7, ..Rules::paper() };
    let source = || shared_source(1, Goals::Drawn);
    let error = Env::new(0, source(), EnvOptions { rules: rules.clone(), ..options() }, audio()).err();
    assert!(error.expect("refused").to_string().contains("multiple of 5 degrees"));
    let deaf = EnvOptions { rules, cheap: CheapSenses::default(), ..options() };
    let error = Env::new(0, source(), deaf, audio()).err().expect("refused").to_string();
    assert!(error.starts_with("`rules` is lh-avln-v1; the missions of this source"), "{error}");
}

const MAP_SIDE: usize = 512;
const CELL_M: f32 = 0.1;

fn mapped() -> Env {
    env(EnvOptions { ids: true, top_down: true, ..small_options() }, 0)
}

#[test]
fn ids_show_targets_in_sight() {
    let mut env = mapped();
    let layout = env.layout().clone();
    let mut row = OwnedRow::new(&layout);
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
        let mut env = env(options, 0);
        let layout = env.layout().clone();
        let mut row = OwnedRow::new(&layout);
        env.reset(&mut row.row()).expect("an episode");
        env.step(1, &mut row.row()).expect("a step");
        (row.shorts(&layout, "instance"), row.bytes(&layout, "semantic"))
    });
    assert_eq!(rows[0], rows[1]);
    assert!(rows[0].0.iter().any(|instance| *instance > 0));
}

#[test]
fn maps_show_walked_places_as_walkable() {
    let mut env = mapped();
    let layout = env.layout().clone();
    let mut row = OwnedRow::new(&layout);
    env.reset(&mut row.row()).expect("an episode");
    let map = row.bytes(&layout, "top_down");
    assert_eq!(map.len(), MAP_SIDE * MAP_SIDE);
    let count = |kind: u8| map.iter().filter(|cell| **cell == kind).count() as f32 * CELL_M * CELL_M;
    let (free_m2, obstacle_m2) = (count(1), count(2));
    assert!(
        (10.0..300.0).contains(&free_m2) && (5.0..300.0).contains(&obstacle_m2),
        "{free_m2} {obstacle_m2}"
    );
    for action in [0, 0, 1, 0, 0, 2, 2, 0, 0] {
        env.step(action, &mut row.row()).expect("a step");
        let pose = row.floats(&layout, "pose");
        let cell = |along_m: f32| (along_m / CELL_M + 0.5 * MAP_SIDE as f32).floor() as usize;
        let (column, line) = (cell(pose[0]), cell(pose[2]));
        // The body may stand on the rim of a cell whose centre is off the floor.
        let near = (line - 1..=line + 1)
            .flat_map(|line| (column - 1..=column + 1).map(move |c| line * MAP_SIDE + c));
        assert!(near.into_iter().any(|index| map[index] == 1), "{pose:?}");
    }
}

#[test]
fn overviews_have_path_and_targets() {
    let mut env = mapped();
    assert!(env.overview(64).is_err());
    let layout = env.layout().clone();
    let mut row = OwnedRow::new(&layout);
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
