//! Tests of imports and exports with whole scenes.

mod five_layouts;
mod round_trip;
mod shared_scenes;

use std::path::{Path, PathBuf};

/// The folder of shared scenes; reports that `test` is skipped if it is missing.
fn scene_folder(test: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../../shared/scenes");
    if folder.is_dir() {
        return Some(folder);
    }
    println!("skipped: {test}: needs ../shared/scenes");
    None
}
