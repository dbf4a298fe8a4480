//! Messages of the protocol, and encodings of pictures and sound: the first byte is their size.
#![no_main]

use avln_proto::v1;
use prost::Message;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let Some((size, bytes)) = bytes.split_first() else { return };
    avln_fuzz::decode(*size, bytes);
    let _ = v1::PlayRequest::decode(bytes);
    let _ = v1::ResetRequest::decode(bytes);
    let _ = v1::StepRequest::decode(bytes);
    let _ = v1::StartRunRequest::decode(bytes);
    let _ = v1::StepResponse::decode(bytes);
    let _ = v1::StartRunResponse::decode(bytes);
    // The encodings of a step, as a client decodes them.
    if let Ok(v1::PlayResponse { frame: Some(v1::play_response::Frame::Observation(seen)) }) =
        v1::PlayResponse::decode(bytes)
    {
        seen.tensors.iter().for_each(|tensor| avln_fuzz::decode(*size, &tensor.data));
    }
});
