//! Facts in the record, and the referee's state, which agents never see. Claims without Submits left, Stops with several open goals,
//! and sounding distractors.

use crate::{
    AHEAD, ASSETS, BACK, DISTRACTOR, blind, bounds, episode, go, mission, quick, record, truth, try_play,
};
use avln_episode::{
    Action::{MoveForward, Stop, Submit, TurnLeft, TurnRight},
    DistractorSources, EndReason, ExtraSubmit, Feedback, FeedbackRule, GoalCue, Mission, Order, Point3, Pose,
    RgbImage, Rules, Sensors, StopClaims,
};
use avln_referee::{Audio, Bank, Head, Referee, RefereeError, episode_sounds, episode_sources};
use avln_truth::{DistractorSource, EpisodeTruth, StepFacts};

/// Returns a blind and deaf episode.
fn play(truth: EpisodeTruth, rules: Rules) -> Referee {
    try_play(mission(truth.order), truth, rules, blind()).expect("a legal episode")
}

/// Returns a truth with the start at (`x`, `z`), facing -Z.
fn start_at(x: f32, z: f32, order: Order) -> EpisodeTruth {
    EpisodeTruth { start: Pose::new(Point3::new(x, 0.0, z), 0.0), ..truth(order) }
}

#[test]
fn every_goal_has_its_own_region_bit() {
    let mut referee = quick(Order::Unordered);
    go(&mut referee, &AHEAD);
    go(&mut referee, &BACK);
    go(&mut referee, &[(TurnRight, 3), (MoveForward, 12), (TurnLeft, 6), (MoveForward, 24)]);
    let facts = record(referee);
    // Next to the first target, at the start, next to the second and next to the third target.
    let regions = [12, 30, 45, 75].map(|step: usize| facts.steps[step - 1].in_region);
    assert_eq!(regions, [0b001, 0, 0b010, 0b100]);
}

#[test]
fn start_regions_and_final_distances_are_recorded() {
    let facts = record(play(start_at(0.0, -3.0, Order::Unordered), Rules::paper()));
    assert_eq!(facts.in_region_at_start, [true, false, false]);
    // Each region is one place: (0, -3.75), (-3.75, 0) and (3.75, 0).
    let aside_m = 3.75_f64.hypot(3.0);
    assert_eq!(facts.final_distance_m.len(), 3);
    for (found, expected) in facts.final_distance_m.iter().zip([0.75, aside_m, aside_m]) {
        assert!(found.is_some_and(|metres| (metres - expected).abs() < 0.01), "{found:?}, not {expected}");
    }
}

#[test]
fn distractors_share_the_category_on_any_floor() {
    // Next to the distractor of the first goal; next to the second target, while the first goal is next.
    for (x, z, wrong_instance) in [(4.0, 6.0, Some(0)), (-3.0, 0.0, None)] {
        let mut truth = start_at(x, z, Order::Ordered);
        truth.targets[0].floor_y_m = 3.0;
        let mut referee = play(truth, Rules::paper());
        go(&mut referee, &[(Submit, 1)]);
        let submits = record(referee).submits;
        assert_eq!((submits[0].completed, submits[0].wrong_instance), (None, wrong_instance), "({x}, {z})");
    }
}

#[test]
fn right_submits_are_not_wrong_beside_distractors() {
    // The target is the far box of the category, in the place of the near one, which is thus its distractor.
    for (instance, facts) in [(4, (Some(0), None)), (99, (None, Some(0)))] {
        let mut truth = start_at(0.0, -3.0, Order::Ordered);
        truth.targets[0].instance = instance;
        let mut referee = play(truth, Rules::paper());
        go(&mut referee, &[(Submit, 1)]);
        let submits = record(referee).submits;
        assert_eq!((submits[0].completed, submits[0].wrong_instance), facts, "instance {instance}");
    }
}

#[test]
fn authors_rules_need_the_target_in_the_picture() {
    let mut referee = episode(Order::Unordered, Rules::authors(), blind());
    go(&mut referee, &AHEAD);
    // The picture is 45 degrees wide to each side; the target spans 8 degrees to each side of its centre.
    let at_60_degrees = go(&mut referee, &[(TurnLeft, 2), (Submit, 1)]).observation.feedback;
    let at_30_degrees = go(&mut referee, &[(TurnRight, 1), (Submit, 1)]).observation.feedback;
    assert_eq!((at_60_degrees, at_30_degrees), (Feedback::Verdict(false), Feedback::Verdict(true)));
    let facts = record(referee);
    assert_eq!(facts.found_at(3), [Some(17), None, None]);
    assert_eq!([11, 13, 15].map(|index: usize| facts.steps[index].in_region), [0b001, 0, 0b001]);
}

