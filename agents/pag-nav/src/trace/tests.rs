//! Tests of traces and of their summaries.

use crate::agent::PagNav;
use crate::preset::{Ablation, Preset};
use crate::trace::lines::{MapGrid, runs};
use crate::trace::{Recorder, TraceSummary, summarise};
use crate::weights::Weights;
use avln_client::{
    Action, Agent, Audio, DepthImage, GoalCue, Image, Mission, Observation, Order, Pose, TaskSpec,
};
use avln_kit::geometry::{FloorPoint, PinholeCamera, Pose2d};
use avln_kit::map::{Occupancy, expected_level};
use avln_kit::perception::{HintRecognition, Hints, TargetHint};
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;
use std::sync::Arc;
use std::{fs, io};

const SIDE: u32 = 64;
const STEPS: u32 = 30;

/// A host with hints about one sounding target, 1.1 m ahead.
struct OneTarget;

impl Hints for OneTarget {
    fn source(&self) -> Option<FloorPoint> {
        Some(FloorPoint::new(0.0, -1.1))
    }

    fn targets(&self) -> Vec<TargetHint> {
        vec![TargetHint { goal: 0, min_m: [-0.3, 0.0, -1.5], max_m: [0.3, 0.8, -1.0] }]
    }
}

fn agent() -> PagNav {
    let hints = Arc::new(OneTarget);
    // The body does not move: one position is one look.
    let weights = Weights { verify_looks: 1, ..Preset::PagNavPlus.weights() };
    PagNav::new(weights).hinted(hints.clone()).seeing(HintRecognition::new(hints))
}

fn task() -> TaskSpec {
    TaskSpec { width: SIDE, height: SIDE, ..TaskSpec::default() }
}

fn mission() -> Mission {
    let goals = vec![
        GoalCue::Category("bed".into()),
        GoalCue::Image(Image { width: 2, height: 1, pixels: vec![9; 6] }),
    ];
    Mission { order: Order::Unordered, goals }
}

/// Observation at rest, 3 m before a wall; the source falls silent after the first Submit.
fn observation(step: u32, is_silent: bool) -> Observation {
    let depth_m = |row: u32| match (row as f32 + 0.5 - 32.0) / 32.0 {
        down if down > 0.0 => (1.0 / down).min(3.02),
        _ => 3.02,
    };
    let metres = (0..SIDE * SIDE).map(|pixel| depth_m(pixel / SIDE)).collect();
    let loud = if is_silent { 0.0 } else { 12_f32.sqrt() * expected_level(1.1) };
    let noise = |sample: u32| loud * ((sample.wrapping_mul(2_654_435_761) >> 16) as f32 / 65_536.0 - 0.5);
    let ear: Vec<f32> = (0..4000).map(noise).collect();
    Observation {
        step,
        rgb: Some(Image { width: SIDE, height: SIDE, pixels: vec![90; 3 * (SIDE * SIDE) as usize] }),
        depth: Some(DepthImage { width: SIDE, height: SIDE, metres }),
        audio: Some(Audio { sample_rate_hz: 16_000, left: ear.clone(), right: ear }),
        pose: Pose::default(),
        remaining_steps: 1000 - step,
        remaining_submits: 8,
        ..Observation::default()
    }
}

fn play(agent: &mut PagNav, episode: &str) -> Vec<Action> {
    agent.enter(episode);
    agent.begin(&task(), &mission());
    let mut actions = Vec::new();
    for step in 0..STEPS {
        let is_silent = actions.contains(&Action::Submit);
        actions.push(agent.act(&observation(step, is_silent)));
    }
    actions
}

fn lines(file: &Path) -> Vec<Value> {
    let text = fs::read_to_string(file).expect("a trace");
    text.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect()
}

fn of_kind<'a>(lines: &'a [Value], kind: &str) -> Vec<&'a Value> {
    lines.iter().filter(|line| line["kind"] == kind).collect()
}

