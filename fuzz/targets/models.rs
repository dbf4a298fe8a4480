//! Configuration of ONNX models.
#![no_main]

use avln_fuzz::with_file;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    with_file("models.toml", bytes, |path| {
        let _ = avln_kit::onnx::OnnxRecognition::load(path);
    });
});