#[test]
fn authors_rules_need_a_walk_below_the_radius() {
    let inside = |success_radius_m: f32| {
        let rules = Rules { success_radius_m, ..Rules::authors() };
        // On the viewpoint of the first target, which is ahead: the walk has no length.
        record(play(start_at(0.0, -3.75, Order::Unordered), rules)).in_region_at_start
    };
    assert_eq!(inside(0.001), [true, false, false]);
    assert_eq!(inside(0.0), [false; 3]);
}

#[test]
fn authors_schedule_counts_moves_and_turns_only() {
    let mut referee = episode(Order::Unordered, Rules::authors(), blind());
    assert_eq!(referee.sounding(), None, "before the first observation");
    go(&mut referee, &[(Submit, 1), (TurnLeft, 25)]);
    assert_eq!(referee.sounding(), Some(0));
    go(&mut referee, &[(TurnLeft, 1)]);
    assert_eq!(referee.sounding(), Some(1));
    let sounding: Vec<_> = record(referee).steps.iter().map(|step| step.sounding).collect();
    assert_eq!(sounding, [vec![Some(0); 26], vec![Some(1)]].concat());
}

#[test]
fn hash_and_openness_follow_goal_states() {
    // Each goal rotates the hash by five bits and adds its state without carry: open 1, found 2, skipped 3. Without the
    // body's hash, rotated by 15 bits, the states remain in five bits each: 0x421 is 1, 1, 1.
    let states = |referee: &Referee| referee.state_hash() ^ referee.world().state_hash().rotate_left(15);
    let mut referee = quick(Order::Ordered);
    assert_eq!((states(&referee), referee.is_open()), (0x421, vec![true; 3]));
    go(&mut referee, &AHEAD);
    go(&mut referee, &[(Submit, 1)]);
    assert_eq!((states(&referee), referee.is_open()), (0x821, vec![false, true, true]));
    let mut referee = episode(Order::Ordered, Rules::authors(), blind());
    go(&mut referee, &[(Submit, 1)]);
    assert_eq!((states(&referee), referee.is_open()), (0xc21, vec![false, true, true]));
}

#[test]
fn most_bytes_add_sound_pictures_and_steps() {
    let picture = RgbImage { width: 2, height: 3, pixels: vec![0; 18] };
    let mut goals = mission(Order::Ordered).goals;
    (goals[1], goals[2]) = (GoalCue::Image(picture), GoalCue::Description("the red box".to_owned()));
    let bytes = |sensors: Sensors| {
        let mission = Mission { order: Order::Ordered, goals: goals.clone() };
        let played = try_play(mission, truth(Order::Ordered), Rules::paper(), sensors);
        let referee = played.expect("a legal episode");
        (referee.most_bytes(), referee.world().most_bytes())
    };
    let steps = 1000 * size_of::<StepFacts>();
    assert_eq!(bytes(blind()), (18 + steps, 0));
    let (most, sound) = bytes(Sensors { audio: true, ..blind() });
    assert!(sound > 0);
    assert_eq!(most, sound + 18 + steps);
}

#[test]
fn first_end_from_outside_counts() {
    let mut referee = quick(Order::Unordered);
    go(&mut referee, &[(TurnLeft, 1)]);
    assert_eq!(referee.end(), None);
    referee.truncate(EndReason::Disconnected);
    referee.truncate(EndReason::TimeBudget);
    assert_eq!(referee.end(), Some(EndReason::Disconnected));
    let error = referee.step(TurnLeft).expect_err("it is over");
    assert!(matches!(error, RefereeError::Over { reason: EndReason::Disconnected, steps: 1 }), "{error}");
    assert_eq!(record(referee).end, EndReason::Disconnected);
    let mut running = quick(Order::Unordered);
    go(&mut running, &[(TurnLeft, 1)]);
    assert_eq!(record(running).end, EndReason::Abandoned);
}

#[test]
fn cameras_send_requested_pictures_only() {
    for (rgb, depth) in [(true, false), (false, true)] {
        let sensors = Sensors { rgb, depth, audio: false, ..Sensors::all(64, 64) };
        let seen = episode(Order::Ordered, Rules::paper(), sensors).start();
        let lengths = (seen.rgb.map(|bytes| bytes.len()), seen.depth.map(|metres| metres.len()));
        assert_eq!(lengths, (rgb.then_some(64 * 64 * 3), depth.then_some(64 * 64)));
    }
}

#[test]
fn sound_is_heard_with_the_given_head() {
    let heard = |head: Head| {
        let (order, audio) = (Order::Ordered, Audio { head, ..Audio::default() });
        let sensors = Sensors { audio: true, ..blind() };
        Referee::new(ASSETS.clone(), mission(order), truth(order), Rules::paper(), sensors, &audio)
            .expect("a legal episode")
            .start()
            .audio
    };
    let (omni, sphere) = (heard(Head::Omni), heard(Head::Sphere));
    assert!(omni.is_some() && omni != sphere, "the head shapes the sound");
}

