//! Episodes, teachers, rewards, states and threads.

use crate::{Entries, audio, follow_teacher, shared_env, shared_source, small_houses, small_options};
use avln_episode::{Action, Order, Rules};
use avln_scoring::score;
use avln_training::{
    AutoReset, CheapSenses, Curriculum, Env, EnvOptions, EpisodeSource, Goals, OwnedRow, ProgressReward,
    RewardRule, Row, RowSource, SourceOptions, Teacher, TrainingError, VectorEnv,
};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

const PATIENCE: Duration = Duration::from_secs(120);

#[test]
fn teacher_completes_missions_on_shortest_paths() {
    let mut env = shared_env(EnvOptions { teacher: Teacher::Path, ..exploring() }, 0);
    let layout = env.layout().clone();
    let mut row = OwnedRow::new(&layout);
    let (mut complete, mut spl) = (0, 0.0);
    const EPISODES: usize = 12;
    for _ in 0..EPISODES {
        env.reset(&mut row.row()).expect("an episode");
        let (flags, rewards) = follow_teacher(&mut env, &mut row);
        let spl_so_far = row.floats(&layout, "spl")[0];
        let (truth, record) = env.take_record().expect("an episode");
        let metrics = score(&truth, &record, &Rules::paper());
        assert_eq!(metrics.spl as f32, spl_so_far, "{metrics:?}");
        assert_eq!(flags.terminated, metrics.sr == 1.0, "{metrics:?}");
        assert!(metrics.sr < 1.0 || rewards > 15.0, "{rewards}");
        complete += usize::from(metrics.sr == 1.0);
        spl += metrics.spl;
    }
    assert!(complete >= EPISODES - 1, "{complete} of {EPISODES}");
    assert!(spl >= 0.85 * complete as f64, "{spl} for {complete}");
}

#[test]
fn restored_states_continue_with_equal_bits() {
    let own = EpisodeSource::open(&small_houses(1)).expect("a source");
    let mut other = Env::new(3, own, small_options(), audio()).expect("an environment");
    let mut env = shared_env(small_options(), 0);
    let layout = env.layout().clone();
    let (mut row, mut copy) = (OwnedRow::new(&layout), OwnedRow::new(&layout));
    env.reset(&mut row.row()).expect("an episode");
    for action in [0, 0, 1, 0, 2, 3, 0] {
        env.step(action, &mut row.row()).expect("a step");
    }
    let state = env.state().expect("an episode");
    other.restore(&state, &mut copy.row()).expect("the same source");
    assert_eq!(row, copy);
    assert_eq!(
        other.state().expect("an episode"),
        state,
        "a state is that of its episode, wherever it plays"
    );
    for action in [0, 1, 1, 0, 0, 3] {
        let flags = env.step(action, &mut row.row()).expect("a step");
        let again = other.step(action, &mut copy.row()).expect("a step");
        assert_eq!((flags, &row), (again, &copy));
    }
}

#[test]
fn invalid_steps_are_refused() {
    let mut env = shared_env(small_options(), 0);
    let mut row = OwnedRow::new(&env.layout().clone());
    assert!(matches!(env.step(0, &mut row.row()), Err(TrainingError::NotReset(0))));
    env.reset(&mut row.row()).expect("an episode");
    let error = env.step(5, &mut row.row()).expect_err("no such action").to_string();
    assert!(error.contains("environment 0") && error.contains("action 5"), "{error}");
    env.step(4, &mut row.row()).expect("the environment still works");
    let error = env.step(0, &mut row.row()).expect_err("the episode is over").to_string();
    assert!(error.contains("ended after 1 steps"), "{error}");
}

/// An environment of a vector, and its row.
fn single(autoreset: AutoReset) -> (VectorEnv<OwnedRow>, OwnedRow) {
    let options = EnvOptions { autoreset, ..small_options() };
    let vector =
        VectorEnv::new(1, 1, shared_source(1, Goals::Drawn), options, audio()).expect("an environment");
    let row = OwnedRow::new(vector.layout());
    (vector, row)
}

fn received(vector: &VectorEnv<OwnedRow>) -> OwnedRow {
    let finished = vector.recv(1, PATIENCE).pop().expect("in time");
    finished.flags.expect("no error");
    finished.row
}

#[test]
fn restored_ends_reset_in_the_next_step() {
    let (vector, row) = single(AutoReset::NextStep);
    vector.send_reset(0, row).expect("an environment");
    vector.send_step(0, 4, received(&vector)).expect("an environment");
    let row = received(&vector);
    let end = vector.state(0).expect("an episode");
    vector.send_step(0, 0, row).expect("an environment");
    let next = vector.recv(1, PATIENCE).pop().expect("in time").row;
    let expected = next.clone();
    vector.send_restore(0, end, next).expect("an environment");
    vector.send_step(0, 0, received(&vector)).expect("an environment");
    assert_eq!(received(&vector), expected);
}

