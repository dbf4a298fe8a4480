//! Foreign episodes, and errors in foreign files.

use avln_geom::{Aabb, Point3, Pose};
use std::collections::BTreeMap;

/// Error while reading or writing a foreign file, with file and cause.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct InterchangeError(pub(crate) String);

impl InterchangeError {
    pub(crate) fn malformed(file: &str, place: &str, cause: &str) -> Self {
        Self(format!("{file}, at {place}: {cause}"))
    }

    pub(crate) fn unwritable(file: &str, cause: &impl std::fmt::Display) -> Self {
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

impl std::fmt::Display for Loss {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
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
