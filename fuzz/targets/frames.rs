//! Frames of the protocol, and encodings of depth and sound: the first byte selects.
#![no_main]

use avln_proto::v1;
use prost::Message;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let Some((kind, bytes)) = bytes.split_first() else { return };
    avln_fuzz::decode(*kind, bytes);
    let _ = v1::PlayRequest::decode(bytes);
    let _ = v1::PlayResponse::decode(bytes);
    let _ = v1::StartRunRequest::decode(bytes);
});
