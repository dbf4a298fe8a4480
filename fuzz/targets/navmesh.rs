//! Navigation meshes of Recast and Detour.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let _ = avln_navmesh::NavMesh::from_detour(bytes);
});
