//! Scene files: PLY.
#![no_main]

use avln_fuzz::with_file;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    with_file("scene.ply", bytes, |path| {
        let _ = avln_formats::open::open(path);
    });
});
