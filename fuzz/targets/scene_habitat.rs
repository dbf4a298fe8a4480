//! Scenes composed for Habitat: the files of a data set, separated by zero bytes.
#![no_main]

use avln_fuzz::with_files;

const BOX: &[u8] = include_bytes!("../corpus/scene_glb/box.glb");
const NAMES: [&str; 7] = [
    "home.scene_dataset_config.json",
    "stages/floor.stage_config.json",
    "objects/b/bench.object_config.json",
    "scenes/home.scene_instance.json",
    "semantics/lexicon.json",
    "semantics/rooms/home.semantic_config.json",
    "metadata/objects.csv",
];

libfuzzer_sys::fuzz_target!(init: avln_fuzz::permit_panics_in_libraries(), |bytes: &[u8]| {
    let mut files: Vec<(&str, &[u8])> = NAMES.into_iter().zip(bytes.split(|byte| *byte == 0)).collect();
    files.push(("meshes/box.glb", BOX));
    with_files(&files, |folder| drop(avln_formats::open::open(&folder.join(NAMES[3]))));
});
