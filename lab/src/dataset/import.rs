//! Mission import from other data sets.

use avln_arena::dataset::{DatasetFiles, read, write_whole};
use avln_arena::{Failure, FailureKind};
use avln_dataset::{EpisodeSpec, SceneSource, SceneSpec, Split};
use avln_episode::Rules;
use avln_interchange::{self as interchange, ForeignEpisode, ForeignFile, Format, Importer, Loss};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Folder levels in the search for files.
const DEPTH: usize = 4;
const MAX_FILES: usize = 100_000;

/// An import's source and target.
#[derive(Clone, Debug)]
pub struct Import<'a> {
    /// Format; `None` to detect the format of every file.
    pub format: Option<Format>,
    /// Data set file or folder.
    pub source: &'a Path,
    /// Scene folder.
    pub scenes: &'a Path,
    /// Output folder.
    pub out: &'a Path,
    /// New split's name.
    pub split: &'a str,
    /// Rules for success regions and reference paths.
    pub rules: &'a Rules,
    /// Episode seed.
    pub seed: u64,
}

/// An import's counts and losses.
#[derive(Clone, Debug, Default)]
pub struct Account {
    /// Files read.
    pub files: usize,
    /// Episodes read.
    pub episodes: usize,
    /// Missions written.
    pub missions: usize,
    /// Scenes with missions.
    pub scenes: usize,
    /// Rejected goals and episodes.
    pub losses: Vec<Loss>,
    /// Conversions, with counts.
    pub notes: BTreeMap<String, usize>,
}

type Scenes = BTreeMap<String, Vec<ForeignEpisode>>;

impl Import<'_> {
    /// Converts the data set; calls `on_scene` before every scene.
    ///
    /// # Errors
    /// If a file is malformed, no episode is usable, or the data set cannot be written.
    pub fn run(&self, on_scene: impl Fn(&str)) -> Result<Account, Failure> {
        let mut account = Account::default();
        let scenes = self.read_all(&mut account)?;
        let mut split = Split::new(self.split, self.rules);
        for (name, episodes) in &scenes {
            on_scene(name);
            match self.convert(name, episodes, &mut account) {
                Ok((spec, missions)) if !missions.is_empty() => {
                    split.scenes.push(spec);
                    split.episodes.extend(missions);
                }
                Ok(_) => {}
                Err(reason) => {
                    let lost = episodes.iter().map(|episode| Loss::episode(episode, reason.clone()));
                    account.losses.extend(lost);
                }
            }
        }
        account.scenes = split.scenes.len();
        account.missions = split.episodes.len();
        self.write_report(&account)?;
        if split.episodes.is_empty() {
            let message = format!("no episode of {} is usable", self.source.display());
            let hint = format!("{} lists the reasons", self.report_path().display());
            return Err(Failure::new(FailureKind::Scene, message).hinted(hint));
        }
        DatasetFiles::at(self.out).write_split(&split, None)?;
        Ok(account)
    }

    /// Returns the path to the report with all losses.
    pub fn report_path(&self) -> PathBuf {
        self.out.join("import.txt")
    }

    fn read_all(&self, account: &mut Account) -> Result<Scenes, Failure> {
        let mut scenes = Scenes::new();
        let mut ids = BTreeSet::new();
        for path in files(self.source)? {
            let bytes = read(&path)?;
            let read = interchange::read(&path.display().to_string(), &bytes, self.format);
            let (_, foreign) = read.map_err(|error| Failure::new(FailureKind::Scene, error))?;
            let ForeignFile { episodes, losses, notes } = foreign;
            account.files += 1;
            account.episodes += episodes.len();
            account.losses.extend(losses);
            notes.into_iter().for_each(|(note, times)| *account.notes.entry(note).or_default() += times);
            for episode in episodes {
                if ids.insert((episode.scene.clone(), episode.id.clone())) {
                    scenes.entry(episode.scene.clone()).or_default().push(episode);
                } else {
                    account.losses.push(Loss::episode(&episode, "another file has an episode with this id"));
                }
            }
        }
        Ok(scenes)
    }

    fn convert(
        &self,
        name: &str,
        episodes: &[ForeignEpisode],
        account: &mut Account,
    ) -> Result<(SceneSpec, Vec<EpisodeSpec>), String> {
        let stated = episodes.first().map_or("", |episode| episode.scene_path.as_str());
        let path = locate(self.scenes, name, stated)
            .ok_or_else(|| format!("cannot find scene {name} in {}", self.scenes.display()))?;
        let source = SceneSource::File { path };
        let (spec, _) = SceneSpec::new(name, source).map_err(|error| error.to_string())?;
        let assets = spec.open(self.rules).map_err(|error| error.to_string())?;
        let mut importer = Importer::new(&assets, self.rules, self.seed);
        let mut missions = Vec::new();
        for episode in episodes {
            let imported = importer.import(episode);
            missions.extend(imported.episode);
            account.losses.extend(imported.losses);
            imported.notes.into_iter().for_each(|note| *account.notes.entry(note).or_default() += 1);
        }
        Ok((spec, missions))
    }

    fn write_report(&self, account: &Account) -> Result<(), Failure> {
        let mut text = String::new();
        account.notes.iter().for_each(|(note, times)| text.push_str(&format!("{times} x {note}\n")));
        account.losses.iter().for_each(|loss| text.push_str(&format!("{loss}\n")));
        write_whole(&self.report_path(), text.as_bytes())
    }
}

