//! Frames of a test server without scenes.

use crate::trials::{OpenEpisode, STEPS, TRIALS, TrialRun};
use avln_proto::{API_MINOR, v1};

const IMAGE_SIDES: std::ops::RangeInclusive<u32> = 64..=512;
/// Samples per ear and step.
const SAMPLES: u32 = 4000;

pub(crate) const RUN: &str = "run_conformance";

pub(crate) fn progress(run: &TrialRun) -> v1::RunProgress {
    let in_flight = u32::from(run.open.is_some());
    v1::RunProgress { total: TRIALS.len() as u32, done: run.ended_episodes(), in_flight, eta_s: None }
}

pub(crate) fn welcome(run: &TrialRun) -> v1::Welcome {
    let (width, height) = size(&run.sensors);
    let position =
        |open: &OpenEpisode| v1::SlotPosition { slot: 0, episode: open.handle.clone(), step: open.step() };
    let specs = kinds(&run.sensors).into_iter().map(|kind| spec(kind, width, height)).collect();
    v1::Welcome {
        run: RUN.to_owned(),
        api_minor: API_MINOR,
        slots: 1,
        task: Some(task(width, height, run.sensors.hfov_rad)),
        tensors: specs,
        max_message_bytes: 4 << 20,
        time: Some(v1::TimeLimits { disconnect_s: 60, disconnect_total_s: 600, ..v1::TimeLimits::default() }),
        progress: Some(progress(run)),
        resumed: run.open.iter().filter(|open| open.over.is_none()).map(position).collect(),
        benchmark: "0.0.0".to_owned(),
        server_version: env!("CARGO_PKG_VERSION").to_owned(),
        ..v1::Welcome::default()
    }
}

fn size(sensors: &v1::SensorSubscription) -> (u32, u32) {
    let side = |side: u32| side.clamp(*IMAGE_SIDES.start(), *IMAGE_SIDES.end());
    (side(sensors.width), side(sensors.height))
}

fn kinds(sensors: &v1::SensorSubscription) -> Vec<v1::SensorKind> {
    let known = [v1::SensorKind::Rgb, v1::SensorKind::Depth, v1::SensorKind::Audio];
    known.into_iter().filter(|kind| sensors.wishes.iter().any(|wish| wish.kind() == *kind)).collect()
}

fn task(width: u32, height: u32, hfov_rad: f32) -> v1::TaskSpec {
    v1::TaskSpec {
        rules: "conformance-v1".to_owned(),
        forward_m: 0.25,
        turn_deg: 30,
        step_s: 0.25,
        max_steps: STEPS,
        width,
        height,
        hfov_rad,
        depth_max_m: 10.0,
        depth_divisor: 1.0,
        sample_rate_hz: 16_000,
        audio_samples: SAMPLES,
        samples_per_step: SAMPLES,
        success_radius_m: 2.0,
        pose_frame: v1::PoseFrame::Start.into(),
        ..v1::TaskSpec::default()
    }
}

fn shape(kind: v1::SensorKind, width: u32, height: u32) -> (v1::Dtype, Vec<u32>) {
    match kind {
        v1::SensorKind::Rgb => (v1::Dtype::U8, vec![height, width, 3]),
        v1::SensorKind::Audio => (v1::Dtype::F32, vec![2, SAMPLES]),
        v1::SensorKind::Depth | v1::SensorKind::Unspecified => (v1::Dtype::F32, vec![height, width]),
    }
}

fn spec(kind: v1::SensorKind, width: u32, height: u32) -> v1::TensorSpec {
    let (dtype, shape) = shape(kind, width, height);
    v1::TensorSpec {
        id: kind as u32,
        name: kind.as_str_name().to_owned(),
        kind: kind.into(),
        dtype: dtype.into(),
        shape,
        encoding: v1::Encoding::Raw.into(),
        minimum: 0.0,
        maximum: 255.0,
    }
}

// A grey image, no depth hit and silence suffice, because the trials depend on no observation content.
fn tensor(kind: v1::SensorKind, (width, height): (u32, u32)) -> v1::Tensor {
    let (dtype, shape) = shape(kind, width, height);
    let bytes = shape.iter().product::<u32>() as usize * if dtype == v1::Dtype::U8 { 1 } else { 4 };
    v1::Tensor {
        id: kind as u32,
        dtype: dtype.into(),
        shape,
        encoding: v1::Encoding::Raw.into(),
        data: vec![if kind == v1::SensorKind::Rgb { 128 } else { 0 }; bytes].into(),
    }
}

pub(crate) fn start(run: &TrialRun, open: &OpenEpisode) -> v1::EpisodeStart {
    let goal = |category: &str| v1::Goal { cue: Some(v1::goal::Cue::Category(category.to_owned())) };
    v1::EpisodeStart {
        slot: 0,
        episode: open.handle.clone(),
        mission: Some(v1::Mission {
            order: v1::Order::Unordered.into(),
            goals: ["chair", "lamp"].map(goal).to_vec(),
        }),
        observation: Some(observation(run, open)),
        ordinal: open.ordinal,
        progress: Some(progress(run)),
    }
}

pub(crate) fn observation(run: &TrialRun, open: &OpenEpisode) -> v1::Observation {
    let (step, size) = (open.step(), size(&run.sensors));
    v1::Observation {
        slot: 0,
        episode: open.handle.clone(),
        step,
        tensors: kinds(&run.sensors).into_iter().map(|kind| tensor(kind, size)).collect(),
        pose: Some(v1::Pose::default()),
        remaining_steps: STEPS.saturating_sub(step),
        remaining_submits: 2,
        terminated: open.over == Some(v1::EndReason::Stopped),
        truncated: open.over.is_some_and(|reason| reason != v1::EndReason::Stopped),
        reason: open.over.map_or(0, i32::from),
        time: Some(v1::TimeAccount::default()),
        ..v1::Observation::default()
    }
}

pub(crate) fn end(run: &TrialRun, open: &OpenEpisode, reason: v1::EndReason) -> v1::EpisodeEnd {
    v1::EpisodeEnd {
        slot: 0,
        episode: open.handle.clone(),
        step: open.step(),
        reason: reason.into(),
        terminated: reason == v1::EndReason::Stopped,
        metrics: None,
        progress: Some(progress(run)),
    }
}

pub(crate) fn run_end(run: &TrialRun) -> v1::RunEnd {
    v1::RunEnd {
        run: RUN.to_owned(),
        progress: Some(progress(run)),
        complete: !run.has_next(),
        ..v1::RunEnd::default()
    }
}

pub(crate) fn fault(open: Option<&OpenEpisode>, reason: v1::Reason, recoverable: bool) -> v1::Fault {
    v1::Fault {
        slot: Some(0),
        episode: open.map(|open| open.handle.clone()).unwrap_or_default(),
        step: open.map_or(0, OpenEpisode::step),
        code: reason.code() as u32,
        reason: reason.into(),
        message: format!("the conformance kit sends {}", reason.word()),
        recoverable,
        ..v1::Fault::default()
    }
}
