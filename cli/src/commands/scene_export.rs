//! Writes a scene as files that other programs open.

use crate::output::say;
use avln_arena::{Failure, FailureKind};
use avln_formats::{glb, hm3d};
use avln_scene::Scene;
use clap::ValueEnum;
use std::path::{Path, PathBuf};

/// How instances are told apart in the files written.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Semantics {
    /// As in HM3D: Z up, with OUT.semantic.glb, OUT.semantic.txt and OUT.scene_dataset_config.json beside it
    Hm3d,
}

/// Writes `scene` to `out`, with its semantics beside it where they are asked for.
pub(super) fn export(scene: &Scene, out: &Path, semantics: Option<Semantics>) -> Result<(), Failure> {
    match semantics {
        None => write(out, &glb::export(scene))?,
        Some(Semantics::Hm3d) => export_hm3d(scene, out)?,
    }
    say!("{} triangles, {} instances", scene.mesh.triangles.len(), scene.objects.len());
    Ok(())
}

fn export_hm3d(scene: &Scene, out: &Path) -> Result<(), Failure> {
    let name = out.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let Some(stem) = name.strip_suffix(".glb").filter(|stem| !stem.is_empty()) else {
        return Err(Failure::new(
            FailureKind::Data,
            format!(
                "{} does not end in .glb, by which Habitat finds the semantics; name it so",
                out.display()
            ),
        ));
    };
    let beside = |suffix: &str| -> PathBuf { out.with_file_name(format!("{stem}{suffix}")) };
    let files = hm3d::export(scene);
    write(out, &files.render)?;
    write(&beside(".semantic.glb"), &files.semantic)?;
    write(&beside(".semantic.txt"), files.table.as_bytes())?;
    write(&beside(".scene_dataset_config.json"), hm3d::dataset_config(name).as_bytes())
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    std::fs::write(path, bytes).map_err(|error| {
        Failure::new(FailureKind::Data, format!("cannot write {}: {error}", path.display()))
            .hinted("name a file in a folder that exists and has room")
    })?;
    say!("{}: {} bytes", path.display(), bytes.len());
    Ok(())
}
