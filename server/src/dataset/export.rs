//! Our data sets as others read them.

use super::{DatasetFiles, SplitFolder, files::write_whole};
use crate::{Failure, FailureKind};
use avln_dataset::{EpisodeSpec, formats::write_authors};
use avln_episode::Rules;
use std::path::Path;

/// Writes a split of the data set in `folder`, all splits where `split` is `None`, as the authors of LH-AVLN publish
/// theirs; gives back how many missions were written.
///
/// # Errors
/// When the data set cannot be read or `out` cannot be written.
pub fn export_authors(folder: &Path, split: Option<&str>, out: &Path) -> Result<usize, Failure> {
    let splits = DatasetFiles::at(folder).manifest()?.splits;
    let names: Vec<String> = match split {
        Some(split) => vec![split.to_owned()],
        None => splits.into_iter().map(|line| line.name).collect(),
    };
    let mut missions = 0;
    for name in &names {
        missions += export_split(&SplitFolder::open(folder, name)?, name, out)?;
    }
    Ok(missions)
}

fn export_split(split: &SplitFolder, name: &str, out: &Path) -> Result<usize, Failure> {
    let rules = Rules::named(split.rules()).map_err(|error| Failure::new(FailureKind::Scene, error))?;
    let loaded = split.load()?;
    let of_scene = |scene: &str| -> Vec<EpisodeSpec> {
        loaded.episodes.iter().filter(|episode| episode.scene == scene).cloned().collect()
    };
    let scenes: Vec<(&str, Vec<EpisodeSpec>)> =
        loaded.scenes.iter().map(|scene| (scene.name.as_str(), of_scene(&scene.name))).collect();
    let borrowed: Vec<(&str, &[EpisodeSpec])> =
        scenes.iter().map(|(scene, episodes)| (*scene, episodes.as_slice())).collect();
    let files =
        write_authors(name, &borrowed, &rules).map_err(|error| Failure::new(FailureKind::Data, error))?;
    files.iter().try_for_each(|file| write_whole(&out.join(&file.path), &file.bytes))?;
    Ok(loaded.episodes.len())
}
