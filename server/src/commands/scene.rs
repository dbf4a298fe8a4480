//! Looks at scenes and exports them.

use super::scene_import;
use crate::say::say;
use crate::{Failure, FailureKind};
use avln_scene::{Scene, glb, open, procedural};
use clap::{Args, Subcommand};
use std::path::{Path, PathBuf};

/// Commands about scenes.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Write a scene as a standard GLB file, for Blender or Habitat
    Export {
        /// The scene to export
        #[command(flatten)]
        scene: Choice,
        /// The file to write
        #[arg(value_name = "OUT.glb")]
        out: PathBuf,
    },
    /// Read a scan in whatever layout it comes and write it as a scene of the arena
    Import(scene_import::Options),
    /// Measure scenes: size, clutter, how hard they are to walk in, next to real buildings
    Stats(super::scene_stats::Options),
    /// Print what a scene holds
    Info {
        /// The scene to look at
        #[command(flatten)]
        scene: Choice,
    },
}

/// A scene from a file, or grown from a seed.
#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
pub struct Choice {
    /// A scene file or folder, in any layout that `avln scene import` reads
    #[arg(long, value_name = "PATH")]
    scene: Option<PathBuf>,
    /// Seed of a procedural house
    #[arg(long)]
    seed: Option<u64>,
}

/// Carries out a command about scenes.
///
/// # Errors
/// When the scene cannot be read or the file cannot be written.
pub fn run(command: Command) -> Result<(), Failure> {
    match command {
        Command::Import(options) => scene_import::run(&options),
        Command::Export { scene, out } => export(&load(&scene)?, &out),
        Command::Stats(options) => super::scene_stats::run(&options),
        Command::Info { scene } => {
            print_info(&load(&scene)?);
            Ok(())
        }
    }
}

fn load(choice: &Choice) -> Result<Scene, Failure> {
    match (&choice.scene, choice.seed) {
        (Some(path), _) => open::open(path).map_err(|error| Failure::new(FailureKind::Scene, error)),
        (None, seed) => {
            let seed = seed.unwrap_or_default();
            Ok(procedural::house(&format!("house-{seed}"), seed, &procedural::HouseOptions::default()))
        }
    }
}

fn export(scene: &Scene, out: &Path) -> Result<(), Failure> {
    let bytes = glb::export(scene);
    std::fs::write(out, &bytes).map_err(|error| {
        Failure::new(FailureKind::Data, format!("cannot write {}: {error}", out.display()))
    })?;
    say!("{}: {} bytes, {} triangles", out.display(), bytes.len(), scene.mesh.triangles.len());
    Ok(())
}

fn print_info(scene: &Scene) {
    say!("scene      {}", scene.name);
    say!("digest     {}", avln_scene::digest::digest(scene));
    say!("triangles  {}", scene.mesh.triangles.len());
    if let Some(bounds) = scene.bounds() {
        let size = bounds.size();
        say!("size       {:.1} x {:.1} x {:.1} m", size.x, size.y, size.z);
    }
    say!("regions    {}", scene.regions.len());
    say!("objects    {}", scene.objects.len());
    for object in &scene.objects {
        let (at, words) = (object.bounds.center(), &object.attributes);
        let looks = [&words.size, &words.shape, &words.color, &words.material].map(String::as_str);
        let looks: Vec<_> = looks.into_iter().filter(|word| !word.is_empty()).collect();
        say!(
            "  {:>4} {:<18} {:>7.2} {:>6.2} {:>7.2}  {}",
            object.id.0,
            object.category,
            at.x,
            at.y,
            at.z,
            looks.join(" ")
        );
    }
}
