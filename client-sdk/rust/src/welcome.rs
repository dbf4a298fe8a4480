//! Connection agreement from Welcome: task and observation decoding.

use crate::connect_options::Packing;
use crate::error::Error;
use crate::observation::{Audio, DepthImage, Feedback, Image, Observation, Pose};
use crate::task::{Sensors, TaskSpec};
use avln_proto::wire::{CodecError, Size, audio, depth, rgb};
use avln_proto::{API_MINOR, MAX_MESSAGE_BYTES, v1};
use std::time::Duration;
use v1::{Dtype, SensorKind};

#[derive(Debug)]
pub(crate) struct Agreement {
    pub(crate) task: TaskSpec,
    pub(crate) run: String,
    pub(crate) slots: u32,
    pub(crate) progress: v1::RunProgress,
    /// Longest permitted disconnection.
    pub(crate) may_be_away: Duration,
    depth_divisor: f32,
    tensors: Vec<v1::TensorSpec>,
}

impl Agreement {
    /// Checks that Welcome provides the `wanted` sensors in decodable form.
    pub(crate) fn new(welcome: v1::Welcome, wanted: &Sensors, packing: Packing) -> Result<Self, Error> {
        let wire = welcome.task.as_ref().ok_or_else(|| Error::protocol("Welcome has no task"))?;
        let task = TaskSpec::from_wire(wire)?;
        let depth_divisor = wire.depth_divisor;
        check_limits(&welcome)?;
        if (task.width, task.height) != (wanted.width, wanted.height) {
            return Err(Error::protocol(format!(
                "Welcome: expected {} x {} pixels, got {} x {}",
                wanted.width, wanted.height, task.width, task.height
            )));
        }
        let away_s = welcome.time.as_ref().map_or(0, |time| time.disconnect_s);
        let may_be_away = Duration::from_secs(u64::from(away_s));
        let tensors = wanted_tensors(&welcome.tensors, wanted, packing, &task)?;
        Ok(Self {
            task,
            run: welcome.run,
            slots: welcome.slots,
            progress: welcome.progress.unwrap_or_default(),
            may_be_away,
            depth_divisor,
            tensors,
        })
    }

    pub(crate) fn unpack(&self, wire: v1::Observation) -> Result<Observation, Error> {
        let mut seen = Observation {
            step: wire.step,
            pose: pose(wire.pose)?,
            remaining_steps: wire.remaining_steps,
            remaining_submits: wire.remaining_submits,
            feedback: feedback(wire.feedback()),
            ..Observation::default()
        };
        for tensor in wire.tensors {
            self.unpack_tensor(tensor, &mut seen)?;
        }
        match self.tensors.iter().find(|spec| is_missing(spec.kind(), &seen)) {
            Some(spec) => {
                Err(Error::protocol(format!("observation {} has no tensor {}", seen.step, spec.name)))
            }
            None => Ok(seen),
        }
    }

    fn unpack_tensor(&self, tensor: v1::Tensor, seen: &mut Observation) -> Result<(), Error> {
        let Some(spec) = self.tensors.iter().find(|spec| spec.id == tensor.id) else {
            // A server may send more sensors than requested.
            return Ok(());
        };
        check_tensor(&tensor, spec)?;
        self.decode(spec, tensor, seen).map_err(|error| {
            Error::protocol(format!("tensor {} of observation {}: {error}", spec.name, seen.step))
        })
    }

    fn decode(
        &self,
        spec: &v1::TensorSpec,
        tensor: v1::Tensor,
        seen: &mut Observation,
    ) -> Result<(), CodecError> {
        let (width, height) = (self.task.width, self.task.height);
        let (size, encoding) = (Size { width, height }, tensor.encoding());
        match spec.kind() {
            SensorKind::Rgb => {
                let pixels = rgb::decode(encoding, size, tensor.data)?;
                seen.rgb = Some(Image { width, height, pixels });
            }
            SensorKind::Depth => {
                let layout = depth::Layout { size, unit_m: self.depth_divisor };
                let metres = self.metres(depth::decode(encoding, layout, &tensor.data)?);
                seen.depth = Some(DepthImage { width, height, metres });
            }
            SensorKind::Audio => {
                let samples = self.task.audio_samples as usize;
                let mut left = audio::decode(encoding, 2 * samples, &tensor.data)?;
                let right = left.split_off(samples);
                seen.audio = Some(Audio { sample_rate_hz: self.task.sample_rate_hz, left, right });
            }
            SensorKind::Unspecified => {}
        }
        Ok(())
    }

