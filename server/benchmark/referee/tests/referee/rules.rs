//! Every rule of the task.

use crate::{AHEAD, ASSETS, BACK, blind, episode, go, mission, quick, record, truth, try_play};
use avln_episode::{
    Action::{self, MoveForward, Stop, Submit, TurnLeft, TurnRight},
    EndReason, Feedback, FeedbackRule, GoalCue, Mission, Modality, Observation, Order, Point3, Pose,
    RgbNoise, Rules, Sensors, SilenceRule, SoundClip, Sounds,
};
use avln_referee::{Audio, Bank, Referee, RefereeError, made_bank};
use avln_truth::{EpisodeTruth, Record};
use avln_world::Clip;
use std::f32::consts::FRAC_PI_2;

#[test]
fn success_radius_is_two_metres() {
    // The box's near face is at z = -4.75 and lower than the camera of 1 m only at its rim: 2 m away is z = -2.75.
    let mut referee = quick(Order::Unordered);
    go(&mut referee, &[(MoveForward, 10)]);
    let outside = go(&mut referee, &[(Submit, 1)]);
    assert_eq!(outside.end, None);
    go(&mut referee, &[(MoveForward, 1), (Submit, 1)]);
    let facts = record(referee);
    assert_eq!(facts.found_at(3), [Some(13), None, None]);
    assert_eq!(facts.submits[0].completed, None);
    assert_eq!(facts.steps[9].in_region, 0);
    assert_eq!(facts.steps[11].in_region, 0b001);
}

#[test]
fn mesh_distances_ignore_empty_space_in_boxes() {
    // The first box reaches a metre beyond the mesh: by the box the region begins after 6 steps, by the mesh after 11.
    let mut truth = truth(Order::Unordered);
    truth.targets[0].bounds = truth.targets[0].bounds.grown(1.0);
    let in_region = |rules: Rules| {
        let played = try_play(mission(Order::Unordered), truth.clone(), rules, blind());
        let mut referee = played.expect("a legal episode");
        go(&mut referee, &[(MoveForward, 12), (Stop, 1)]);
        record(referee).steps.iter().position(|step| step.in_region & 1 == 1).map(|index| index + 1)
    };
    assert_eq!((in_region(Rules::paper()), in_region(Rules::mesh())), (Some(7), Some(11)));
}

#[test]
fn ordered_mission_accepts_the_next_goal_only() {
    let mut referee = quick(Order::Ordered);
    // To the second target first: it does not count yet.
    go(&mut referee, &[(TurnLeft, 3), (MoveForward, 12), (Submit, 1)]);
    go(&mut referee, &[(TurnLeft, 6), (MoveForward, 12), (TurnLeft, 3)]);
    go(&mut referee, &AHEAD);
    go(&mut referee, &[(Submit, 1)]);
    let completed: Vec<_> = record(referee).submits.iter().map(|submit| submit.completed).collect();
    assert_eq!(completed, [None, Some(0)]);
}

#[test]
fn claim_at_distractor_is_recorded() {
    const TO_DISTRACTOR: [(Action, usize); 4] =
        [(TurnLeft, 6), (MoveForward, 24), (TurnLeft, 3), (MoveForward, 16)];
    for order in [Order::Ordered, Order::Unordered] {
        let mut referee = quick(order);
        go(&mut referee, &[(Submit, 1)]);
        go(&mut referee, &TO_DISTRACTOR);
        go(&mut referee, &[(Submit, 1)]);
        let submits = record(referee).submits;
        let completed: Vec<_> = submits.iter().map(|submit| submit.completed).collect();
        let wrong: Vec<_> = submits.iter().map(|submit| submit.wrong_instance).collect();
        assert_eq!((completed, wrong), (vec![None, None], vec![None, Some(0)]));
    }
    let mut referee = quick(Order::Ordered);
    go(&mut referee, &AHEAD);
    go(&mut referee, &[(Submit, 1)]);
    go(&mut referee, &BACK);
    go(&mut referee, &TO_DISTRACTOR[1..]);
    go(&mut referee, &[(Submit, 1)]);
    let submits = record(referee).submits;
    assert_eq!((submits[1].completed, submits[1].wrong_instance), (None, None), "that goal is found already");
}

