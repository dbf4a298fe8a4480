//! Property tests: no claim without fresh visual support, whatever the agent believes.

use crate::agent::PagNav;
use crate::preset::{Ablation, Preset};
use avln_client::{
    Action, Agent, Audio, DepthImage, Feedback, FeedbackRule, GoalCue, Image, MethodType, Mission,
    Observation, Order, Pose, SilenceRule, TaskSpec,
};
use avln_kit::geometry::{FloorPoint, PinholeCamera, Pose2d};
use avln_kit::hearing::HeardSound;
use avln_kit::map::SourceEstimate;
use avln_kit::perception::{DetectedObject, Recognition, WallTest};
use std::f32::consts::{FRAC_PI_2, TAU};
use std::ops::Range;
use std::sync::{Arc, Mutex};
use std::thread;

const SIDE: u32 = 64;
const OBJECTS: usize = 6;

/// A seeded generator.
struct Dice(u64);

impl Dice {
    fn share(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1_u64 << 24) as f32
    }

    fn below(&mut self, count: usize) -> usize {
        (self.share() * count as f32) as usize
    }

    fn is(&mut self, probability: f32) -> bool {
        self.share() < probability
    }

    fn place(&mut self) -> FloorPoint {
        FloorPoint::new(5.0 * self.share() - 2.5, 5.0 * self.share() - 2.5)
    }

    fn pose_facing(&mut self, place: FloorPoint) -> Pose {
        let (from, range_m) = (TAU * self.share(), 0.5 + 1.5 * self.share());
        let position = [place.x + range_m * libm::sinf(from), 0.0, place.z + range_m * libm::cosf(from)];
        Pose::new(position, from + 1.4 * (self.share() - 0.5))
    }

    /// An object with random fits, as probabilities of kinds named by goal.
    fn detection(&mut self, place: FloorPoint, goals: usize) -> DetectedObject {
        let mut fit = || if self.is(0.3) { 0.3 * self.share() } else { self.share() };
        let kinds = (0..goals).map(|goal| (goal.to_string(), fit())).collect();
        DetectedObject {
            min: FloorPoint::new(place.x - 0.2, place.z - 0.2),
            max: FloorPoint::new(place.x + 0.2, place.z + 0.2),
            high_m: 0.8,
            embedding: vec![1.0],
            kinds,
            views: 1,
            ..DetectedObject::default()
        }
    }
}

fn fit(detection: &DetectedObject, goal: usize) -> f32 {
    detection.kinds.get(goal).map_or(0.0, |(_, fit)| *fit)
}

fn task(dice: &mut Dice) -> TaskSpec {
    let feedback = [FeedbackRule::None, FeedbackRule::Accepted, FeedbackRule::Verdict][dice.below(3)];
    let silence = [SilenceRule::Immediate, SilenceRule::Delayed, SilenceRule::WindowEnd][dice.below(3)];
    TaskSpec { width: SIDE, height: SIDE, feedback, silence, ..TaskSpec::default() }
}

fn mission(dice: &mut Dice) -> Mission {
    let order = if dice.is(0.5) { Order::Ordered } else { Order::Unordered };
    let goals = ["bed", "sofa", "plant", "chair"].map(|label| GoalCue::Category(label.to_owned()));
    Mission { order, goals: goals[..2 + dice.below(3)].to_vec() }
}

/// Any ablation but `no_gate`.
fn ablation(dice: &mut Dice) -> Ablation {
    let mut rare = || dice.is(0.15);
    Ablation {
        no_audio: rare(),
        no_search_sound: rare(),
        no_outcomes: rare(),
        no_object_memory: rare(),
        no_second_look: rare(),
        no_acoustic_memory: rare(),
        no_map: rare(),
        no_priors: rare(),
        no_gate: false,
    }
}

