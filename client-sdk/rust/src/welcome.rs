//! What Welcome fixes for a connection: the task, and how observations are unpacked.

use crate::{Audio, DepthImage, Error, Feedback, Image, Observation, Pose, Sensors, TaskSpec};
use avln_proto::{API_MINOR, MAX_MESSAGE_BYTES, v1};
use bytes::Bytes;
use v1::{Dtype, Encoding, SensorKind};

/// The agreement of one connection.
#[derive(Debug)]
pub(crate) struct Agreement {
    pub(crate) task: TaskSpec,
    pub(crate) run: String,
    pub(crate) slots: u32,
    pub(crate) progress: v1::RunProgress,
    depth_divisor: f32,
    tensors: Vec<v1::TensorSpec>,
}

impl Agreement {
    /// Checks that Welcome delivers what `wanted` asks for and that this client can read it.
    pub(crate) fn new(welcome: v1::Welcome, wanted: &Sensors) -> Result<Self, Error> {
        let wire = welcome.task.as_ref().ok_or_else(|| Error::protocol("Welcome has no task"))?;
        let task = TaskSpec::from_wire(wire)?;
        let depth_divisor = wire.depth_divisor;
        check_limits(&welcome)?;
        if (task.width, task.height) != (wanted.width, wanted.height) {
            return Err(Error::protocol(format!(
                "asked for {} x {} pixels and was granted {} x {}",
                wanted.width, wanted.height, task.width, task.height
            )));
        }
        let tensors = wanted_tensors(&welcome.tensors, wanted, &task)?;
        let (run, slots, progress) = (welcome.run, welcome.slots, welcome.progress.unwrap_or_default());
        Ok(Self { task, run, slots, progress, depth_divisor, tensors })
    }

    /// Unpacks an observation.
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
            Some(spec) => Err(Error::protocol(format!(
                "observation {} came without its tensor {}",
                seen.step, spec.name
            ))),
            None => Ok(seen),
        }
    }

    fn unpack_tensor(&self, tensor: v1::Tensor, seen: &mut Observation) -> Result<(), Error> {
        let Some(spec) = self.tensors.iter().find(|spec| spec.id == tensor.id) else {
            return Ok(()); // a sensor that was not asked for
        };
        check_tensor(&tensor, spec)?;
        let (width, height) = (self.task.width, self.task.height);
        match spec.kind() {
            SensorKind::Rgb => seen.rgb = Some(Image { width, height, pixels: tensor.data.into() }),
            SensorKind::Depth => {
                seen.depth = Some(DepthImage { width, height, metres: self.metres(&tensor.data) });
            }
            SensorKind::Audio => seen.audio = Some(self.ears(&tensor.data)),
            SensorKind::Unspecified => {}
        }
        Ok(())
    }

    fn metres(&self, data: &Bytes) -> Vec<f32> {
        let mut metres = floats(data);
        if self.depth_divisor != 1.0 {
            metres.iter_mut().for_each(|value| *value *= self.depth_divisor);
        }
        metres
    }

    fn ears(&self, data: &Bytes) -> Audio {
        let half = data.len() / 2;
        Audio {
            sample_rate_hz: self.task.sample_rate_hz,
            left: floats(&data[..half]),
            right: floats(&data[half..]),
        }
    }
}

fn check_limits(welcome: &v1::Welcome) -> Result<(), Error> {
    if welcome.api_minor > API_MINOR {
        return Err(Error::protocol(format!(
            "the server speaks avln.v1 minor {}, agreed was at most {API_MINOR}",
            welcome.api_minor
        )));
    }
    if welcome.slots == 0 {
        return Err(Error::protocol("Welcome grants no slot"));
    }
    let bytes = u64::from(welcome.max_message_bytes);
    if bytes > MAX_MESSAGE_BYTES as u64 {
        return Err(Error::protocol(format!(
            "messages of {bytes} bytes are announced, this client reads {MAX_MESSAGE_BYTES}; ask for smaller pictures"
        )));
    }
    Ok(())
}

/// The layouts of the wanted sensors, each checked.
fn wanted_tensors(
    offered: &[v1::TensorSpec],
    wanted: &Sensors,
    task: &TaskSpec,
) -> Result<Vec<v1::TensorSpec>, Error> {
    let pick = |kind: SensorKind| {
        let spec = offered.iter().find(|spec| spec.kind() == kind);
        let spec = spec.ok_or_else(|| Error::protocol(format!("Welcome lists no {}", kind.as_str_name())))?;
        check_spec(spec, task)?;
        Ok(spec.clone())
    };
    wanted.kinds().map(pick).collect()
}

/// The only layouts that this client reads.
fn check_spec(spec: &v1::TensorSpec, task: &TaskSpec) -> Result<(), Error> {
    let (dtype, shape) = match spec.kind() {
        SensorKind::Rgb => (Dtype::U8, vec![task.height, task.width, 3]),
        SensorKind::Depth => (Dtype::F32, vec![task.height, task.width]),
        SensorKind::Audio => (Dtype::F32, vec![2, task.audio_samples]),
        SensorKind::Unspecified => return Ok(()),
    };
    let fits = spec.dtype() == dtype && spec.shape == shape && spec.encoding() == Encoding::Raw;
    if fits {
        return Ok(());
    }
    Err(Error::protocol(format!(
        "tensor {} is announced as {} {:?} {}, this client reads {} {shape:?} {}",
        spec.name,
        spec.dtype().as_str_name(),
        spec.shape,
        spec.encoding().as_str_name(),
        dtype.as_str_name(),
        Encoding::Raw.as_str_name()
    )))
}

fn check_tensor(tensor: &v1::Tensor, spec: &v1::TensorSpec) -> Result<(), Error> {
    let element: u64 = if spec.dtype() == Dtype::F32 { 4 } else { 1 };
    let bytes = spec.shape.iter().fold(element, |product, &side| product.saturating_mul(u64::from(side)));
    let fits = tensor.shape == spec.shape && tensor.dtype == spec.dtype && tensor.encoding == spec.encoding;
    if fits && tensor.data.len() as u64 == bytes {
        return Ok(());
    }
    Err(Error::protocol(format!(
        "tensor {} came with shape {:?} and {} bytes, announced were {:?} and {bytes}",
        spec.name,
        tensor.shape,
        tensor.data.len(),
        spec.shape
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

/// Little-endian numbers; that they are whole ones was checked against the agreement.
fn floats(data: &[u8]) -> Vec<f32> {
    if cfg!(target_endian = "little") {
        return bytemuck::pod_collect_to_vec(data);
    }
    data.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
}

fn pose(wire: Option<v1::Pose>) -> Result<Pose, Error> {
    let wire = wire.ok_or_else(|| Error::protocol("an observation came without a pose"))?;
    Ok(Pose { position: [wire.x_m, wire.y_m, wire.z_m], heading_rad: wire.heading_rad })
}

fn feedback(wire: v1::SubmitFeedback) -> Feedback {
    match wire {
        v1::SubmitFeedback::Unspecified => Feedback::None,
        v1::SubmitFeedback::Accepted => Feedback::Accepted,
        v1::SubmitFeedback::Correct => Feedback::Verdict(true),
        v1::SubmitFeedback::Wrong => Feedback::Verdict(false),
    }
}