#[test]
fn authors_rules_skip_goals_after_wrong_submits() {
    let mut referee = episode(Order::Ordered, Rules::authors(), blind());
    go(&mut referee, &[(Submit, 1)]);
    let (open, found) = (referee.is_open(), referee.is_found());
    assert!(!open[0] && open[1..].iter().all(|open| *open) && !found.contains(&true), "{open:?} {found:?}");
    let facts = record(referee);
    assert_eq!((facts.submits[0].completed, facts.submits[0].skipped), (None, Some(0)));
}

#[test]
fn stop_ends_the_episode() {
    let mut referee = quick(Order::Unordered);
    assert_eq!(go(&mut referee, &[(Stop, 1)]).end, Some(EndReason::Stopped));
    let error = referee.step(MoveForward).expect_err("it is over");
    assert!(matches!(error, RefereeError::Over { reason: EndReason::Stopped, steps: 1 }), "{error}");
    referee.truncate(EndReason::Disconnected);
    assert_eq!(record(referee).end, EndReason::Stopped);
}

#[test]
fn whole_mission_can_be_completed() {
    let mut referee = quick(Order::Ordered);
    go(&mut referee, &AHEAD);
    go(&mut referee, &[(Submit, 1)]);
    go(&mut referee, &BACK);
    go(&mut referee, &[(TurnRight, 3), (MoveForward, 12), (Submit, 1), (TurnLeft, 6), (MoveForward, 24)]);
    assert_eq!(go(&mut referee, &[(Stop, 1)]).end, Some(EndReason::Stopped));
    assert!(record(referee).found_at(3).iter().all(Option::is_some));
}

#[test]
fn all_five_actions_count_as_steps() {
    let rules = Rules { max_steps: 13, ..Rules::paper() };
    let mut referee = episode(Order::Unordered, rules, blind());
    let before = go(&mut referee, &AHEAD);
    assert_eq!((before.observation.step, before.observation.remaining_steps, before.end), (12, 1, None));
    let last = go(&mut referee, &[(Submit, 1)]);
    assert_eq!((last.observation.remaining_steps, last.end), (0, Some(EndReason::StepLimit)));
    assert_eq!(record(referee).found_at(3), [Some(13), None, None]);
}

#[test]
fn pose_is_relative_to_the_start() {
    let mut referee = quick(Order::Unordered);
    let told = go(&mut referee, &[(TurnLeft, 3), (MoveForward, 4)]).observation.pose;
    assert!((told.position - Point3::new(-1.0, 0.0, 0.0)).norm() < 0.02, "{told:?}");
    assert!((told.heading_rad - FRAC_PI_2).abs() < 1e-5);
}

#[test]
fn found_target_falls_silent_and_others_alternate() {
    let sensors = Sensors { rgb: false, depth: false, ..Sensors::all(64, 64) };
    let mut referee = episode(Order::Unordered, Rules::paper(), sensors);
    go(&mut referee, &AHEAD);
    let heard = go(&mut referee, &[(Submit, 1)]).observation.audio.expect("audio was asked for");
    assert_eq!(heard.len(), 8000);
    assert!(heard.iter().any(|sample| sample.abs() > 1e-4));
    go(&mut referee, &[(TurnLeft, 80)]);
    let facts = record(referee);
    let sounding: Vec<_> = facts.steps[12..].iter().map(|step| step.sounding).collect();
    assert!(!sounding.contains(&Some(0)) && !sounding.contains(&None));
    assert!(sounding.contains(&Some(1)) && sounding.contains(&Some(2)));
}

#[test]
fn later_silence_hides_a_right_submit() {
    let sounding = |silence: SilenceRule, action: Action| {
        let mut referee = episode(Order::Unordered, Rules { silence, ..Rules::paper() }, blind());
        go(&mut referee, &AHEAD);
        go(&mut referee, &[(action, 1), (TurnLeft, 80)]);
        let facts = record(referee);
        assert_eq!(facts.submits.iter().any(|submit| submit.completed == Some(0)), action == Submit);
        facts.steps.iter().map(|step| step.sounding).collect::<Vec<_>>()
    };
    for silence in [SilenceRule::Delayed, SilenceRule::WindowEnd] {
        let (right, none) = (sounding(silence, Submit), sounding(silence, TurnLeft));
        assert_eq!(right[..13], none[..13], "{silence:?}: the next observation is the same");
        assert!(!right[60..].contains(&Some(0)), "{silence:?}: it falls silent later");
    }
    assert!(!sounding(SilenceRule::Immediate, Submit)[12..].contains(&Some(0)));
}

