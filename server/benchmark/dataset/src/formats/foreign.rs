use avln_geom::{Aabb, Point3, Pose};
use std::collections::BTreeMap;

/// What was read from one file of another data set.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Foreign {
    /// Its episodes, in the order of the file.
    pub episodes: Vec<ForeignEpisode>,
    /// What could not be read as a goal of ours.
    pub losses: Vec<Loss>,
    /// What was done how often on the way, for example which list of views was used.
    pub notes: BTreeMap<String, usize>,
}

/// An episode of another data set.
#[derive(Clone, Debug, PartialEq)]
pub struct ForeignEpisode {
    /// Its id there, unique within its scene.
    pub id: String,
    /// Name of the scene: the folder or the stem of its file.
    pub scene: String,
    /// The scene file as the data set names it.
    pub scene_path: String,
    /// Where the body starts.
    pub start: Pose,
    /// The goals, in their order.
    pub goals: Vec<ForeignGoal>,
    /// Reference lengths that the file states, ordered and unordered, metres.
    pub stated_m: [Option<f64>; 2],
}

/// A goal of another data set.
#[derive(Clone, Debug, PartialEq)]
pub struct ForeignGoal {
    /// What the data set calls it, for reports.
    pub name: String,
    /// The instances that complete it; several where any of a category will do.
    pub instances: Vec<ForeignInstance>,
    /// How the agent is told.
    pub cue: ForeignCue,
}

/// An instance of another data set.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ForeignInstance {
    /// Its number in the semantic layer of the scene.
    pub id: Option<u32>,
    /// Its category in the words of the data set.
    pub category: String,
    /// Its middle.
    pub center: Option<Point3<f32>>,
    /// The box around it.
    pub bounds: Option<Aabb>,
    /// Where bodies stood that saw it.
    pub viewpoints: Vec<Pose>,
}

/// How a goal of another data set is told.
#[derive(Clone, Debug, PartialEq)]
pub enum ForeignCue {
    /// By its category.
    Category,
    /// By a sentence.
    Description(String),
    /// By a picture.
    Image(Shot),
}

/// Where a picture was taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shot {
    /// The camera itself, not the base of a body.
    pub eye: Point3<f32>,
    /// Where it looks, as in [`Pose`].
    pub heading_rad: f32,
    /// How far it looks up, radians.
    pub pitch_rad: f32,
    /// Horizontal field of view, radians.
    pub hfov_rad: f32,
}

/// Something that could not be taken over.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Loss {
    /// Its scene.
    pub scene: String,
    /// Its episode.
    pub episode: String,
    /// The goal; the whole episode when empty.
    pub goal: String,
    /// Why.
    pub reason: String,
}

impl Foreign {
    pub(super) fn note(&mut self, what: &str) {
        *self.notes.entry(what.to_owned()).or_default() += 1;
    }
}

impl Loss {
    pub(super) fn goal(episode: &ForeignEpisode, goal: &str, reason: impl Into<String>) -> Self {
        let (scene, episode) = (episode.scene.clone(), episode.id.clone());
        Self { scene, episode, goal: goal.to_owned(), reason: reason.into() }
    }

    /// A whole episode that was lost.
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

/// Name of the scene that a path means: the folder that it lies in, else the file without its endings.
pub(super) fn scene_name(path: &str) -> String {
    let mut parts = path.rsplit(['/', '\\']).filter(|part| !part.is_empty());
    let file = parts.next().unwrap_or_default();
    let folder = parts.next().unwrap_or_default();
    let stem = file.split('.').next().unwrap_or_default();
    // Folders of HM3D are `00800-TEEsavR23oF`, those of MP3D are named as the file is; others say nothing.
    if !folder.is_empty() && !stem.is_empty() && folder.ends_with(stem) { folder } else { stem }.to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_are_named_by_folder_or_file() {
        assert_eq!(scene_name("data/scene_datasets/mp3d/17DRP5sb8fy/17DRP5sb8fy.glb"), "17DRP5sb8fy");
        assert_eq!(scene_name("hm3d/val/00800-TEEsavR23oF/TEEsavR23oF.basis.glb"), "00800-TEEsavR23oF");
        assert_eq!(scene_name("gibson/Adrian.glb"), "Adrian");
        assert_eq!((scene_name("house.glb").as_str(), scene_name("").as_str()), ("house", ""));
    }
}
