//! The referee from outside, on a hand-made floor; replay of interrupted episodes.

mod floor;
mod rules;
mod sounds;

use crate::floor::{episode, quick};
use avln_episode::{
    Action::{self, MoveForward, Stop, Submit, TurnLeft},
    Order, Rules, Sensors,
};
use avln_referee::{Referee, RefereeError};

const WALK: [Action; 12] = [
    MoveForward,
    TurnLeft,
    MoveForward,
    MoveForward,
    Submit,
    TurnLeft,
    TurnLeft,
    MoveForward,
    MoveForward,
    MoveForward,
    TurnLeft,
    Stop,
];

fn noisy() -> Referee {
    episode(Order::Unordered, Rules::noisy(), Sensors::all(64, 64))
}

fn step(referee: &mut Referee, action: Action) -> (Action, u64) {
    referee.step(action).expect("still running");
    (action, referee.state_hash())
}

#[test]
fn every_sense_goes_on_bit_by_bit_wherever_it_was_interrupted() {
    let mut whole = noisy();
    whole.start();
    let outcomes: Vec<_> = WALK.iter().map(|&action| whole.step(action).expect("still running")).collect();
    let mut taken = Vec::new();
    let mut tape = noisy();
    for cut in 1..WALK.len() {
        taken.push(step(&mut tape, WALK[cut - 1]));
        let mut resumed = noisy();
        assert_eq!(resumed.replay(&taken).expect("the same world").as_ref(), Some(&outcomes[cut - 1]));
        for (&action, outcome) in WALK.iter().zip(&outcomes).skip(cut) {
            assert_eq!(&resumed.step(action).expect("still running"), outcome, "cut after {cut}");
        }
    }
    assert_eq!(whole.end(), outcomes.last().expect("twelve").end);
}

#[test]
fn the_facts_are_those_of_an_episode_that_was_not_interrupted() {
    let mut whole = noisy();
    let taken: Vec<_> = WALK.iter().map(|&action| step(&mut whole, action)).collect();
    let mut resumed = noisy();
    resumed.replay(&taken).expect("the same world");
    assert_eq!(resumed.into_record(), whole.into_record());
}

#[test]
fn another_world_is_told_by_its_step() {
    let mut referee = quick(Order::Ordered);
    let mut taken: Vec<_> = WALK[..4].iter().map(|&action| step(&mut referee, action)).collect();
    taken[2].1 ^= 1;
    let error = quick(Order::Ordered).replay(&taken).expect_err("a state that never was");
    assert!(matches!(error, RefereeError::Diverged { step: 3, .. }), "{error}");
    assert!(quick(Order::Ordered).replay(&[]).expect("nothing to do").is_none());
}

#[test]
fn actions_after_the_end_are_no_episode() {
    let mut referee = quick(Order::Ordered);
    let end = step(&mut referee, Stop);
    let error = quick(Order::Ordered).replay(&[end, end]).expect_err("Stop is the end");
    assert!(matches!(error, RefereeError::Over { steps: 1, .. }), "{error}");
}
