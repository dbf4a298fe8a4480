//! Looks at scenes and exports them.

use super::scene_export::{Semantics, export};
use super::scene_import;
use crate::output::say;
use avln_arena::{Failure, FailureKind};
use avln_formats::open;
use avln_houses::Pool;
use avln_scene::Scene;
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
        /// Also write what instances are, in files beside OUT.glb: hm3d, as Habitat loads them
        #[arg(long, value_name = "LAYOUT", hide_possible_values = true)]
        semantics: Option<Semantics>,
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
    #[command(arg(crate::args::data_option()))]
    /// Draw a scene: each storey from above, and views from inside its rooms
    Preview(super::scene_preview::Options),
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

/// A scene, and the furniture of one that is grown.
#[derive(Debug, Args)]
pub struct Furnished {
    /// The scene
    #[command(flatten)]
    choice: Choice,
    /// Which furniture a house from a seed shows: train, validation or test
    #[arg(long, default_value = "train", value_parser = pool)]
    pool: Pool,
}

impl Furnished {
    /// Reads or grows the scene.
    pub(super) fn load(&self) -> Result<Scene, Failure> {
        load_from(&self.choice, self.pool)
    }

    /// The house of `seed`.
    #[cfg(test)]
    pub(super) fn grown(seed: u64) -> Self {
        Self { choice: Choice { scene: None, seed: Some(seed) }, pool: Pool::default() }
    }
}

fn pool(name: &str) -> Result<Pool, String> {
    Pool::from_name(name).ok_or_else(|| format!("no pool is called `{name}`; use train, validation or test"))
}

/// Carries out a command about scenes.
///
/// # Errors
/// When the scene cannot be read or the file cannot be written.
pub fn run(data: &Path, command: Command) -> Result<(), Failure> {
    match command {
        Command::Export { scene, out, semantics } => export(&load(&scene)?, &out, semantics),
        Command::Import(options) => scene_import::run(&options),
        Command::Stats(options) => super::scene_stats::run(&options),
        Command::Info { scene } => {
            print_info(&load(&scene)?);
            Ok(())
        }
        Command::Preview(options) => super::scene_preview::run(data, &options),
    }
}

fn load(choice: &Choice) -> Result<Scene, Failure> {
    load_from(choice, Pool::default())
}

/// The scene of `choice`; a house from a seed shows the furniture of `pool`.
fn load_from(choice: &Choice, pool: Pool) -> Result<Scene, Failure> {
    match (&choice.scene, choice.seed) {
        (Some(path), _) => open::open(path).map_err(|error| Failure::new(FailureKind::Scene, error)),
        (None, seed) => {
            let seed = seed.unwrap_or_default();
            let options = avln_houses::HouseOptions { pool, ..Default::default() };
            Ok(avln_houses::house(&format!("house-{seed}"), seed, &options))
        }
    }
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
