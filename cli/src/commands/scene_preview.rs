//! Draws what a scene looks like, for people.

use super::scene::Furnished;
use crate::output::say;
use avln_arena::cache::CacheFolder;
use avln_arena::{Failure, FailureKind};
use avln_lab::preview::{Picture, Viewer, indoors, storeys};
use clap::Args;
use std::fmt::Display;
use std::path::{Path, PathBuf};

/// What to draw and where to.
#[derive(Debug, Args)]
pub struct Options {
    /// The scene to draw
    #[command(flatten)]
    scene: Furnished,
    /// The folder for the pictures; made if it does not exist
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Views from inside rooms
    #[arg(long, default_value_t = 8)]
    views: usize,
}

/// Draws each storey from above and some views from inside rooms, as PNG files.
///
/// # Errors
/// When the scene cannot be read or the folder cannot be written.
pub fn run(data: &Path, options: &Options) -> Result<(), Failure> {
    let scene = options.scene.load()?;
    std::fs::create_dir_all(&options.out).map_err(|error| unwritten(&options.out, error))?;
    let mut pictures = storeys(&scene);
    let name = scene.name.clone();
    pictures.extend(indoors(&Viewer::new(scene, CacheFolder::of_data(data)), options.views));
    for picture in &pictures {
        write(picture, &options.out.join(format!("{}.png", picture.name)))?;
    }
    let names: Vec<&str> = pictures.iter().map(|picture| picture.name.as_str()).collect();
    say!("{name}: {} pictures in {}: {}", pictures.len(), options.out.display(), names.join(" "));
    Ok(())
}

fn write(picture: &Picture, path: &Path) -> Result<(), Failure> {
    let file = std::fs::File::create(path).map_err(|error| unwritten(path, error))?;
    picture.write_png(std::io::BufWriter::new(file)).map_err(|error| unwritten(path, error))
}

fn unwritten(path: &Path, error: impl Display) -> Failure {
    Failure::new(FailureKind::Data, format!("cannot write {}: {error}", path.display()))
}
