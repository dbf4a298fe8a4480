//! Senses without images and waveforms.

use crate::memory::{OwnRow, audio, follow_teacher, small_houses, small_options};
use avln_episode::{Rules, Sensors};
use avln_training::{CheapSenses, Env, EnvOptions, EpisodeSource, Layout, Row, RowSource};

const ALL: CheapSenses = CheapSenses { lidar: true, ears: true, map: true };

/// Cheap senses alone.
fn options() -> EnvOptions {
    let sensors = Sensors { rgb: false, depth: false, audio: false, ..Sensors::all(64, 64) };
    EnvOptions { sensors, cheap: ALL, ..small_options() }
}

fn env(options: EnvOptions, number: u64) -> Env {
    let source = EpisodeSource::open(&small_houses(1)).expect("a source");
    Env::new(number, source, options, audio()).expect("an environment")
}

fn row_of(row: &mut OwnRow) -> Row<'_> {
    row.row()
}

#[test]
fn restored_states_have_equal_senses() {
    let (mut env, mut other) = (env(options(), 0), env(options(), 2));
    let layout = env.layout().clone();
    let (mut row, mut copy) = (OwnRow::new(&layout), OwnRow::new(&layout));
    env.reset(&mut row_of(&mut row)).expect("an episode");
    for action in [0, 0, 1, 0, 2, 3, 0] {
        env.step(action, &mut row_of(&mut row)).expect("a step");
    }
    let state = env.state().expect("an episode");
    other.restore(&state, &mut row_of(&mut copy)).expect("the same source");
    assert_eq!(row, copy);
    for action in [0, 1, 1, 0, 0, 3] {
        env.step(action, &mut row_of(&mut row)).expect("a step");
        other.step(action, &mut row_of(&mut copy)).expect("a step");
        assert_eq!(row, copy);
    }
}

#[test]
fn lidar_turns_with_the_agent() {
    let mut env = env(options(), 0);
    let layout = env.layout().clone();
    let mut row = OwnRow::new(&layout);
    env.reset(&mut row_of(&mut row)).expect("an episode");
    let before = row.floats(&layout, "lidar");
    env.step(1, &mut row_of(&mut row)).expect("a step");
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
    let mut row = OwnRow::new(&layout);
    env.reset(&mut row_of(&mut row)).expect("an episode");
    let mut close = 0;
    for step in 0..24 {
        env.step(step % 3 % 2, &mut row_of(&mut row)).expect("a step");
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
    let mut row = OwnRow::new(&layout);
    env.reset(&mut row_of(&mut row)).expect("an episode");
    let known = |row: &OwnRow| row.bytes(&layout, "map").iter().filter(|cell| **cell > 0).count();
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
    let mut row = OwnRow::new(&layout);
    env.reset(&mut row_of(&mut row)).expect("an episode");
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
    let mut row = OwnRow::new(&layout);
    let mut silent = false;
    for _ in 0..4 {
        env.reset(&mut row_of(&mut row)).expect("an episode");
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
    let (mut row, mut copy) = (OwnRow::new(&layouts[0]), OwnRow::new(&layouts[1]));
    one.reset(&mut row_of(&mut row)).expect("an episode");
    other.reset(&mut row_of(&mut copy)).expect("an episode");
    for action in [0, 1, 0, 3] {
        let flags = one.step(action, &mut row_of(&mut row)).expect("a step");
        assert_eq!(flags, other.step(action, &mut row_of(&mut copy)).expect("a step"));
        for (spec, values) in layouts[0].arrays().iter().zip(&row.values) {
            let place = layouts[1].arrays().iter().position(|other| other.name == spec.name);
            assert_eq!(values, &copy.values[place.expect("an entry")], "{}", spec.name);
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
}

#[test]
fn odd_turns_are_refused_with_rays() {
    let rules = Rules { turn_deg: 7, ..Rules::paper() };
    let source = || EpisodeSource::open(&small_houses(1)).expect("a source");
    let error = Env::new(0, source(), EnvOptions { rules: rules.clone(), ..options() }, audio()).err();
    assert!(error.expect("refused").to_string().contains("multiple of 5 degrees"));
    let deaf = EnvOptions { rules, cheap: CheapSenses::default(), ..options() };
    assert!(Env::new(0, source(), deaf, audio()).is_ok());
}
