//! Meshes packed with Draco.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let _ = avln_formats::glb::from_bytes("scene", "scene.glb", &avln_fuzz::packed(bytes));
});
