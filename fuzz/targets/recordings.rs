//! Recordings: FLAC and WAV.
#![no_main]

use avln_fuzz::with_file;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    for name in ["clip.flac", "clip.wav"] {
        with_file(name, bytes, |path| {
            let _ = avln_arena::audio::read_recording(path);
        });
    }
});
