//! Data sets in other formats: import of foreign missions, export of ours.
//!
//! [`read`] parses a file, gzip or plain, to [`ForeignEpisode`]s; [`Importer`] finds the goals in an opened
//! scene and makes missions. Goals that cannot be imported are reported as [`Loss`]es.
//! [`authors_index`] and [`authors_scene`] write the layout of the LH-AVLN authors, [`Tables`] (feature `tables`) write Parquet.
//!
//! This crate never touches a disk or writes ground truth into a public export.

mod authors;
mod authors_export;
mod foreign;
mod habitat;
mod importer;
mod json;
#[cfg(feature = "tables")]
mod tables;

pub use authors_export::{ExportedFile, SceneMissions, authors_index, authors_scene};
pub use foreign::{
    ForeignCue, ForeignEpisode, ForeignFile, ForeignGoal, ForeignInstance, ForeignView, InterchangeError,
    Loss,
};
pub use importer::{Imported, Importer, MAX_GOALS};
#[cfg(feature = "tables")]
pub use tables::Tables;

use json::Cursor;

/// Foreign data set format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// LH-AVLN as published by the authors.
    Authors,
    /// GOAT-Bench.
    Goat,
    /// ObjectNav of Habitat, for HM3D and MP3D.
    ObjectNav,
    /// InstanceImageNav of Habitat.
    InstanceImageNav,
    /// MultiON.
    MultiOn,
}

impl Format {
    /// All formats.
    pub const ALL: [Self; 5] =
        [Self::Authors, Self::Goat, Self::ObjectNav, Self::InstanceImageNav, Self::MultiOn];

    /// Returns the name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Authors => "authors",
            Self::Goat => "goat",
            Self::ObjectNav => "objectnav",
            Self::InstanceImageNav => "instanceimagenav",
            Self::MultiOn => "multion",
        }
    }

    /// Returns the format with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.name() == name)
    }

    /// Recognises the format by the file's keys.
    fn recognise(root: &Cursor) -> Option<Self> {
        let first = root.find("episodes").and_then(|episodes| episodes.list().ok()?.into_iter().next());
        let has = |key: &str| root.find(key).is_some();
        let episode_has = |key: &str| first.as_ref().is_some_and(|first| first.find(key).is_some());
        let is_lhavln = |name: &str| name.starts_with("omni_long") || name.contains("instance_trajectory");
        let named = root.find("dataset").is_some_and(|name| name.text().is_ok_and(is_lhavln));
        // From the most specific key to the least: all formats have `episodes`, and several have `goals`.
        let signs = [
            (named || has("instances") || has("content_scenes_path"), Self::Authors),
            (has("goals_by_category"), Self::ObjectNav),
            (episode_has("goal_object_id"), Self::InstanceImageNav),
            (episode_has("tasks"), Self::Goat),
            (episode_has("goals"), Self::MultiOn),
        ];
        signs.into_iter().find_map(|(is_there, format)| is_there.then_some(format))
    }
}

/// Parses a file, named `file` in errors. Without a `format` the keys decide. An index file, which only refers to scene
/// files, has no episodes.
///
/// # Errors
/// If the file is truncated, is not JSON, has no known format, or has malformed values: wrong types, duplicate ids,
/// numbers that are not finite. The error names file, place and cause.
pub fn read(
    file: &str,
    bytes: &[u8],
    format: Option<Format>,
) -> Result<(Option<Format>, ForeignFile), InterchangeError> {
    let value = json::unpack(file, bytes)?;
    let root = Cursor::root(file, &value);
    if root.get("episodes")?.list()?.is_empty() {
        return Ok((format.or_else(|| Format::recognise(&root)), ForeignFile::default()));
    }
    let Some(format) = format.or_else(|| Format::recognise(&root)) else {
        let keys: Vec<&str> = root.entries()?.into_iter().map(|(key, _)| key).take(8).collect();
        let (keys, known) = (keys.join(", "), Format::ALL.map(Format::name).join(", "));
        return Err(InterchangeError(format!(
            "{file} has no known format: its keys are {keys}; name the format if it is one of {known}"
        )));
    };
    let foreign = match format {
        Format::Authors => authors::read(&root),
        Format::Goat => habitat::goat(&root),
        Format::ObjectNav => habitat::object_nav(&root),
        Format::InstanceImageNav => habitat::image_nav(&root),
        Format::MultiOn => habitat::multi_on(&root),
    }?;
    Ok((Some(format), foreign))
}