#[test]
fn unknown_environments_are_refused() {
    let (vector, row) = single(AutoReset::Disabled);
    let error = vector.send_step(3, 0, row).expect_err("no such environment").to_string();
    assert_eq!(error, "environment 3 does not exist; the last one is 0");
    assert!(matches!(vector.state(1), Err(TrainingError::UnknownEnv { env: 1, count: 1 })));
}

#[test]
fn closing_leaves_queued_tasks_undone() {
    let source = EpisodeSource::open(&small_houses(4)).expect("a source");
    let vector = VectorEnv::new(4, 1, source, small_options(), audio()).expect("environments");
    let layout = vector.layout().clone();
    let dropped = Arc::new(AtomicUsize::new(0));
    for env in 0..4 {
        let row = CountedRow { row: OwnedRow::new(&layout), taken: Arc::clone(&dropped) };
        vector.send_reset(env, row).expect("an environment");
    }
    drop(vector);
    assert!(dropped.load(Ordering::Relaxed) <= 1, "{dropped:?} houses were prepared");
}

/// A row that counts its uses.
struct CountedRow {
    row: OwnedRow,
    taken: Arc<AtomicUsize>,
}

impl RowSource for CountedRow {
    fn row(&mut self) -> Row<'_> {
        self.taken.fetch_add(1, Ordering::Relaxed);
        self.row.row()
    }

    fn keep_final(&mut self) {}
}

/// Rows and flags of all environments after a few steps.
fn played(source: Arc<EpisodeSource>, threads: usize, autoreset: AutoReset) -> Vec<(OwnedRow, String)> {
    const COUNT: usize = 3;
    let cheap = CheapSenses { lidar: true, ears: true, map: true };
    let options = EnvOptions { autoreset, cheap, ..small_options() };
    let vector: VectorEnv<OwnedRow> =
        VectorEnv::new(COUNT, threads, source, options, audio()).expect("environments");
    let mut rows: Vec<Option<OwnedRow>> = (0..COUNT).map(|_| Some(OwnedRow::new(vector.layout()))).collect();
    let mut flags = vec![String::new(); COUNT];
    let wait = |rows: &mut Vec<Option<OwnedRow>>, flags: &mut Vec<String>| {
        for _ in 0..COUNT {
            let finished = vector.recv(1, PATIENCE).pop().expect("in time");
            flags[finished.env] += &format!("{:?}", finished.flags.expect("a step"));
            rows[finished.env] = Some(finished.row);
        }
    };
    for (env, row) in rows.iter_mut().enumerate() {
        vector.send_reset(env, row.take().expect("a row")).expect("open");
    }
    wait(&mut rows, &mut flags);
    // Environment 1 ends its episode in the third step.
    for actions in [[0, 0, 0], [1, 2, 0], [0, 4, 3], [0, 1, 1], [2, 0, 0]] {
        for (env, row) in rows.iter_mut().enumerate() {
            vector.send_step(env, actions[env], row.take().expect("a row")).expect("open");
        }
        wait(&mut rows, &mut flags);
    }
    rows.into_iter().map(|row| row.expect("a row")).zip(flags).collect()
}

#[test]
fn threads_do_not_change_bits() {
    for autoreset in [AutoReset::NextStep, AutoReset::SameStep] {
        let own = Arc::new(EpisodeSource::open(&small_houses(1)).expect("a source"));
        let single = played(shared_source(1, Goals::Drawn), 1, autoreset);
        assert_eq!(single, played(own, 4, autoreset));
        assert_eq!(single[1].0.finals.is_some(), autoreset == AutoReset::SameStep);
        assert!(single[0].0.finals.is_none());
        assert!(single[1].1.contains("terminated: true"));
    }
}

#[test]
fn curriculum_without_missions_is_an_error() {
    let nowhere =
        Curriculum { distance_m: [900.0, 999.0], rooms: Some([2, 2]), ..small_houses(0).curriculum };
    let source =
        EpisodeSource::open(&SourceOptions { curriculum: nowhere, ..small_houses(0) }).expect("a source");
    let error = source.episode(0, 0, &Rules::paper()).err().expect("no mission").to_string();
    assert!(error.contains("900 to 999 m from the start"), "{error}");
}

fn env_with(order: Order, options: EnvOptions) -> Env {
    Env::new(0, shared_source(5, Goals::Fixed(order)), options, audio()).expect("an environment")
}

fn exploring() -> EnvOptions {
    let mut options = EnvOptions { teacher: Teacher::Explore, goal_cues: false, ..small_options() };
    (options.sensors.rgb, options.sensors.depth, options.sensors.audio) = (false, false, false);
    options
}

