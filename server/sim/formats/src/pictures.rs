//! Pictures that a file names, each read once.

use crate::files::Checked;
use crate::glb::{checker, decode_picture, neighbour};
use crate::{Report, files};
use avln_scene::Texture;
use avln_scene::limits::MAX_FILE_BYTES;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// The pictures of one scene, in the order in which they were asked for.
pub(crate) struct Pictures {
    folder: PathBuf,
    textures: Vec<Texture>,
    number_of: BTreeMap<String, u16>,
    texels_left: u64,
}

impl Pictures {
    /// Pictures lie in `folder` or below; `texels` is what all may hold together.
    pub(crate) fn new(folder: impl Into<PathBuf>, texels: u64) -> Self {
        Self { folder: folder.into(), textures: Vec::new(), number_of: BTreeMap::new(), texels_left: texels }
    }

    /// The number of the picture called `name`. A checker stands in for one that cannot be shown, and a warning says why.
    pub(crate) fn number(&mut self, name: &str, report: &mut Report) -> Checked<u16> {
        if let Some(&known) = self.number_of.get(name) {
            return Ok(known);
        }
        let texture = self.load(name, report).unwrap_or_else(|reason| {
            report.warn(format!("texture {name:?} is not shown, a checker is in its place: {reason}"));
            checker()
        });
        let number = u16::try_from(self.textures.len())
            .map_err(|_| "it uses more than 65536 textures; merge some of them")?;
        self.textures.push(texture);
        self.number_of.insert(name.to_owned(), number);
        Ok(number)
    }

    /// All pictures by their numbers.
    pub(crate) fn into_textures(self) -> Vec<Texture> {
        self.textures
    }

    fn load(&mut self, name: &str, report: &mut Report) -> Checked<Texture> {
        let path = neighbour(&self.folder, &name.replace('\\', "/"))?;
        let bytes = files::read(&path, MAX_FILE_BYTES, report).map_err(|error| error.to_string())?;
        decode_picture(&bytes, &mut self.texels_left)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_picture_is_a_visible_checker_and_one_warning() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("bad.png"), "no picture").unwrap();
        let mut pictures = Pictures::new(folder.path(), 1 << 20);
        let mut report = Report::default();
        let numbers = ["absent.png", "bad.png", "absent.png", "../outside.png"]
            .map(|name| pictures.number(name, &mut report).unwrap());
        assert_eq!(numbers, [0, 1, 0, 2]);
        assert_eq!(report.warnings.len(), 3, "{report:?}");
        assert!(report.warnings[0].contains("\"absent.png\"") && report.warnings[0].contains("checker"));
        assert_eq!(pictures.into_textures()[0], checker());
    }
}
