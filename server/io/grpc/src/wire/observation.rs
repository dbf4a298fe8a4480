//! Observations and their tensors.

use super::sensors::{SensorValues, encoding, pack};
use avln_episode::{Encoding, EndReason, Feedback, Observation, Rules, Sensors};
use avln_proto::v1::{self, Dtype, SensorKind};
use bytes::Bytes;

const RGB_ID: u32 = 1;
const DEPTH_ID: u32 = 2;
const AUDIO_ID: u32 = 3;

/// Returns the requested tensor specifications, in the order rgb, depth, audio.
pub(crate) fn tensor_specs(sensors: &Sensors, rules: &Rules) -> Vec<v1::TensorSpec> {
    let (width, height, encodings) = (sensors.width, sensors.height, sensors.encodings);
    let mut specs = Vec::with_capacity(3);
    let mut push = |id, name: &str, kind: SensorKind, dtype: Dtype, shape, range: [f32; 2], wanted| {
        specs.push(v1::TensorSpec {
            id,
            name: name.to_owned(),
            kind: kind.into(),
            dtype: dtype.into(),
            shape,
            encoding: encoding(wanted).into(),
            minimum: range[0],
            maximum: range[1],
        });
    };
    if sensors.rgb {
        push(RGB_ID, "rgb", SensorKind::Rgb, Dtype::U8, vec![height, width, 3], [0.0, 255.0], encodings.rgb);
    }
    if sensors.depth {
        let range = [0.0, rules.depth_max_m / rules.depth_divisor];
        push(DEPTH_ID, "depth", SensorKind::Depth, Dtype::F32, vec![height, width], range, encodings.depth);
    }
    if sensors.audio {
        let shape = vec![Sensors::AUDIO_CHANNELS, rules.audio_samples];
        push(AUDIO_ID, "audio", SensorKind::Audio, Dtype::F32, shape, [-1.0, 1.0], encodings.audio);
    }
    specs
}

#[derive(Clone, Copy)]
pub(crate) struct ObservationFormat<'a> {
    pub(crate) sensors: &'a Sensors,
    pub(crate) rules: &'a Rules,
}

/// Builds an observation frame, without the time account. Raw pixels and samples are moved, not copied.
pub(crate) fn observation(
    slot: u32,
    episode: &str,
    observation: Observation,
    format: ObservationFormat<'_>,
    end: Option<EndReason>,
) -> v1::Observation {
    let pose = observation.pose;
    v1::Observation {
        slot,
        episode: episode.to_owned(),
        step: observation.step,
        pose: Some(v1::Pose {
            x_m: pose.position.x,
            y_m: pose.position.y,
            z_m: pose.position.z,
            heading_rad: pose.heading_rad,
        }),
        remaining_steps: observation.remaining_steps,
        remaining_submits: observation.remaining_submits,
        feedback: feedback(observation.feedback).into(),
        terminated: end.is_some_and(EndReason::is_terminated),
        truncated: end.is_some_and(|reason| !reason.is_terminated()),
        reason: end.map_or(v1::EndReason::Unspecified, super::end_reason).into(),
        time: None,
        tensors: tensors(observation, format.sensors, format.rules.depth_divisor),
    }
}

fn tensors(observation: Observation, sensors: &Sensors, depth_divisor: f32) -> Vec<v1::Tensor> {
    let (width, height, encodings) = (sensors.width, sensors.height, sensors.encodings);
    let mut tensors = Vec::with_capacity(3);
    let mut push = |id, dtype, shape, values, wanted: Encoding| {
        let (encoding, data) = pack(values, wanted, sensors);
        tensors.push(tensor(id, dtype, shape, encoding, data));
    };
    if let Some(rgb) = observation.rgb {
        push(RGB_ID, Dtype::U8, vec![height, width, 3], SensorValues::Rgb(rgb), encodings.rgb);
    }
    if let Some(depth) = observation.depth {
        let values = SensorValues::Depth(depth, depth_divisor);
        push(DEPTH_ID, Dtype::F32, vec![height, width], values, encodings.depth);
    }
    if let Some(audio) = observation.audio {
        let shape = vec![Sensors::AUDIO_CHANNELS, audio.len() as u32 / Sensors::AUDIO_CHANNELS];
        push(AUDIO_ID, Dtype::F32, shape, SensorValues::Audio(audio), encodings.audio);
    }
    tensors
}

pub(super) fn tensor(
    id: u32,
    dtype: Dtype,
    shape: Vec<u32>,
    encoding: v1::Encoding,
    data: Bytes,
) -> v1::Tensor {
    v1::Tensor { id, dtype: dtype.into(), shape, encoding: encoding.into(), data }
}