#[test]
fn traces_can_be_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("new/traces");
    let mut traced = agent().traced(Recorder::new(&place).unwrap());
    let actions = play(&mut traced, "ep_1");
    play(&mut traced, "ep_2");
    traced.end_trace().unwrap();

    let all = lines(&place.join("ep_1.jsonl"));
    let first = &all[0];
    assert_eq!(
        (&first["kind"], &first["format"], &first["episode"]),
        (&"mission".into(), &2.into(), &"ep_1".into())
    );
    assert_eq!(
        (&first["agent"], &first["version"]),
        (&"avln-pag-nav".into(), &env!("CARGO_PKG_VERSION").into())
    );
    assert_eq!(first["goals"], json!([{"category": "bed"}, {"image": {"width": 2, "height": 1}}]));
    assert_eq!((&first["order"], &first["weights"]["verify_looks"]), (&"unordered".into(), &1.into()));
    assert_eq!(first["ablation"]["no_gate"], false);

    let steps = of_kind(&all, "step");
    let written: Vec<String> = steps.iter().map(|step| step["action"].as_str().unwrap().to_owned()).collect();
    assert_eq!(written, actions.iter().map(Action::to_string).collect::<Vec<_>>());
    let submit = steps[actions.iter().position(|action| *action == Action::Submit).expect("a Submit")];
    let verification = &submit["gate"]["verification"];
    assert_eq!((&submit["stage"], &verification["vis"]), (&"verify".into(), &1.0.into()));
    assert_eq!((&verification["looks"], verification["floor"].as_f64()), (&1.into(), Some(0.25)));
    assert_eq!((&submit["candidate"]["goal"], &submit["candidate"]["vis"]), (&0.into(), &1.0.into()));
    assert_eq!((&submit["heard"]["source"], &submit["sources"][0]["certainty"]), (&0.into(), &1.0.into()));
    assert_eq!(of_kind(&lines(&place.join("ep_2.jsonl")), "step").len(), STEPS as usize);
}

#[test]
fn events_describe_changes() {
    let folder = tempfile::tempdir().unwrap();
    let mut traced = agent().traced(Recorder::new(folder.path()).unwrap());
    let actions = play(&mut traced, "e");
    traced.end_trace().unwrap();
    let submitted = actions.iter().position(|action| *action == Action::Submit).unwrap();
    let all = lines(&folder.path().join("e.jsonl"));
    let events = of_kind(&all, "event");
    let step = |name: &str| {
        let found = events.iter().find(|event| event["event"] == name);
        found.unwrap_or_else(|| panic!("{name} in {events:?}"))["step"].as_u64().unwrap() as usize
    };
    assert_eq!((step("located"), step("focus"), step("stage")), (0, 0, 0));
    assert_eq!((step("claimed"), step("found"), step("silenced")), (submitted, submitted + 2, submitted + 2));
    let stages: Vec<&Value> = events.iter().filter_map(|event| event.get("stage")).collect();
    assert_eq!(stages[..2], ["verify", "search"], "{events:?}");
    assert!(events.iter().all(|event| event["event"] != "missed"), "{events:?}");
}

#[test]
fn maps_appear_every_25_steps_and_last() {
    let folder = tempfile::tempdir().unwrap();
    let mut traced = agent().traced(Recorder::new(folder.path()).unwrap());
    play(&mut traced, "e");
    traced.end_trace().unwrap();
    let all = lines(&folder.path().join("e.jsonl"));
    let maps = of_kind(&all, "map");
    assert_eq!(
        maps.iter().map(|map| map["step"].as_u64()).collect::<Vec<_>>(),
        [Some(0), Some(25), Some(29)]
    );
    assert_eq!(all.last(), maps.last().copied());
    let object = &maps[1]["objects"][0];
    assert_eq!((&object["vis"], &object["object"]), (&json!([1.0, 0.0]), &0.into()));
    assert_eq!(object["max_m"][1].as_f64().map(|y| y as f32), Some(0.8));
}

#[test]
fn search_steps_have_a_frontier() {
    let folder = tempfile::tempdir().unwrap();
    let deaf = PagNav::preset(Preset::PagNavPlus).without(Ablation { no_audio: true, ..Ablation::default() });
    let mut traced = deaf.traced(Recorder::new(folder.path()).unwrap());
    play(&mut traced, "e");
    traced.end_trace().unwrap();
    let all = lines(&folder.path().join("e.jsonl"));
    let steps = of_kind(&all, "step");
    let by_frontier = |step: &&Value| step["stage"] == "search" && step["frontier"]["score"].is_number();
    assert!(steps.iter().copied().any(|step| by_frontier(&step)), "{steps:?}");
    assert!(steps.iter().all(|step| step["heard"].is_null()));
}

#[test]
fn cells_are_run_length_encoded() {
    assert_eq!(runs("uuufwwu".chars()), "3u1f2w1u");
    let mut map = Occupancy::default();
    let depth = observation(0, true).depth.unwrap();
    map.see(&PinholeCamera::new(&task()), &Pose2d::new(&Pose::default()), &depth);
    let plan = MapGrid::of(&map);
    let count = |wanted: Option<char>| {
        let mut sum = 0;
        let mut number = 0;
        for letter in plan.cells.chars() {
            match letter.to_digit(10) {
                Some(digit) => number = 10 * number + digit,
                None => {
                    sum += if wanted.is_none_or(|wanted| wanted == letter) { number } else { 0 };
                    number = 0;
                }
            }
        }
        sum
    };
    assert_eq!(count(None), plan.columns * plan.rows);
    assert!(count(Some('f')) > 1000 && count(Some('w')) > 50 && count(Some('u')) > 100, "{}", plan.cells);
}