/// A depth image 3 m before a wall.
fn depth() -> DepthImage {
    let depth_m = |row: u32| match (row as f32 + 0.5 - 32.0) / 32.0 {
        down if down > 0.0 => (1.0 / down).min(3.02),
        _ => 3.02,
    };
    let metres = (0..SIDE * SIDE).map(|pixel| depth_m(pixel / SIDE)).collect();
    DepthImage { width: SIDE, height: SIDE, metres }
}

/// Fills the memories of an agent with random objects, sounds and efforts.
fn believe(agent: &mut PagNav, dice: &mut Dice, places: &[FloorPoint]) {
    let goals = agent.mission.goals();
    for place in places {
        for _ in 0..2 + dice.below(4) {
            let pose = Pose2d::new(&dice.pose_facing(*place));
            agent.here.objects.recognise(&pose, vec![dice.detection(*place, goals)], fit);
        }
        let object = dice.below(OBJECTS);
        if dice.is(0.1) {
            agent.here.objects.refute(object);
        }
        agent.here.sought.insert((object, dice.below(goals)), dice.below(100) as u32);
        agent.here.waited.insert((object, dice.below(goals)), dice.below(200) as u32);
        let heard = HeardSound { itd_s: 1e-3 * (dice.share() - 0.5), level: 0.3 * dice.share() };
        let pose = Pose2d::new(&dice.pose_facing(*place));
        agent.here.intensity.hear(pose.place, heard.level);
        agent.here.bearings[dice.below(goals)].hear(&pose, &heard, dice.below(500) as u32);
    }
    for index in 0..agent.here.sources.len() {
        let place = places[dice.below(places.len())];
        let source = &mut agent.here.sources[index];
        source.estimate = dice.is(0.7).then(|| SourceEstimate { place, certainty: dice.share() });
        source.intensity.hear(place, 0.3 * dice.share());
        source.looks = dice.below(6) as u32;
        source.sought_steps = dice.below(300) as u32;
    }
    agent.levels = (0..dice.below(8)).map(|_| 0.3 * dice.share()).collect();
    for _ in 0..dice.below(60) {
        let _ = agent.schedule.advance();
    }
    agent.remaining_steps = dice.below(1000) as u32;
    agent.mission.remaining_submits = dice.below(4) as u32;
    agent.searched_steps = dice.below(400) as u32;
    (1..goals).for_each(|goal| {
        if dice.is(0.3) {
            agent.mission.complete(goal)
        }
    });
}

fn agent(dice: &mut Dice) -> (Preset, PagNav) {
    let preset = Preset::ALL[dice.below(2)];
    let mut agent = PagNav::with(preset.weights(), Box::<Scripted>::default()).without(ablation(dice));
    agent.begin(&task(dice), &mission(dice));
    for quarter in 0..4 {
        let pose = Pose2d::new(&Pose::new([0.0; 3], quarter as f32 * FRAC_PI_2));
        agent.here.map.see(&PinholeCamera::new(&task(dice)), &pose, &depth());
    }
    (preset, agent)
}

/// Decisions in random beliefs.
#[derive(Clone, Copy, Debug, Default)]
struct Decisions {
    submits: u32,
    stops: u32,
    /// Submits and Stops by preset, in the order of [`Preset::ALL`].
    claims: [u32; 2],
    /// No claim, and no visual support above the floor.
    refusals: u32,
}

