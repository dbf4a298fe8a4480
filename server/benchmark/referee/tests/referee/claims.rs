//! Claims without Submits left, Stops with several open goals, and sounding distractors.

use crate::{AHEAD, ASSETS, BACK, DISTRACTOR, blind, bounds, episode, go, mission, quick, record, truth};
use avln_episode::{
    Action::{MoveForward, Stop, Submit, TurnLeft},
    DistractorSources, EndReason, ExtraSubmit, Feedback, FeedbackRule, Order, Rules, Sensors, StopClaims,
};
use avln_referee::{Audio, Referee, RefereeError, episode_sources};
use avln_truth::{DistractorSource, EpisodeTruth};

#[test]
fn extra_submit_only_uses_a_step() {
    let feedback = FeedbackRule::Verdict;
    let mut referee = episode(Order::Unordered, Rules { feedback, ..Rules::paper() }, blind());
    let first = go(&mut referee, &[(Submit, 1)]);
    assert_eq!((first.observation.remaining_submits, first.end), (1, None));
    assert_eq!(go(&mut referee, &[(Submit, 1)]).observation.remaining_submits, 0);
    go(&mut referee, &AHEAD);
    let extra = go(&mut referee, &[(Submit, 2)]);
    assert_eq!((extra.observation.step, extra.observation.remaining_submits, extra.end), (16, 0, None));
    assert_eq!((extra.observation.feedback, referee.is_open()), (Feedback::None, vec![true; 3]));
    assert_eq!(go(&mut referee, &[(Stop, 1)]).end, Some(EndReason::Stopped));
    let facts = record(referee);
    assert_eq!((facts.submits.len(), facts.found_at(3)), (3, vec![Some(17), None, None]));
}

#[test]
fn added_submits_extend_the_budget() {
    let mut referee = episode(Order::Unordered, Rules::paper(), blind()).with_added_submits(2);
    assert_eq!((referee.remaining_submits(), referee.completes(Submit)), (4, None));
    assert_eq!(go(&mut referee, &[(Submit, 3)]).observation.remaining_submits, 1);
    go(&mut referee, &AHEAD);
    assert_eq!((referee.completes(Submit), referee.completes(MoveForward)), (Some(0), None));
    assert_eq!(go(&mut referee, &[(Submit, 1)]).observation.remaining_submits, 0);
    assert_eq!((referee.is_open(), referee.completes(Submit)), (vec![false, true, true], None));
}

#[test]
fn extra_submit_ends_and_completes_under_its_rule() {
    let rules = Rules { extra_submit: ExtraSubmit::EndsEpisode, ..Rules::paper() };
    let mut referee = episode(Order::Unordered, rules, blind());
    assert_eq!(go(&mut referee, &[(Submit, 2)]).end, None);
    go(&mut referee, &AHEAD);
    assert_eq!(go(&mut referee, &[(Submit, 1)]).end, Some(EndReason::FinalSubmit));
    assert_eq!(record(referee).found_at(3), [Some(15), None, None]);
}

#[test]
fn step_limit_ends_after_extra_submits() {
    let mut referee = episode(Order::Unordered, Rules { max_steps: 4, ..Rules::paper() }, blind());
    assert_eq!(go(&mut referee, &[(Submit, 4)]).end, Some(EndReason::StepLimit));
    assert_eq!(record(referee).submits.len(), 2);
}

#[test]
fn stop_with_open_goals_follows_its_rule() {
    for (stop_claims, found) in [(StopClaims::AnyOpen, Some(13)), (StopClaims::LastOnly, None)] {
        let mut referee = episode(Order::Unordered, Rules { stop_claims, ..Rules::paper() }, blind());
        go(&mut referee, &AHEAD);
        assert_eq!(go(&mut referee, &[(Stop, 1)]).end, Some(EndReason::Stopped));
        assert_eq!(record(referee).found_at(3), [found, None, None], "{stop_claims:?}");
    }
}

#[test]
fn stop_completes_the_last_goal_under_both_rules() {
    for stop_claims in [StopClaims::AnyOpen, StopClaims::LastOnly] {
        let mut referee = episode(Order::Ordered, Rules { stop_claims, ..Rules::paper() }, blind());
        go(&mut referee, &AHEAD);
        go(&mut referee, &[(Submit, 1)]);
        go(&mut referee, &BACK);
        go(&mut referee, &[(TurnLeft, 9), (MoveForward, 12), (Submit, 1), (TurnLeft, 6), (MoveForward, 24)]);
        go(&mut referee, &[(Stop, 1)]);
        assert!(record(referee).found_at(3).iter().all(Option::is_some), "{stop_claims:?}");
    }
}

/// A truth with the fourth object as the only distractor source, which occurs `count` times.
fn distracted(count: usize) -> EpisodeTruth {
    let category = "box0".to_owned();
    let distractor = DistractorSource { instance: 4, category, source: bounds(DISTRACTOR).center() };
    EpisodeTruth { distractor_sources: vec![distractor; count], ..truth(Order::Unordered) }
}

fn play(rules: Rules, truth: EpisodeTruth, sensors: Sensors) -> Result<Referee, RefereeError> {
    Referee::new(ASSETS.clone(), mission(Order::Unordered), truth, rules, sensors, &Audio::default())
}

#[test]
fn distractors_sound_in_turn_and_complete_nothing() {
    let rules = Rules { distractor_sources: DistractorSources::Number(1), ..Rules::paper() };
    let listening = Sensors { audio: true, ..blind() };
    let mut referee = play(rules, distracted(2), listening).expect("a legal episode");
    let mut positions = std::collections::BTreeMap::new();
    let mut silent = 0;
    for _ in 0..110 {
        let seen = go(&mut referee, &[(TurnLeft, 1)]).observation;
        silent += usize::from(seen.audio.expect("audio was asked for").iter().all(|sample| *sample == 0.0));
        let source = referee.sounding().expect("a source");
        positions.insert(source, referee.sounding_position().expect("a position"));
    }
    assert_eq!((positions.keys().copied().collect::<Vec<_>>(), silent), (vec![0, 1, 2, 3], 0));
    assert_eq!(positions[&3], bounds(DISTRACTOR).center());
    let (truth, facts) = referee.into_record();
    assert_eq!(truth.distractor_sources.len(), 1, "the rules' number");
    assert_eq!(episode_sources(&Rules::paper(), &truth).len(), 4);
    assert!(facts.steps.iter().any(|step| step.sounding == Some(3)));
}

#[test]
fn missing_distractors_are_refused() {
    let refused = play(Rules::hard(), distracted(2), blind()).err().expect("three are needed").to_string();
    assert!(refused.contains("'lh-avln-hard-v1' need 3 distractor sources, the truth has 2"), "{refused}");
    let (truth, _) = play(Rules::paper(), distracted(2), blind()).expect("none is needed").into_record();
    assert!(truth.distractor_sources.is_empty());
}

#[test]
fn remaining_submits_are_those_of_observations() {
    let mut referee = quick(Order::Unordered);
    for expected in [2, 1, 0, 0] {
        assert_eq!(referee.remaining_submits(), expected);
        assert_eq!(
            go(&mut referee, &[(Submit, 1)]).observation.remaining_submits,
            referee.remaining_submits()
        );
    }
}