#[test]
fn feedback_follows_the_rules() {
    for (rule, right, wrong) in [
        (FeedbackRule::None, Feedback::None, Feedback::None),
        (FeedbackRule::Accepted, Feedback::Accepted, Feedback::Accepted),
        (FeedbackRule::Verdict, Feedback::Verdict(true), Feedback::Verdict(false)),
    ] {
        let mut referee = episode(Order::Unordered, Rules { feedback: rule, ..Rules::paper() }, blind());
        assert_eq!(go(&mut referee, &[(Submit, 1)]).observation.feedback, wrong);
        assert_eq!(go(&mut referee, &AHEAD).observation.feedback, Feedback::None);
        assert_eq!(go(&mut referee, &[(Submit, 1)]).observation.feedback, right);
    }
}

#[test]
fn equal_actions_give_equal_observations_and_hashes() {
    let walk = [(MoveForward, 3), (TurnRight, 2), (MoveForward, 5), (Submit, 1), (TurnLeft, 1)];
    let play = || {
        let mut referee = episode(Order::Unordered, Rules::paper(), Sensors::all(64, 64));
        let last = go(&mut referee, &walk).observation;
        (last, record(referee))
    };
    let (a, b) = (play(), play());
    assert_eq!(a, b);
    let hashes: std::collections::BTreeSet<_> = a.1.steps.iter().map(|step| step.state_hash).collect();
    assert_eq!(hashes.len(), a.1.steps.len(), "every step has a state of its own");
}

#[test]
fn asking_for_the_start_again_changes_nothing() {
    let mut referee = episode(Order::Unordered, Rules::paper(), Sensors::all(64, 64));
    let first = referee.start();
    assert_eq!(referee.start(), first);
    assert_eq!(first.step, 0);
    let mut other = episode(Order::Unordered, Rules::paper(), Sensors::all(64, 64));
    assert_eq!(
        referee.step(TurnLeft).expect("runs"),
        other.step(TurnLeft).expect("runs"),
        "start is implied"
    );
}

#[test]
fn authors_rules_pad_audio_and_divide_depth() {
    let paper = episode(Order::Unordered, Rules::paper(), Sensors::all(64, 64)).start();
    let raised = Rules { camera_height_m: 1.0, ..Rules::authors() };
    let authors = episode(Order::Unordered, raised, Sensors::all(64, 64)).start();
    assert_eq!(authors.audio.expect("audio").len(), 32_000);
    let (near, far) = (paper.depth.expect("depth"), authors.depth.expect("depth"));
    assert!(near.iter().zip(&far).all(|(metres, share)| (metres / 10.0 - share).abs() < 1e-6));
}

#[test]
fn noisy_sensors_change_pixels_and_never_facts() {
    let walk = [(MoveForward, 3), (TurnRight, 2), (TurnLeft, 2), (MoveForward, 9), (Submit, 1)];
    let play = |rules: Rules| {
        let mut referee = episode(Order::Unordered, rules, Sensors::all(64, 64));
        let start = referee.start();
        let last = go(&mut referee, &walk).observation;
        ([start, last], Record { rules: String::new(), ..record(referee) })
    };
    let ((clean, clean_facts), (noisy, noisy_facts)) = (play(Rules::paper()), play(Rules::noisy()));
    assert_eq!(clean_facts, noisy_facts);
    assert_eq!(clean_facts.submits[0].completed, Some(0));
    assert_eq!(play(Rules::noisy()).0, noisy, "the same episode again");
    for (clean, noisy) in clean.iter().zip(&noisy) {
        assert_ne!(clean.rgb, noisy.rgb);
        assert_ne!(clean.depth, noisy.depth);
        let without = |seen: &Observation| Observation { rgb: None, depth: None, ..seen.clone() };
        assert_eq!(without(clean), without(noisy));
    }
    let one = Rules { rgb_noise: RgbNoise::None, ..Rules::noisy() };
    let (half, _) = play(one);
    assert_eq!((&half[1].rgb, &half[1].depth), (&clean[1].rgb, &noisy[1].depth));
}