impl Decisions {
    /// Decides in the belief of this seed, and checks the claim.
    fn count(&mut self, seed: u64) {
        let mut dice = Dice(seed);
        let (preset, mut agent) = agent(&mut dice);
        let places: Vec<FloorPoint> = (0..OBJECTS).map(|_| dice.place()).collect();
        believe(&mut agent, &mut dice, &places);
        let goals = agent.mission.goals();
        let pose = Pose2d::new(&dice.pose_facing(places[0]));
        let seen: Vec<DetectedObject> =
            if dice.is(0.3) { Vec::new() } else { vec![dice.detection(places[0], goals)] };
        let best = seen.iter().flat_map(|seen| (0..goals).map(|goal| fit(seen, goal))).fold(0.0, f32::max);
        agent.fresh = agent.here.objects.recognise(&pose, seen, fit);
        let (is_last, active): (bool, Vec<usize>) =
            (agent.mission.is_last_claim(), agent.mission.active().collect());
        let action = agent.decide(&pose);
        if !matches!(action, Action::Submit | Action::Stop) {
            self.refusals += u32::from(best < agent.weights.verify_floor);
            return;
        }
        let candidate = agent.decision.candidate.expect("a candidate");
        let look = agent.fresh.iter().filter(|look| look.object() == candidate.object);
        let vis = look.map(|look| look.vis(candidate.goal)).fold(0.0, f32::max);
        let floor = agent.weights.least_vis(agent.is_supported(&candidate));
        assert!(vis >= floor && best >= floor, "seed {seed}: {action} with s_vis {vis}");
        assert!(active.contains(&candidate.goal), "seed {seed}: goal {}", candidate.goal);
        assert!(pose.bearing_rad(candidate.place).abs() <= agent.weights.submit_rad);
        assert!(candidate.place.distance_m(pose.place) <= agent.weights.submit_m);
        assert_eq!(action == Action::Stop, is_last, "seed {seed}");
        *(if is_last { &mut self.stops } else { &mut self.submits }) += 1;
        self.claims[preset as usize] += 1;
    }
}

#[test]
fn claims_follow_a_fresh_look_above_the_floor() {
    let count = |seeds: Range<u64>| {
        let mut decisions = Decisions::default();
        seeds.for_each(|seed| decisions.count(seed));
        decisions
    };
    let [first, second] = thread::scope(|scope| {
        [0..500, 500..1000]
            .map(|seeds| scope.spawn(move || count(seeds)))
            .map(|half| half.join().expect("every claim is allowed"))
    });
    // Otherwise the test would prove nothing.
    assert!(first.submits + second.submits > 10, "{first:?} {second:?}");
    assert!(first.stops + second.stops > 5, "{first:?} {second:?}");
    assert!(first.refusals + second.refusals > 50, "{first:?} {second:?}");
    let claims = first.claims.iter().zip(second.claims).map(|(first, second)| first + second);
    assert!(claims.min() > Some(0), "{first:?} {second:?}");
}

/// A recognition with scripted detections; it skips frames, unless refreshed.
#[derive(Default)]
struct Scripted {
    script: Arc<Mutex<Script>>,
}

#[derive(Default)]
struct Script {
    next: Vec<DetectedObject>,
    is_refreshed: bool,
    skips: bool,
    /// Best fit in the last frame; 0 if it was skipped.
    best: f32,
}

impl Recognition for Scripted {
    fn begin(&mut self, _: &TaskSpec, _: &Mission) {}

    fn see(&mut self, _: &Pose2d, _: &Observation, _: WallTest) -> Option<Vec<DetectedObject>> {
        let mut script = self.script.lock().unwrap();
        let seen = std::mem::take(&mut script.next);
        let is_skipped = script.skips && !std::mem::take(&mut script.is_refreshed);
        let fits = seen.iter().flat_map(|seen| (0..4).map(|goal| fit(seen, goal)));
        script.best = if is_skipped { 0.0 } else { fits.fold(0.0, f32::max) };
        (!is_skipped).then_some(seen)
    }

    fn fit(&self, detection: &DetectedObject, goal: usize) -> f32 {
        fit(detection, goal)
    }

    fn refresh(&mut self) {
        self.script.lock().unwrap().is_refreshed = true;
    }

    fn method_type(&self) -> MethodType {
        MethodType::TrainingFree
    }
}

fn observation(dice: &mut Dice, step: u32, pose: Pose, submits: u32) -> Observation {
    let gain = 0.4 * dice.share() * dice.share();
    let ear: Vec<f32> = (0..4000).map(|_| gain * (dice.share() - 0.5)).collect();
    let late = dice.below(8);
    let right = ear.iter().cycle().skip(late).take(4000).copied().collect();
    Observation {
        step,
        rgb: Some(Image { width: SIDE, height: SIDE, pixels: vec![90; 3 * (SIDE * SIDE) as usize] }),
        depth: Some(depth()),
        audio: dice.is(0.9).then_some(Audio { sample_rate_hz: 16_000, left: ear, right }),
        pose,
        remaining_steps: 300 - step,
        remaining_submits: submits,
        feedback: [Feedback::None, Feedback::Accepted, Feedback::Verdict(dice.is(0.5))][dice.below(3)],
    }
}