    fn metres(&self, mut depth: Vec<f32>) -> Vec<f32> {
        // A multiplication by 1 would change nothing, but touch every pixel.
        if self.depth_divisor != 1.0 {
            depth.iter_mut().for_each(|value| *value *= self.depth_divisor);
        }
        depth
    }
}

fn check_limits(welcome: &v1::Welcome) -> Result<(), Error> {
    if welcome.api_minor > API_MINOR {
        return Err(Error::protocol(format!(
            "expected avln.v1 minor {API_MINOR} or lower, got minor {}",
            welcome.api_minor
        )));
    }
    if welcome.slots == 0 {
        return Err(Error::protocol("Welcome grants no slot"));
    }
    let bytes = u64::from(welcome.max_message_bytes);
    if bytes > MAX_MESSAGE_BYTES as u64 {
        return Err(Error::protocol(format!(
            "message size: expected at most {MAX_MESSAGE_BYTES} bytes, got {bytes}; request smaller images"
        )));
    }
    Ok(())
}

fn wanted_tensors(
    offered: &[v1::TensorSpec],
    wanted: &Sensors,
    packing: Packing,
    task: &TaskSpec,
) -> Result<Vec<v1::TensorSpec>, Error> {
    let pick = |kind: SensorKind| {
        let spec = offered.iter().find(|spec| spec.kind() == kind);
        let spec = spec.ok_or_else(|| Error::protocol(format!("Welcome lists no {}", kind.as_str_name())))?;
        check_spec(spec, packing, task)?;
        Ok(spec.clone())
    };
    wanted.kinds().map(pick).collect()
}

fn check_spec(spec: &v1::TensorSpec, packing: Packing, task: &TaskSpec) -> Result<(), Error> {
    let (dtype, shape) = match spec.kind() {
        SensorKind::Rgb => (Dtype::U8, vec![task.height, task.width, 3]),
        SensorKind::Depth => (Dtype::F32, vec![task.height, task.width]),
        SensorKind::Audio => (Dtype::F32, vec![2, task.audio_samples]),
        SensorKind::Unspecified => return Ok(()),
    };
    let wished = packing.wishes(spec.kind());
    if spec.dtype() == dtype && spec.shape == shape && wished.contains(&spec.encoding()) {
        return Ok(());
    }
    Err(Error::protocol(format!(
        "tensor {}: expected {} {shape:?} {}, got {} {:?} {}",
        spec.name,
        dtype.as_str_name(),
        wished.iter().map(|encoding| encoding.as_str_name()).collect::<Vec<_>>().join(" or "),
        spec.dtype().as_str_name(),
        spec.shape,
        spec.encoding().as_str_name()
    )))
}

/// Accepts the agreed encoding, or raw numbers in its place.
fn check_tensor(tensor: &v1::Tensor, spec: &v1::TensorSpec) -> Result<(), Error> {
    let is_agreed = tensor.encoding == spec.encoding || tensor.encoding() == v1::Encoding::Raw;
    if tensor.shape == spec.shape && tensor.dtype == spec.dtype && is_agreed {
        return Ok(());
    }
    Err(Error::protocol(format!(
        "tensor {}: expected {:?} as {}, got {:?} as {}",
        spec.name,
        spec.shape,
        spec.encoding().as_str_name(),
        tensor.shape,
        tensor.encoding().as_str_name()
    )))
}

fn is_missing(kind: SensorKind, seen: &Observation) -> bool {
    match kind {
        SensorKind::Rgb => seen.rgb.is_none(),
        SensorKind::Depth => seen.depth.is_none(),
        SensorKind::Audio => seen.audio.is_none(),
        SensorKind::Unspecified => false,
    }
}

fn pose(wire: Option<v1::Pose>) -> Result<Pose, Error> {
    let wire = wire.ok_or_else(|| Error::protocol("an observation has no pose"))?;
    Ok(Pose::new([wire.x_m, wire.y_m, wire.z_m], wire.heading_rad))
}

fn feedback(wire: v1::SubmitFeedback) -> Feedback {
    match wire {
        v1::SubmitFeedback::Unspecified => Feedback::None,
        v1::SubmitFeedback::Accepted => Feedback::Accepted,
        v1::SubmitFeedback::Correct => Feedback::Verdict(true),
        v1::SubmitFeedback::Wrong => Feedback::Verdict(false),
    }
}