/// A disk with room for `left` bytes.
struct FullDisk {
    left: usize,
}

impl Write for FullDisk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.left = self.left.checked_sub(bytes.len()).ok_or(io::ErrorKind::StorageFull)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn tracing_does_not_change_actions() {
    let plain = play(&mut agent(), "e");
    let folder = tempfile::tempdir().unwrap();
    let mut traced = agent().traced(Recorder::new(folder.path()).unwrap());
    assert_eq!(play(&mut traced, "e"), plain);
    assert_eq!(traced.end_trace().map_err(|error| error.to_string()), Ok(()));

    let gone = tempfile::tempdir().unwrap();
    let mut traced = agent().traced(Recorder::new(gone.path()).unwrap());
    let path = gone.path().to_owned();
    gone.close().unwrap();
    assert_eq!(play(&mut traced, "e"), plain);
    let error = traced.end_trace().unwrap_err().to_string();
    assert!(error.contains(&path.join("e.jsonl").display().to_string()), "{error}");
}

#[test]
fn full_disks_end_only_the_trace() {
    let folder = tempfile::tempdir().unwrap();
    let mut recorder = Recorder::new(folder.path()).unwrap();
    recorder.write_to("e", "e.jsonl".into(), Box::new(FullDisk { left: 4000 }));
    let mut traced = agent().traced(recorder);
    traced.begin(&task(), &mission());
    let mut plain = agent();
    plain.begin(&task(), &mission());
    for step in 0..STEPS {
        let seen = observation(step, false);
        assert_eq!(traced.act(&seen), plain.act(&seen), "step {step}");
    }
    let error = traced.end_trace().unwrap_err().to_string();
    assert!(error.starts_with("trace e.jsonl is incomplete: "), "{error}");
}

#[test]
fn parallel_recorders_share_a_folder() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("traces");
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| (0..200).for_each(|_| drop(Recorder::new(&place).unwrap())));
        }
    });
    assert_eq!(std::fs::read_dir(&place).unwrap().count(), 0);
}

#[test]
fn unwritable_folders_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    fs::write(&file, "in the path").unwrap();
    let error = Recorder::new(file.join("traces")).err().expect("a refusal").to_string();
    assert!(error.contains("file/traces") && error.contains("--trace"), "{error}");
    assert!(fs::read_dir(folder.path()).unwrap().count() == 1);
}

#[test]
fn hostile_handles_name_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("traces");
    for handle in ["../up", "..", "", "a/b", "a\\b", "/root", ".hidden", "line\nbreak", &"a".repeat(129)] {
        let mut traced = agent().traced(Recorder::new(&place).unwrap());
        traced.enter(handle);
        traced.begin(&task(), &mission());
        traced.act(&observation(0, false));
        let error = traced.end_trace().expect_err(handle).to_string();
        assert!(error.contains(&format!("{handle:?}")), "{error}");
    }
    assert_eq!(fs::read_dir(&place).unwrap().count(), 0);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn claims_are_counted_by_support() {
    let folder = tempfile::tempdir().unwrap();
    let claim = |action: &str, vis: Option<f64>, source: Option<usize>, floor: Option<f64>| {
        let verification = floor.map(|floor| json!({"floor": floor}));
        let gate = json!({"fresh_vis": vis, "verification": verification});
        json!({"kind": "step", "action": action, "candidate": {"source": source}, "gate": gate}).to_string()
    };
    let weights = json!({"verify_floor": 0.25, "verify_unheard": 0.5});
    let text = [
        json!({"kind": "mission", "weights": weights}).to_string(),
        claim("Submit", Some(0.3), Some(0), Some(0.25)),
        claim("MoveForward", None, None, None),
        // Below the floor of the verification, which is not the least one.
        claim("Submit", Some(0.4), Some(0), Some(0.5)),
        // Ungated, without and with a source.
        claim("Submit", Some(0.3), None, None),
        claim("Submit", Some(0.3), Some(0), None),
        claim("Submit", Some(0.2), Some(0), None),
        claim("Stop", None, None, None),
    ]
    .join("\n");
    fs::create_dir(folder.path().join("inner")).unwrap();
    fs::write(folder.path().join("inner/e.jsonl"), text).unwrap();
    fs::write(folder.path().join("notes.txt"), "no trace").unwrap();
    let expected = TraceSummary { episodes: 1, submits: 5, stops: 1, unverified: 1, below_floor: 3 };
    let summary = summarise(folder.path()).unwrap();
    assert_eq!(summary, expected);
    assert!(summary.to_string().ends_with("below the floor: 3"));
}

#[test]
fn broken_traces_are_named() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("e.jsonl"), "{}\n{").unwrap();
    let error = summarise(folder.path()).unwrap_err().to_string();
    assert!(error.contains("e.jsonl: line 2"), "{error}");
    assert!(summarise(&folder.path().join("absent")).is_err());
}