#[test]
fn played_episodes_claim_only_what_the_frame_shows() {
    let (mut claims, mut submits_of_all) = (0, Vec::new());
    for seed in 0..12 {
        let mut dice = Dice(1000 + seed);
        let script: Arc<Mutex<Script>> = Arc::default();
        let preset = Preset::ALL[(seed % 2) as usize];
        let agent = PagNav::with(preset.weights(), Box::new(Scripted { script: script.clone() }));
        let mut agent = agent.without(ablation(&mut dice));
        let mission = mission(&mut dice);
        let goals = mission.goals.len();
        agent.begin(&task(&mut dice), &mission);
        let places = [dice.place(), dice.place(), dice.place()];
        let mut submits = 0;
        for step in 0..120 {
            let place = places[dice.below(3)];
            let pose = dice.pose_facing(place);
            {
                let mut script = script.lock().unwrap();
                script.next = if dice.is(0.8) { vec![dice.detection(place, goals)] } else { Vec::new() };
                script.skips = dice.is(0.3);
            }
            let left = (goals - 1).saturating_sub(submits) as u32;
            let action = agent.act(&observation(&mut dice, step, pose, left));
            if matches!(action, Action::Submit | Action::Stop) {
                claims += 1;
                let best = script.lock().unwrap().best;
                let candidate = agent.decision.candidate.expect("a candidate");
                let floor = agent.weights.least_vis(agent.is_supported(&candidate));
                assert!(best >= floor, "seed {seed}, step {step}: {action} with s_vis {best}");
            }
            submits += usize::from(action == Action::Submit);
            assert!(submits < goals, "seed {seed}: an N-th Submit");
            if action == Action::Stop {
                break;
            }
        }
        submits_of_all.push(submits);
    }
    assert!(claims > 5, "{claims} {submits_of_all:?}");
}

/// Actions for an agent at rest that hears noise or silence, and whether it remembers a bearing.
fn acts(mut agent: PagNav, hears: bool) -> (Vec<Action>, bool) {
    let mut dice = Dice(5);
    let ear: Vec<f32> = (0..4000).map(|_| dice.share() - 0.5).collect();
    let audio = Audio { sample_rate_hz: 16_000, right: ear.clone(), left: ear };
    let goals = vec![GoalCue::Category("bed".to_owned()); 2];
    let task = TaskSpec { width: SIDE, height: SIDE, ..TaskSpec::default() };
    agent.begin(&task, &Mission { goals, ..Mission::default() });
    let seen = |step| Observation {
        step,
        remaining_steps: 19 - step,
        remaining_submits: 1,
        audio: hears.then(|| audio.clone()),
        depth: Some(depth()),
        ..Observation::default()
    };
    let actions = (0..20).map(|step| agent.act(&seen(step))).collect();
    (actions, agent.here.bearings.iter().any(|memory| !memory.is_empty()))
}

#[test]
fn without_audio_sound_has_no_effect() {
    for preset in Preset::ALL {
        let agent = |no_audio| PagNav::preset(preset).without(Ablation { no_audio, ..Ablation::default() });
        assert_eq!(acts(agent(true), true), acts(agent(true), false), "{preset:?}");
        assert!(acts(agent(false), true).1 && !acts(agent(true), true).1, "{preset:?}");
    }
}

#[test]
fn last_steps_without_a_candidate_claim_nothing() {
    for preset in Preset::ALL {
        let (actions, _) = acts(PagNav::preset(preset), true);
        assert!(actions.iter().all(|action| !matches!(action, Action::Submit | Action::Stop)), "{preset:?}");
    }
}
