//! Labels, materials and sizes next to a mesh, and ProcTHOR houses: the first byte selects the kind of file.
#![no_main]

use avln_fuzz::with_files;

const GLB: &[u8] = include_bytes!("../fixtures/scan.glb");
const HOUSE: &[u8] = include_bytes!("../fixtures/house.json");
const OBJ: &[u8] = include_bytes!("../fixtures/scan.obj");
const PLY: &[u8] = include_bytes!("../fixtures/scan.ply");

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let Some((kind, bytes)) = bytes.split_first() else { return };
    let files: Vec<(&str, &[u8])> = match kind {
        b'a' => vec![("asset-database.json", bytes), ("house_1.json", HOUSE)],
        b'g' => vec![("scan.scn", bytes), ("scan_semantic.ply", PLY)],
        b'h' => vec![("scan.house", bytes), ("scan_semantic.ply", PLY)],
        b'm' => vec![("scan.mtl", bytes), ("scan.obj", OBJ)],
        b'r' => vec![("habitat/info_semantic.json", bytes), ("habitat/mesh_semantic.ply", PLY)],
        b's' => vec![("scan.semantic.txt", bytes), ("scan.semantic.glb", GLB), ("scan.glb", GLB)],
        _ => vec![("house_1.json", bytes)],
    };
    with_files(&files, |folder| drop(avln_formats::open::open(folder)));
});
