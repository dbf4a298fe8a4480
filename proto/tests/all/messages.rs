//! Messages as bytes.

use avln_proto::{
    FILE_DESCRIPTOR_SET,
    v1::{self, Reason, play_request, play_response},
};
use bytes::{BufMut, Bytes, BytesMut};
use prost::Message;

fn act() -> v1::Act {
    v1::Act { slot: 1, episode: "e".into(), step: 2, action: v1::Action::TurnLeft as i32 }
}

#[test]
fn an_act_has_the_expected_bytes() {
    let frame = v1::PlayRequest { frame: Some(play_request::Frame::Act(act())) };
    // Field 3, length 9: slot = 1, episode = "e", step = 2, action = 2.
    let by_hand = [0x1A, 9, 0x08, 1, 0x12, 1, b'e', 0x18, 2, 0x20, 2];
    assert_eq!(frame.encode_to_vec(), by_hand);
    assert_eq!(v1::PlayRequest::decode(&by_hand[..]), Ok(frame));
}

#[test]
fn observations_are_decoded_without_copying_pictures() {
    let data = Bytes::from(vec![7_u8; 4096]);
    let tensor = v1::Tensor {
        id: 1,
        dtype: v1::Dtype::U8 as i32,
        shape: vec![64, 64],
        encoding: v1::Encoding::Raw as i32,
        data,
    };
    let seen = v1::Observation {
        slot: 3,
        episode: "ep".into(),
        step: 9,
        tensors: vec![tensor],
        pose: Some(v1::Pose { x_m: 1.0, y_m: -0.0, z_m: f32::MIN_POSITIVE, heading_rad: -3.0 }),
        feedback: v1::SubmitFeedback::Wrong as i32,
        truncated: true,
        reason: v1::EndReason::TimeBudget as i32,
        time: Some(v1::TimeAccount { step_ms: 5000, bank_ms: 0 }),
        ..v1::Observation::default()
    };
    let frame = v1::PlayResponse { frame: Some(play_response::Frame::Observation(seen)) };
    let bytes = Bytes::from(frame.encode_to_vec());
    let back = v1::PlayResponse::decode(bytes.clone()).unwrap();
    assert_eq!(back, frame);
    let Some(play_response::Frame::Observation(seen)) = back.frame else { panic!("another frame") };
    let inside = bytes.as_ptr_range();
    assert!(inside.contains(&seen.tensors[0].data.as_ptr()));
}

#[test]
fn newer_frames_are_empty_and_values_unspecified() {
    let mut unknown = BytesMut::new();
    unknown.put_slice(&[0xFA, 0x01, 2, 0x08, 1]); // field 31, length 2
    assert_eq!(v1::PlayRequest::decode(unknown), Ok(v1::PlayRequest { frame: None }));
    let newer = v1::Act { action: 99, ..act() };
    let back = v1::Act::decode(newer.encode_to_vec().as_slice()).unwrap();
    assert_eq!((back.action, back.action()), (99, v1::Action::Unspecified));
}

#[test]
fn absent_metrics_differ_from_empty_ones() {
    let empty = v1::EpisodeEnd { metrics: Some(v1::PublicMetrics::default()), ..v1::EpisodeEnd::default() };
    let back = v1::EpisodeEnd::decode(empty.encode_to_vec().as_slice()).unwrap();
    assert!(back.metrics.is_some());
    assert_eq!(v1::EpisodeEnd::decode(&[][..]).unwrap().metrics, None);
}

#[test]
fn garbage_is_an_error() {
    assert!(v1::PlayRequest::decode(&[0x1A, 200, 0x08][..]).is_err());
    assert!(v1::PlayRequest::decode(&[0xFF; 16][..]).is_err());
}

#[test]
fn reasons_round_trip_as_text() {
    for number in 0..64 {
        let Ok(reason) = Reason::try_from(number) else { continue };
        assert_eq!(Reason::from_word(reason.word()), Some(reason));
        assert!(!reason.word().starts_with("REASON"));
    }
    assert_eq!(Reason::StepAhead.word(), "STEP_AHEAD");
    assert_eq!(Reason::from_word("MOON_PHASE"), None);
}

#[test]
fn reflection_finds_all_services() {
    let text = String::from_utf8_lossy(FILE_DESCRIPTOR_SET);
    for service in ["InfoService", "RunService", "PlayService"] {
        assert!(text.contains(service), "{service}");
    }
}