/// Returns a data set's files by name: a file and the folder `content`, or all packed and trajectory files below a folder.
fn files(source: &Path) -> Result<Vec<PathBuf>, Failure> {
    let mut found = Vec::new();
    if source.is_dir() {
        collect(source, DEPTH, &mut found)?;
    } else {
        let content = source.parent().unwrap_or(Path::new(".")).join("content");
        found.push(source.to_owned());
        if content.is_dir() {
            collect(&content, 1, &mut found)?;
        }
    }
    if found.is_empty() {
        let message = format!("{} contains no data set files", source.display());
        return Err(Failure::new(FailureKind::Scene, message)
            .hinted("name a .json or .json.gz file, or a folder with .json.gz files"));
    }
    Ok(found)
}

fn collect(folder: &Path, depth: usize, found: &mut Vec<PathBuf>) -> Result<(), Failure> {
    let entries = std::fs::read_dir(folder).map_err(|error| Failure::file("read", folder, error))?;
    let mut paths: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.sort();
    for path in paths {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if path.is_dir() && depth > 0 {
            collect(&path, depth - 1, found)?;
        } else if (name.ends_with(".json.gz") || name == "trajectory_dataset.json") && found.len() < MAX_FILES
        {
            found.push(path);
        }
    }
    Ok(())
}

/// Finds the scene with the path `stated` in a data set: a folder with the scene's name, else a file.
fn locate(scenes: &Path, name: &str, stated: &str) -> Option<PathBuf> {
    // Parts like `..` are dropped: a data set must not reach files outside the scene folder.
    let plain = |part: &&str| !part.is_empty() && *part != "." && *part != "..";
    let parts: Vec<&str> = stated.split(['/', '\\']).filter(plain).collect();
    // The data set's root differs from machine to machine: every ending of the path is tried, longest first.
    let endings = (0..parts.len()).map(|from| parts[from..].iter().collect::<PathBuf>());
    let mut places: Vec<PathBuf> = Vec::new();
    for ending in endings {
        let folder = ending.parent().filter(|folder| folder.ends_with(name));
        places.extend(folder.map(Path::to_owned));
        places.push(ending);
    }
    places.extend([PathBuf::from(name), PathBuf::from(format!("{name}.glb"))]);
    places.into_iter().map(|place| scenes.join(place)).find(|path| path.exists())?.canonicalize().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_are_found_inside_the_folder_only() {
        let root = tempfile::tempdir().unwrap();
        let make = |path: &str| {
            let path = root.path().join("scenes").join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, b"").unwrap();
        };
        make("mp3d/17D/17D.glb");
        make("val/00800-TEE/TEE.basis.glb");
        make("Adrian.glb");
        std::fs::write(root.path().join("secret.glb"), b"").unwrap();
        let scenes = root.path().join("scenes");
        let found = |name: &str, stated: &str| {
            let path = locate(&scenes, name, stated)?;
            Some(path.strip_prefix(scenes.canonicalize().unwrap()).unwrap().display().to_string())
        };
        assert_eq!(found("17D", "data/scene_datasets/mp3d/17D/17D.glb").as_deref(), Some("mp3d/17D"));
        assert_eq!(found("00800-TEE", "hm3d/val/00800-TEE/TEE.basis.glb").as_deref(), Some("val/00800-TEE"));
        assert_eq!(found("Adrian", "gibson/Adrian.glb").as_deref(), Some("Adrian.glb"));
        assert_eq!(found("secret", "../secret.glb"), None);
        assert_eq!(found("other", "other/other.glb"), None);
    }
}
