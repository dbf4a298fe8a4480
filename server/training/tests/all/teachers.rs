//! Teachers, right claims, rewards and budgets.

use crate::memory::{OwnRow, audio, follow_teacher, small_houses, small_options};
use avln_episode::{Action, Order};
use avln_training::{
    Env, EnvOptions, EpisodeSource, Goals, ProgressReward, RewardRule, RowSource, SourceOptions, Teacher,
};

fn env_with(order: Order, options: EnvOptions) -> Env {
    let source = SourceOptions { goals: Goals::Fixed(order), ..small_houses(5) };
    let source = EpisodeSource::open(&source).expect("a source");
    Env::new(0, source, options, audio()).expect("an environment")
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
        let (mut row, mut steps) = (OwnRow::new(&layout), [0, 0]);
        for episode in 0..5 {
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
        assert!(steps[0] < 5 * 400, "{steps:?}");
    }
}

#[test]
fn explorer_answers_in_restored_states() {
    let (mut env, mut other) =
        (env_with(Order::Unordered, exploring()), env_with(Order::Unordered, exploring()));
    let layout = env.layout().clone();
    let (mut row, mut copy) = (OwnRow::new(&layout), OwnRow::new(&layout));
    env.reset(&mut row.row()).expect("an episode");
    // A learner that deviates from the teacher.
    for step in 0..60 {
        let expert = row.integer(&layout, "expert") as u32;
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
        let mut row = OwnRow::new(&layout);
        for _ in 0..4 {
            env.reset(&mut row.row()).expect("an episode");
            loop {
                let (is_right, action) =
                    (row.bytes(&layout, "expert_submit")[0] == 1, row.integer(&layout, "expert") as u32);
                let is_claim = action >= u32::from(Action::Submit.index());
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
    let mut row = OwnRow::new(&layout);
    env.reset(&mut row.row()).expect("an episode");
    let goals = i32::from(row.bytes(&layout, "is_open").iter().sum::<u8>());
    assert_eq!(row.shorts(&layout, "remaining")[1], goals - 1 + 2);
    env.step(3, &mut row.row()).expect("a Submit");
    assert_eq!(row.shorts(&layout, "remaining")[1], goals);
    let source = EpisodeSource::open(&small_houses(1)).expect("a source");
    let error = Env::new(0, source, EnvOptions { added_submits: 101, ..small_options() }, audio()).err();
    assert!(error.expect("refused").to_string().contains("`added_submits` is 101; 0 to 100 are possible"));
}

#[test]
fn coefficients_change_the_reward() {
    let weights = ProgressReward { slack: 0.5, per_m: 0.0, stop: 3.0, ..ProgressReward::AUTHORS };
    let mut env =
        env_with(Order::Ordered, EnvOptions { reward: RewardRule::Progress(weights), ..exploring() });
    let mut row = OwnRow::new(&env.layout().clone());
    env.reset(&mut row.row()).expect("an episode");
    assert_eq!(env.step(0, &mut row.row()).expect("a step").reward, 0.5);
    assert_eq!(env.step(4, &mut row.row()).expect("a Stop").reward, 3.5);
}
