//! Recordings: WAV.
#![no_main]

use avln_fuzz::with_file;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    with_file("clip.wav", bytes, |path| {
        let _ = avln_arena::audio::read_recording(path);
    });
});
