use avln_arena::{Failure, FailureKind};
use avln_lab::npy;
use avln_lab::preview::Picture;
use avln_render::Frame;
use std::fmt::Display;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// Where the parts of a picture go.
pub(super) struct Files {
    pub(super) rgb: Option<PathBuf>,
    pub(super) depth: Option<PathBuf>,
    pub(super) ids: Option<PathBuf>,
}

impl Files {
    /// All parts of the picture called `number`.
    pub(super) fn numbered(folder: &Path, number: &str) -> Self {
        let file = |ending: &str| Some(folder.join(format!("{number}.{ending}")));
        Self { rgb: file("rgb.png"), depth: file("depth.npy"), ids: file("ids.npy") }
    }

    pub(super) fn paths(&self) -> impl Iterator<Item = &Path> {
        [&self.rgb, &self.depth, &self.ids].into_iter().filter_map(Option::as_deref)
    }

    pub(super) fn write(&self, frame: Frame) -> Result<(), Failure> {
        let shape = [frame.height, frame.width];
        if let Some(path) = &self.depth {
            written(path, |out| npy::write(out, shape, frame.depth.iter().copied()))?;
        }
        if let Some(path) = &self.ids {
            written(path, |out| npy::write(out, shape, frame.instances.iter().map(|id| id.0)))?;
        }
        match &self.rgb {
            Some(path) => written(path, |out| Picture::of(String::new(), frame).write_png(out)),
            None => Ok(()),
        }
    }
}

/// Makes the file at `path` and lets `fill` write it.
fn written<E: Display>(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<File>) -> Result<(), E>,
) -> Result<(), Failure> {
    let mut out = BufWriter::new(File::create(path).map_err(|error| unwritten(path, error))?);
    fill(&mut out).map_err(|error| unwritten(path, error))?;
    out.flush().map_err(|error| unwritten(path, error))
}

pub(super) fn unwritten(path: &Path, error: impl Display) -> Failure {
    Failure::new(FailureKind::Data, format!("cannot write {}: {error}", path.display()))
        .hinted("choose a place that exists and can be written")
}