#[test]
fn explorer_completes_missions_in_both_orders() {
    for order in [Order::Ordered, Order::Unordered] {
        let (mut explore, mut path) = (
            env_with(order, exploring()),
            env_with(order, EnvOptions { teacher: Teacher::Path, ..exploring() }),
        );
        let layout = explore.layout().clone();
        let (mut row, mut steps) = (OwnedRow::new(&layout), [0, 0]);
        for episode in 0..3 {
            for (env, steps) in [&mut explore, &mut path].into_iter().zip(&mut steps) {
                env.reset(&mut row.row()).expect("an episode");
                let (flags, _) = follow_teacher(env, &mut row);
                eprintln!(
                    "{order:?} {episode} {} {:?}",
                    row.shorts(&layout, "remaining")[0],
                    row.floats(&layout, "pose")
                );
                assert!(flags.terminated, "{order:?} {episode}");
                assert_eq!(row.floats(&layout, "success"), [1.0], "{order:?} {episode}");
                *steps += env.take_record().expect("an episode").1.steps.len();
            }
        }
        assert!(steps[0] > steps[1], "exploration takes longer: {steps:?}");
        assert!(steps[0] < 3 * 400, "{steps:?}");
    }
}

#[test]
fn explorer_answers_in_restored_states() {
    let (mut env, mut other) =
        (env_with(Order::Unordered, exploring()), env_with(Order::Unordered, exploring()));
    let layout = env.layout().clone();
    let (mut row, mut copy) = (OwnedRow::new(&layout), OwnedRow::new(&layout));
    env.reset(&mut row.row()).expect("an episode");
    // A learner that deviates from the teacher.
    for step in 0..60 {
        let expert = row.integer(&layout, "expert");
        let action = if step % 3 == 0 { 1 } else { expert };
        if env.step(action, &mut row.row()).expect("a step").is_over() {
            env.reset(&mut row.row()).expect("an episode");
        }
        if step % 20 == 19 {
            other.restore(&env.state().expect("an episode"), &mut copy.row()).expect("the same source");
            assert_eq!(row, copy, "{step}");
        }
    }
}

#[test]
fn right_claims_complete_goals() {
    for order in [Order::Ordered, Order::Unordered] {
        let mut env = env_with(order, EnvOptions { teacher: Teacher::Path, ..exploring() });
        let layout = env.layout().clone();
        let mut row = OwnedRow::new(&layout);
        for _ in 0..4 {
            env.reset(&mut row.row()).expect("an episode");
            loop {
                let (is_right, action) =
                    (row.bytes(&layout, "expert_submit")[0] == 1, row.integer(&layout, "expert"));
                let is_claim = action >= i64::from(Action::Submit.index());
                assert_eq!(is_right, is_claim);
                let open: u8 = row.bytes(&layout, "is_open").iter().sum();
                let flags = env.step(action, &mut row.row()).expect("a step");
                let now: u8 = row.bytes(&layout, "is_open").iter().sum();
                assert_eq!(open - now, u8::from(is_right));
                if flags.is_over() {
                    break;
                }
            }
        }
    }
}

#[test]
fn added_submits_are_observed_and_judged() {
    let mut env = env_with(Order::Ordered, EnvOptions { added_submits: 2, ..exploring() });
    let layout = env.layout().clone();
    let mut row = OwnedRow::new(&layout);
    env.reset(&mut row.row()).expect("an episode");
    let goals = i32::from(row.bytes(&layout, "is_open").iter().sum::<u8>());
    assert_eq!(row.shorts(&layout, "remaining")[1], goals - 1 + 2);
    env.step(3, &mut row.row()).expect("a Submit");
    assert_eq!(row.shorts(&layout, "remaining")[1], goals);
    let source = shared_source(1, Goals::Drawn);
    let error = Env::new(0, source, EnvOptions { added_submits: 101, ..small_options() }, audio()).err();
    assert!(error.expect("refused").to_string().contains("`added_submits` is 101; 0 to 100 are possible"));
}

#[test]
fn coefficients_change_the_reward() {
    let weights = ProgressReward { slack: 0.5, per_m: 0.0, stop: 3.0, ..ProgressReward::AUTHORS };
    let mut env =
        env_with(Order::Ordered, EnvOptions { reward: RewardRule::Progress(weights), ..exploring() });
    let mut row = OwnedRow::new(&env.layout().clone());
    env.reset(&mut row.row()).expect("an episode");
    assert_eq!(env.step(0, &mut row.row()).expect("a step").reward, 0.5);
    assert_eq!(env.step(4, &mut row.row()).expect("a Stop").reward, 3.5);
}
