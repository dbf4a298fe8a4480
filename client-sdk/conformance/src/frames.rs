//! Frames and answers of a test server without scenes.

use crate::trials::{MAX_SLOTS, OpenEpisode, STEPS, TrialRun, unix_ms};
use avln_proto::{API_MINOR, REASON_KEY, RETRY_AFTER_KEY, v1};
use tonic::{Status, metadata::MetadataValue};

const IMAGE_SIDES: std::ops::RangeInclusive<u32> = 64..=512;
/// Samples per ear and step.
const SAMPLES: u32 = 4000;

const SENSORS: [v1::SensorKind; 3] = [v1::SensorKind::Rgb, v1::SensorKind::Depth, v1::SensorKind::Audio];

pub(crate) const RUN: &str = "run_conformance";

const RULES: &str = "conformance-v1";
const BENCHMARK: &str = "0.0.0";
const DEPTH_MAX_M: f32 = 10.0;

pub(crate) fn progress(run: &TrialRun) -> v1::RunProgress {
    v1::RunProgress { total: run.total(), done: run.ended, in_flight: run.open.len() as u32, eta_s: None }
}

pub(crate) fn time() -> v1::TimeLimits {
    v1::TimeLimits { disconnect_s: 60, disconnect_total_s: 600, ..v1::TimeLimits::default() }
}

pub(crate) fn server_info() -> v1::GetServerInfoResponse {
    v1::GetServerInfoResponse {
        name: "avln-conformance".to_owned(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        api_minor: API_MINOR,
        benchmark: BENCHMARK.to_owned(),
        encodings: vec![v1::Encoding::Raw.into()],
        max_request_bytes: 65_536,
        server_time_unix_ms: unix_ms(),
        state: v1::ServerState::Up.into(),
        ..v1::GetServerInfoResponse::default()
    }
}

pub(crate) fn phase(run: &TrialRun) -> v1::Phase {
    v1::Phase {
        id: "conformance".to_owned(),
        title: "Conformance of a client".to_owned(),
        orders: vec![v1::Order::Ordered.into(), v1::Order::Unordered.into()],
        episodes: run.total(),
        max_slots: MAX_SLOTS,
        feedback: v1::FeedbackRule::None.into(),
        sensors: SENSORS.map(i32::from).to_vec(),
        encodings: vec![v1::Encoding::Raw.into()],
        state: v1::PhaseState::Open.into(),
        time: Some(time()),
        results: v1::Visibility::Organiser.into(),
        rules: RULES.to_owned(),
        max_side: *IMAGE_SIDES.end(),
        ..v1::Phase::default()
    }
}

pub(crate) fn run_status(run: &TrialRun) -> v1::Run {
    let state = match run.is_over() {
        true if run.is_complete() => v1::RunState::Completed,
        true => v1::RunState::Cancelled,
        false if run.transport.is_none() => v1::RunState::Created,
        false => v1::RunState::Running,
    };
    v1::Run {
        id: RUN.to_owned(),
        phase: run.request.phase.clone(),
        order: run.request.order,
        method: run.request.method.clone(),
        state: state.into(),
        ended_unix_ms: run.ended_unix_ms,
        progress: Some(progress(run)),
        ..v1::Run::default()
    }
}

pub(crate) fn welcome(run: &TrialRun) -> v1::Welcome {
    let (width, height) = size(&run.sensors);
    let position = |open: &OpenEpisode| v1::SlotPosition {
        slot: open.slot,
        episode: open.handle.clone(),
        step: open.step(),
    };
    let specs = kinds(&run.sensors).into_iter().map(|kind| spec(kind, width, height)).collect();
    v1::Welcome {
        run: RUN.to_owned(),
        api_minor: API_MINOR,
        slots: run.slots,
        task: Some(task(width, height, run.sensors.hfov_rad)),
        tensors: specs,
        max_message_bytes: 4 << 20,
        time: Some(time()),
        progress: Some(progress(run)),
        resumed: run.open.values().filter(|open| open.over.is_none()).map(position).collect(),
        benchmark: BENCHMARK.to_owned(),
        server_version: env!("CARGO_PKG_VERSION").to_owned(),
        server_time_unix_ms: unix_ms(),
        ..v1::Welcome::default()
    }
}

fn size(sensors: &v1::SensorSubscription) -> (u32, u32) {
    let side = |side: u32| side.clamp(*IMAGE_SIDES.start(), *IMAGE_SIDES.end());
    (side(sensors.width), side(sensors.height))
}

fn kinds(sensors: &v1::SensorSubscription) -> Vec<v1::SensorKind> {
    SENSORS.into_iter().filter(|kind| sensors.wishes.iter().any(|wish| wish.kind() == *kind)).collect()
}

fn task(width: u32, height: u32, hfov_rad: f32) -> v1::TaskSpec {
    v1::TaskSpec {
        rules: RULES.to_owned(),
        forward_m: 0.25,
        turn_deg: 30,
        step_s: 0.25,
        max_steps: STEPS,
        width,
        height,
        hfov_rad,
        depth_max_m: DEPTH_MAX_M,
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
    let (name, minimum, maximum) = match kind {
        v1::SensorKind::Rgb => ("rgb", 0.0, 255.0),
        v1::SensorKind::Audio => ("audio", -1.0, 1.0),
        v1::SensorKind::Depth | v1::SensorKind::Unspecified => ("depth", 0.0, DEPTH_MAX_M),
    };
    v1::TensorSpec {
        id: kind as u32,
        name: name.to_owned(),
        kind: kind.into(),
        dtype: dtype.into(),
        shape,
        encoding: v1::Encoding::Raw.into(),
        minimum,
        maximum,
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
    let order = match run.request.order() {
        v1::Order::Unspecified => v1::Order::Unordered,
        order => order,
    };
    v1::EpisodeStart {
        slot: open.slot,
        episode: open.handle.clone(),
        mission: Some(v1::Mission { order: order.into(), goals: ["chair", "lamp"].map(goal).to_vec() }),
        observation: Some(observation(run, open)),
        ordinal: open.ordinal,
        progress: Some(progress(run)),
    }
}

pub(crate) fn observation(run: &TrialRun, open: &OpenEpisode) -> v1::Observation {
    let (step, size) = (open.step(), size(&run.sensors));
    v1::Observation {
        slot: open.slot,
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
        slot: open.slot,
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
        complete: run.is_complete(),
        ..v1::RunEnd::default()
    }
}

/// Creates a fault of the whole stream.
pub(crate) fn fault(reason: v1::Reason, recoverable: bool) -> v1::Fault {
    v1::Fault {
        code: reason.code() as u32,
        reason: reason.into(),
        message: message(reason),
        recoverable,
        ..v1::Fault::default()
    }
}

pub(crate) fn refused_act(act: &v1::Act, reason: v1::Reason) -> v1::Fault {
    let (slot, episode) = (Some(act.slot), act.episode.clone());
    v1::Fault { slot, episode, step: act.step, ..fault(reason, true) }
}

pub(crate) fn refusal(reason: v1::Reason, retry_after_s: Option<u32>) -> Status {
    let mut status = Status::new(reason.code(), message(reason));
    let trailers = status.metadata_mut();
    trailers.insert(REASON_KEY, MetadataValue::from_static(reason.word()));
    if let Some(seconds) = retry_after_s {
        trailers.insert(RETRY_AFTER_KEY, MetadataValue::from(seconds));
    }
    status
}

fn message(reason: v1::Reason) -> String {
    format!("the conformance kit sends {}", reason.word())
}