fn feedback(feedback: Feedback) -> v1::SubmitFeedback {
    match feedback {
        Feedback::None => v1::SubmitFeedback::Unspecified,
        Feedback::Accepted => v1::SubmitFeedback::Accepted,
        Feedback::Verdict(true) => v1::SubmitFeedback::Correct,
        Feedback::Verdict(false) => v1::SubmitFeedback::Wrong,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_episode::{Encodings, Point3, Pose};

    fn sensed() -> Observation {
        Observation {
            step: 3,
            rgb: Some((0..64 * 64 * 3).map(|i| i as u8).collect()),
            depth: Some((0..64 * 64).map(|i| i as f32 / 8.0).collect()),
            audio: Some(vec![0.5, -0.25, 1.0, 0.0]),
            pose: Pose { position: Point3::new(1.0, 2.0, -3.0), heading_rad: 0.5 },
            remaining_steps: 997,
            remaining_submits: 1,
            feedback: Feedback::Verdict(false),
        }
    }

    fn sent(seen: Observation, sensors: &Sensors, rules: &Rules, end: Option<EndReason>) -> v1::Observation {
        observation(2, "ep_x", seen, ObservationFormat { sensors, rules }, end)
    }

    #[test]
    fn raw_values_arrive_unchanged() {
        let sent = sent(sensed(), &Sensors::all(64, 64), &Rules::paper(), Some(EndReason::StepLimit));
        let decoded = |tensor: &v1::Tensor| -> Vec<f32> {
            let words = tensor.data.chunks_exact(4);
            words.map(|word| f32::from_le_bytes(word.try_into().unwrap())).collect()
        };
        assert_eq!(sent.tensors[0].data, sensed().rgb.unwrap());
        assert_eq!(sent.tensors[0].shape, [64, 64, 3]);
        assert_eq!(decoded(&sent.tensors[1]), sensed().depth.unwrap());
        assert_eq!(decoded(&sent.tensors[2]), [0.5, -0.25, 1.0, 0.0]);
        assert_eq!(sent.tensors[2].shape, [2, 2]);
        assert_eq!(sent.pose, Some(v1::Pose { x_m: 1.0, y_m: 2.0, z_m: -3.0, heading_rad: 0.5 }));
        assert_eq!((sent.terminated, sent.truncated), (false, true));
        assert_eq!(sent.feedback(), v1::SubmitFeedback::Wrong);
    }

    #[test]
    fn specs_describe_the_tensors() {
        let sensors = Sensors { depth: false, ..Sensors::all(64, 64) };
        let mut rules = Rules::paper();
        rules.audio_samples = 2;
        let sent = sent(Observation { depth: None, ..sensed() }, &sensors, &rules, None);
        let specs = tensor_specs(&sensors, &rules);
        assert_eq!(specs.len(), sent.tensors.len());
        for (spec, tensor) in specs.iter().zip(&sent.tensors) {
            assert_eq!((spec.id, spec.dtype, &spec.shape), (tensor.id, tensor.dtype, &tensor.shape));
        }
        assert!(!sent.terminated && !sent.truncated && sent.reason() == v1::EndReason::Unspecified);
    }

    #[test]
    fn agreed_encodings_are_announced_and_kept() {
        let mut sensors = Sensors::all(64, 64);
        sensors.encodings = Encodings { rgb: Encoding::Qoi, depth: Encoding::Packed, audio: Encoding::Int16 };
        let mut rules = Rules::paper();
        rules.audio_samples = 2;
        let sent = sent(sensed(), &sensors, &rules, None);
        for (spec, tensor) in tensor_specs(&sensors, &rules).iter().zip(&sent.tensors) {
            assert_eq!(
                (spec.encoding, spec.dtype, &spec.shape),
                (tensor.encoding, tensor.dtype, &tensor.shape)
            );
        }
        let size = avln_proto::wire::Size { width: 64, height: 64 };
        let [rgb, depth, _] = &sent.tensors[..] else { panic!("{} tensors", sent.tensors.len()) };
        assert_eq!(
            avln_proto::wire::rgb::decode(rgb.encoding(), size, rgb.data.clone()),
            Ok(sensed().rgb.unwrap())
        );
        let layout = avln_proto::wire::depth::Layout { size, unit_m: 1.0 };
        assert_eq!(
            avln_proto::wire::depth::decode(depth.encoding(), layout, &depth.data),
            Ok(sensed().depth.unwrap())
        );
    }

    #[test]
    fn unencodable_values_are_sent_raw() {
        let sensors = Sensors {
            encodings: Encodings { rgb: Encoding::Packed, ..Encodings::default() },
            ..Sensors::all(64, 64)
        };
        let broken = Observation { rgb: Some(vec![1, 2, 3]), ..sensed() };
        let sent = sent(broken, &sensors, &Rules::paper(), None);
        assert_eq!(
            (sent.tensors[0].encoding(), &sent.tensors[0].data[..]),
            (v1::Encoding::Raw, &[1, 2, 3][..])
        );
    }
}
