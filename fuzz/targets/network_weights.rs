//! Weights of the segmentation network: safetensors.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let _ = avln_perception::VisionNetwork::from_bytes(bytes);
});