#[test]
fn extra_submit_only_uses_a_step() {
    let feedback = FeedbackRule::Verdict;
    let mut referee = episode(Order::Unordered, Rules { feedback, ..Rules::paper() }, blind());
    let first = go(&mut referee, &[(Submit, 1)]);
    assert_eq!((first.observation.remaining_submits, first.end), (1, None));
    assert_eq!(go(&mut referee, &[(Submit, 1)]).observation.remaining_submits, 0);
    go(&mut referee, &AHEAD);
    assert_eq!((referee.completes(Submit), referee.completes(Stop)), (None, Some(0)));
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

#[test]
fn distractors_sound_in_turn_and_complete_nothing() {
    let rules = Rules { distractor_sources: DistractorSources::Number(1), ..Rules::paper() };
    let listening = Sensors { audio: true, ..blind() };
    let mut referee =
        try_play(mission(Order::Unordered), distracted(2), rules, listening).expect("a legal episode");
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
    let lifted = Rules { source_lift_m: 0.5, ..Rules::paper() };
    let heights_m = [bounds(DISTRACTOR).center().y, episode_sources(&lifted, &truth)[3].y];
    assert_eq!(heights_m[1], heights_m[0] + 0.5);
    assert!(facts.steps.iter().any(|step| step.sounding == Some(3)));
}

#[test]
fn sounds_are_those_of_the_rules() {
    let rules = |count: u32| Rules { distractor_sources: DistractorSources::Number(count), ..Rules::paper() };
    let truth = distracted(2);
    for count in [0, 1, 2] {
        let sounds = episode_sounds(&rules(count), &truth, &Bank::default()).expect("enough clips");
        let positions: Vec<_> = sounds.iter().map(|sound| sound.position).collect();
        assert_eq!(positions, episode_sources(&rules(count), &truth)[..3 + count as usize]);
    }
}

#[test]
fn instances_are_stored_on_request() {
    let eyes = Sensors { depth: false, audio: false, ..Sensors::all(64, 64) };
    let mut seen = [false, true].map(|is_stored| {
        let referee = episode(Order::Unordered, Rules::paper(), eyes.clone());
        let mut referee = if is_stored { referee.with_instances() } else { referee };
        go(&mut referee, &[(MoveForward, 1)]);
        referee.instances().map(<[_]>::to_vec)
    });
    assert_eq!(seen[0], None);
    let stored = seen[1].take().expect("instances");
    assert_eq!(stored.len(), 64 * 64);
    // The first target is straight ahead.
    assert!(stored.iter().any(|instance| instance.0 == 1));
}

#[test]
fn missing_distractors_are_refused() {
    let refused = try_play(mission(Order::Unordered), distracted(2), Rules::hard(), blind())
        .err()
        .expect("three are needed")
        .to_string();
    assert!(refused.contains("'lh-avln-hard-v1' need 3 distractor sources, the truth has 2"), "{refused}");
    let (truth, _) = try_play(mission(Order::Unordered), distracted(2), Rules::paper(), blind())
        .expect("none is needed")
        .into_record();
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

#[test]
fn ways_to_the_goals_are_known() {
    let referee = play(start_at(0.0, -3.0, Order::Unordered), Rules::paper());
    let is_near =
        |found_m: Option<f64>, expected_m: f64| found_m.is_some_and(|m| (m - expected_m).abs() < 0.01);
    // Each region is one place: (0, -3.75), (-3.75, 0) and (3.75, 0).
    let aside_m = 3.75_f64.hypot(3.0);
    for (goal, expected_m) in [0.75, aside_m, aside_m].into_iter().enumerate() {
        assert!(is_near(referee.walk_m(goal), expected_m), "goal {goal}: {:?}", referee.walk_m(goal));
        assert_eq!(referee.is_in_region(goal), goal == 0);
        let center = ASSETS.navmesh.project(&Point3::origin()).expect("floor");
        assert!(is_near(referee.walk_from_m(&center, goal), 3.75));
    }
    let way = referee.walk(2).expect("a way");
    let ends = [way[0], way[way.len() - 1]].map(|corner| [corner.x, corner.z]);
    for (end, expected) in ends.as_flattened().iter().zip([0.0, -3.0, 3.75, 0.0]) {
        assert!((end - expected).abs() < 0.01, "{ends:?}");
    }
}

#[test]
fn found_goals_and_facts_are_visible_in_the_episode() {
    let mut referee = quick(Order::Unordered);
    assert_eq!((referee.is_found(), referee.facts().len()), (vec![false; 3], 0));
    go(&mut referee, &AHEAD);
    go(&mut referee, &[(Submit, 1)]);
    assert_eq!(referee.is_found(), [true, false, false]);
    assert_eq!(referee.facts().len() as u32, referee.steps());
    assert_eq!(referee.facts().last().map(|fact| fact.action), Some(Submit));
}
