//! Scene files: glTF.
#![no_main]

use avln_fuzz::with_file;

libfuzzer_sys::fuzz_target!(init: avln_fuzz::permit_panics_in_libraries(), |bytes: &[u8]| {
    with_file("scene.gltf", bytes, |path| {
        let _ = avln_formats::open::open(path);
    });
});
