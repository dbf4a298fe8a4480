//! Missions of other data sets, and ours as the authors of LH-AVLN store theirs.
//!
//! [`read`] takes the bytes of one file, packed or plain, to [`Foreign`] episodes; [`Adopter`] finds their goals in an
//! opened scene and makes missions of ours; what cannot be taken over is a [`Loss`], never silence.
//! [`authors_index`] and [`authors_scene`] go the other way; [`Tables`] are for those who read neither.

mod adopt;
mod authors;
mod error;
mod export;
mod foreign;
mod habitat;
mod json;
mod matching;
mod pack;
mod parquet;
mod shared;
mod tables;
mod tours;

pub use adopt::{Adopted, Adopter, MAX_GOALS};
pub use error::FormatsError;
pub use export::{ExportedFile, Told, authors_index, authors_scene};
pub use foreign::{Foreign, ForeignCue, ForeignEpisode, ForeignGoal, ForeignInstance, Loss, Shot};
pub use tables::Tables;

use json::Cursor;

/// A format of another data set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// LH-AVLN as its authors publish it.
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
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::Authors, Self::Goat, Self::ObjectNav, Self::InstanceImageNav, Self::MultiOn];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Authors => "authors",
            Self::Goat => "goat",
            Self::ObjectNav => "objectnav",
            Self::InstanceImageNav => "instanceimagenav",
            Self::MultiOn => "multion",
        }
    }

    /// The format of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.name() == name)
    }

    /// What a file holds, by its keys.
    fn recognise(root: &Cursor) -> Option<Self> {
        let first = root.find("episodes").and_then(|episodes| episodes.list().ok()?.into_iter().next());
        let has = |key: &str| root.find(key).is_some();
        let episode_has = |key: &str| first.as_ref().is_some_and(|first| first.find(key).is_some());
        let is_lhavln = |name: &str| name.starts_with("omni_long") || name.contains("instance_trajectory");
        let named = root.find("dataset").is_some_and(|name| name.text().is_ok_and(is_lhavln));
        if named || has("instances") || has("content_scenes_path") {
            Some(Self::Authors)
        } else if has("goals_by_category") {
            Some(Self::ObjectNav)
        } else if episode_has("goal_object_id") {
            Some(Self::InstanceImageNav)
        } else if episode_has("tasks") {
            Some(Self::Goat)
        } else if episode_has("goals") {
            Some(Self::MultiOn)
        } else {
            None
        }
    }
}

/// Reads one file, called `file` in messages; `format` is told by its keys where it is `None`. A split file that only
/// points to files of scenes holds no episodes.
///
/// # Errors
/// When the file is cut, is no JSON, of no known format, or holds what cannot be: wrong types, an id twice, numbers that
/// are not finite. The error names file, place and cause.
pub fn read(
    file: &str,
    bytes: &[u8],
    format: Option<Format>,
) -> Result<(Option<Format>, Foreign), FormatsError> {
    let value = pack::unpack(file, bytes)?;
    let root = Cursor::root(file, &value);
    if root.get("episodes")?.list()?.is_empty() {
        return Ok((format.or_else(|| Format::recognise(&root)), Foreign::default()));
    }
    let Some(format) = format.or_else(|| Format::recognise(&root)) else {
        let keys: Vec<&str> = root.entries()?.into_iter().map(|(key, _)| key).take(8).collect();
        let known = Format::ALL.map(Format::name).join(", ");
        return Err(FormatsError::Unknown { file: file.to_owned(), keys: keys.join(", "), known });
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
