//! Data sets in other formats: import of foreign missions, export of ours.
//!
//! [`read`] parses a file, gzip or plain, to [`ForeignEpisode`]s; [`Importer`] finds the goals in an opened
//! scene and makes missions. Goals that cannot be imported are reported as [`Loss`]es.
//! [`authors_index`] and [`authors_scene`] write the layout of the LH-AVLN authors, [`Tables`] (feature `tables`) write Parquet.
//!
//! This crate never touches a disk or writes ground truth into a public export.

mod authors;
mod authors_export;
mod habitat;
mod importer;
mod json;
#[cfg(feature = "tables")]
mod tables;

pub use authors_export::{ExportedFile, SceneMissions, authors_index, authors_scene};
pub use importer::{Imported, Importer, MAX_GOALS};
#[cfg(feature = "tables")]
pub use tables::Tables;

use avln_geom::{Aabb, Point3, Pose};
use json::Cursor;
use std::{collections::BTreeMap, fmt};

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

/// Error while reading or writing a foreign file, with file and cause.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct InterchangeError(pub(crate) String);

impl InterchangeError {
    pub(crate) fn malformed(file: &str, place: &str, cause: &str) -> Self {
        Self(format!("{file}, at {place}: {cause}"))
    }

    pub(crate) fn unwritable(file: &str, cause: &impl fmt::Display) -> Self {
        Self(format!("cannot write {file}: {cause}"))
    }
}

/// Contents of a foreign file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ForeignFile {
    /// Episodes, in file order.
    pub episodes: Vec<ForeignEpisode>,
    /// Goals and episodes that cannot be read.
    pub losses: Vec<Loss>,
    /// Conversion notes with counts, for example the chosen view list.
    pub notes: BTreeMap<String, usize>,
}

/// Foreign episode.
#[derive(Clone, Debug, PartialEq)]
pub struct ForeignEpisode {
    /// Id, unique within the scene.
    pub id: String,
    /// Scene name: folder or file stem.
    pub scene: String,
    /// Stated path to the scene file.
    pub scene_path: String,
    /// Start pose.
    pub start: Pose,
    /// Goals in order.
    pub goals: Vec<ForeignGoal>,
    /// Stated reference lengths, ordered and unordered, metres.
    pub stated_m: [Option<f64>; 2],
}

/// Foreign goal.
#[derive(Clone, Debug, PartialEq)]
pub struct ForeignGoal {
    /// Name, for reports.
    pub name: String,
    /// Instances that complete the goal; several if any instance in a category does.
    pub instances: Vec<ForeignInstance>,
    /// Cue.
    pub cue: ForeignCue,
}

/// Foreign object instance.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ForeignInstance {
    /// Number in the scene's semantic layer.
    pub id: Option<u32>,
    /// Category name in the data set.
    pub category: String,
    /// Centre.
    pub center: Option<Point3<f32>>,
    /// Bounding box.
    pub bounds: Option<Aabb>,
    /// Poses with a view of the instance.
    pub viewpoints: Vec<Pose>,
}

/// Foreign goal cue.
#[derive(Clone, Debug, PartialEq)]
pub enum ForeignCue {
    /// Category.
    Category,
    /// Sentence.
    Description(String),
    /// Picture.
    Image(ForeignView),
}

/// Picture camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForeignView {
    /// Camera position, not the base.
    pub eye: Point3<f32>,
    /// Heading, as in [`Pose`].
    pub heading_rad: f32,
    /// Pitch, radians; positive is up.
    pub pitch_rad: f32,
    /// Horizontal field of view, radians.
    pub hfov_rad: f32,
}

/// Goal or episode that cannot be imported.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Loss {
    /// Scene.
    pub scene: String,
    /// Episode.
    pub episode: String,
    /// Goal; empty for a whole episode.
    pub goal: String,
    /// Reason.
    pub reason: String,
}

impl ForeignFile {
    pub(crate) fn note(&mut self, note: &str) {
        *self.notes.entry(note.to_owned()).or_default() += 1;
    }
}

impl Loss {
    pub(crate) fn goal(episode: &ForeignEpisode, goal: &str, reason: impl Into<String>) -> Self {
        Self {
            scene: episode.scene.clone(),
            episode: episode.id.clone(),
            goal: goal.to_owned(),
            reason: reason.into(),
        }
    }

    /// Returns the loss for a whole episode.
    pub fn episode(episode: &ForeignEpisode, reason: impl Into<String>) -> Self {
        Self::goal(episode, "", reason)
    }
}

impl fmt::Display for Loss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.scene, self.episode)?;
        if !self.goal.is_empty() {
            write!(f, ", goal {}", self.goal)?;
        }
        write!(f, ": {}", self.reason)
    }
}

/// Returns the scene name for a path: folder, or file name up to the first dot.
pub(crate) fn scene_name(path: &str) -> String {
    let mut parts = path.rsplit(['/', '\\']).filter(|part| !part.is_empty());
    let file = parts.next().unwrap_or_default();
    let folder = parts.next().unwrap_or_default();
    let stem = file.split('.').next().unwrap_or_default();
    // HM3D folders are `00800-TEEsavR23oF`, MP3D folders equal the file name; others are unrelated to the scene.
    if !folder.is_empty() && !stem.is_empty() && folder.ends_with(stem) { folder } else { stem }.to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scene_name_is_folder_or_file() {
        assert_eq!(scene_name("data/scene_datasets/mp3d/17DRP5sb8fy/17DRP5sb8fy.glb"), "17DRP5sb8fy");
        assert_eq!(scene_name("hm3d/val/00800-TEEsavR23oF/TEEsavR23oF.basis.glb"), "00800-TEEsavR23oF");
        assert_eq!(scene_name("gibson/Adrian.glb"), "Adrian");
        assert_eq!((scene_name("house.glb").as_str(), scene_name("").as_str()), ("house", ""));
    }
}
