//! Textures: PNG, JPEG, KTX2 and `.basis`.
#![no_main]

libfuzzer_sys::fuzz_target!(init: avln_fuzz::permit_panics_in_libraries(), |bytes: &[u8]| {
    let _ = avln_formats::glb::from_bytes("scene", "scene.glb", &avln_fuzz::textured(bytes));
});
