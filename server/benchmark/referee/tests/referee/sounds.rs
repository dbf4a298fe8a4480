//! Sound content and schedule: no leak beyond target directions.

use crate::{AHEAD, ASSETS, go, mission, truth};
use avln_episode::{
    Action::{MoveForward, Submit, TurnLeft, TurnRight},
    GoalCue, Modality, Observation, Order, Rules, Sensors, SoundClip, Sounds,
};
use avln_referee::{Audio, Bank, Referee, RefereeError, made_bank};
use avln_truth::EpisodeTruth;
use avln_world::Clip;

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
fn every_pool_can_be_played_and_a_bank_that_is_too_small_is_refused() {
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
        let truth = truth(Order::Ordered);
        let mut referee =
            Referee::new(ASSETS.clone(), mission, truth, Rules::paper(), listening(), &Audio::default())
                .expect("legal");
        referee.start().audio
    };
    let (short, long) = (GoalCue::Category("box".to_owned()), GoalCue::Description("the red box".to_owned()));
    assert_eq!(told(vec![short; 3]), told(vec![long; 3]));
}