#[test]
fn impossible_episodes_are_refused_with_a_reason() {
    let small = Sensors { width: 8, ..Sensors::all(64, 64) };
    let truth = || truth(Order::Ordered);
    let mission = |goals: usize| Mission {
        order: Order::Ordered,
        goals: (0..goals).map(|_| GoalCue::Category("box".to_owned())).collect(),
    };
    let new = |mission, truth, sensors| try_play(mission, truth, Rules::paper(), sensors);
    assert!(matches!(new(mission(3), truth(), small), Err(RefereeError::Sensors(_))));
    assert!(matches!(
        new(mission(2), truth(), blind()),
        Err(RefereeError::Mismatch { goals: 2, targets: 3, .. })
    ));
    let outside = EpisodeTruth { start: Pose::new(Point3::new(99.0, 0.0, 0.0), 0.0), ..truth() };
    assert!(matches!(new(mission(3), outside, blind()), Err(RefereeError::Start { .. })));
}

fn listening() -> Sensors {
    Sensors { rgb: false, depth: false, ..Sensors::all(64, 64) }
}

fn play(rules: &Rules, truth: EpisodeTruth, bank: &Bank) -> Result<Referee, RefereeError> {
    Referee::new(
        ASSETS.clone(),
        mission(Order::Unordered),
        truth,
        rules.clone(),
        listening(),
        &Audio::from(bank.clone()),
    )
}

fn energy(observation: &Observation) -> f32 {
    observation.audio.as_ref().expect("audio was asked for").iter().map(|sample| sample * sample).sum()
}

/// A bank with one audible clip.
fn one_voice() -> Bank {
    let clip = |name: &str, level: f32| {
        let sample = |n: usize| if n % 40 < 3 { level } else { -0.03 * level };
        Clip { name: name.to_owned(), samples: (0..16_000).map(sample).collect() }
    };
    Bank::from_clips(vec![clip("ticks", 0.1), clip("nothing", 0.0), clip("silence", 0.0)])
}

/// An episode with only the first sounding target ahead audible.
fn heard_ahead_first() -> Referee {
    let started = |seed| {
        let truth = EpisodeTruth { seed, ..truth(Order::Unordered) };
        let mut referee = play(&Rules::distinct(), truth, &one_voice()).expect("a legal episode");
        let heard = energy(&referee.start()) > 0.0;
        go(&mut referee, &[(TurnLeft, 1), (TurnRight, 1)]);
        (heard, referee)
    };
    let suits = |seed: &u64| {
        let (heard, referee) = started(*seed);
        heard && referee.into_record().1.steps[0].sounding == Some(0)
    };
    started((0..100).find(suits).expect("one in nine suits")).1
}

#[test]
fn found_target_stops_and_rings_out() {
    let mut referee = heard_ahead_first();
    let mut sounding = Vec::new();
    for _ in 0..AHEAD[0].1 {
        sounding.push(energy(&go(&mut referee, &[(MoveForward, 1)]).observation));
    }
    let found = energy(&go(&mut referee, &[(Submit, 1)]).observation);
    let after: Vec<f32> = (0..50).map(|_| energy(&go(&mut referee, &[(TurnLeft, 1)]).observation)).collect();
    let steady = *sounding.last().expect("twelve steps");
    assert!(sounding.iter().all(|&energy| energy > 0.0));
    assert!(found > 0.0 && found < steady, "a fade of 10 ms and what rings: {found} after {steady}");
    assert!(after.windows(2).all(|pair| pair[1] <= pair[0]), "{after:?}");
    assert!(after[8..].iter().all(|&energy| energy == 0.0), "nothing is left: {after:?}");
    let facts = referee.into_record().1;
    assert_eq!(facts.submits[0].completed, Some(0));
    assert!(facts.steps[14..].iter().all(|step| step.sounding != Some(0)));
}

