//! Data sets and recipes: the first byte selects the kind of file.
#![no_main]

use avln_dataset::{
    Recipe,
    format::{File, digest_of, read_manifest, read_missions, read_scenes, read_secret},
};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let Some((kind, bytes)) = bytes.split_first() else { return };
    let file = File { name: "file", bytes };
    match kind {
        b'm' => drop(read_missions(file, "val-house-000")),
        b'l' => drop(read_scenes(file, &digest_of(bytes))),
        b'd' => drop(read_manifest(file)),
        b's' => drop(read_secret(file)),
        b'r' => drop(Recipe::from_json(&String::from_utf8_lossy(bytes))),
        // A line of the scene list, the public file and the hidden file, separated by empty lines.
        _ => avln_fuzz::read_parts(bytes),
    }
});