#[test]
fn last_open_target_sounds_without_pause() {
    let mut referee =
        play(&Rules::paper(), truth(Order::Unordered), &Bank::default()).expect("a legal episode");
    go(&mut referee, &AHEAD);
    go(
        &mut referee,
        &[(Submit, 1), (TurnLeft, 6), (MoveForward, 12), (TurnRight, 3), (MoveForward, 12), (Submit, 1)],
    );
    let left: Vec<_> = (0..60).map(|_| energy(&go(&mut referee, &[(TurnLeft, 1)]).observation)).collect();
    let facts = referee.into_record().1;
    assert_eq!(facts.submits.iter().filter(|submit| submit.completed.is_some()).count(), 2);
    let last = facts.steps.last().expect("steps").sounding;
    assert!(last.is_some() && facts.steps[facts.steps.len() - 61..].iter().all(|step| step.sounding == last));
    assert!(left.iter().all(|&energy| energy > 0.0));
}

/// All audio on a walk.
fn walk(rules: &Rules, truth: EpisodeTruth) -> Vec<f32> {
    let mut referee = play(rules, truth, &Bank::default()).expect("a legal episode");
    let mut heard = referee.start().audio.expect("audio was asked for");
    for action in [MoveForward, TurnLeft, MoveForward, Submit, TurnRight].repeat(12) {
        match referee.step(action) {
            Ok(outcome) => heard.extend(outcome.observation.audio.expect("audio was asked for")),
            Err(_) => break,
        }
    }
    heard
}

#[test]
fn audio_is_independent_of_target_identity() {
    let renamed = || {
        let mut truth = truth(Order::Unordered);
        for (target, category) in truth.targets.iter_mut().zip(["tv_monitor", "cushion", "sofa"]) {
            (target.category, target.modality) = (category.to_owned(), Modality::Image);
            target.start_distance_m *= 2.0;
        }
        truth
    };
    for rules in [Rules::paper(), Rules::distinct()] {
        assert!(walk(&rules, truth(Order::Unordered)) == walk(&rules, renamed()), "{}", rules.name);
    }
    let leaky = Rules { sound_clip: SoundClip::ByCategory, ..Rules::paper() };
    assert!(walk(&leaky, truth(Order::Unordered)) != walk(&leaky, renamed()), "this test sees a leak");
}

#[test]
fn observation_has_no_field_for_the_sounding_target() {
    let mut referee =
        play(&Rules::paper(), truth(Order::Unordered), &Bank::default()).expect("a legal episode");
    // A new field does not compile here: a test must show that it hides schedule and clips.
    let Observation { step, rgb, depth, audio, pose: _, remaining_steps, remaining_submits, feedback: _ } =
        referee.start();
    assert_eq!((step, rgb, depth, audio.map(|audio| audio.len())), (0, None, None, Some(8000)));
    assert_eq!((remaining_steps, remaining_submits), (1000, 2));
}

#[test]
fn every_pool_plays_and_small_banks_are_refused() {
    for sounds in [Sounds::All, Sounds::Train, Sounds::Validation, Sounds::Test] {
        let bank = made_bank(&sounds).expect("made by rule");
        let mut referee = play(&Rules::distinct(), truth(Order::Ordered), &bank).expect("a legal episode");
        assert!(energy(&referee.start()) > 0.0);
    }
    assert!(made_bank(&Sounds::Own(String::new())).is_none());
    let two = Bank::from_clips(Bank::default().clips().take(2).collect());
    assert!(play(&Rules::paper(), truth(Order::Ordered), &two).is_ok());
    let refused =
        play(&Rules::distinct(), truth(Order::Ordered), &two).err().expect("three targets, two clips");
    assert!(refused.to_string().contains("need 3 clips per episode, the bank has 2"), "{refused}");
    assert!(play(&Rules::paper(), truth(Order::Ordered), &Bank::from_clips(Vec::new())).is_err());
}

#[test]
fn cues_are_not_heard() {
    let told = |goals: Vec<GoalCue>| {
        let mission = avln_episode::Mission { order: Order::Ordered, goals };
        let played = try_play(mission, truth(Order::Ordered), Rules::paper(), listening());
        played.expect("legal").start().audio
    };
    let (short, long) = (GoalCue::Category("box".to_owned()), GoalCue::Description("the red box".to_owned()));
    assert_eq!(told(vec![short; 3]), told(vec![long; 3]));
}
