//! Data sets on disk: files, plain or sealed. [`SplitFolder`] reads a split scene by scene.

use crate::{Failure, private_file};
use avln_dataset::{
    BuiltScene, DatasetError, FormatError, Manifest, Recipe, SceneLine, SecretFile, Split, SplitLine,
    Statistics,
    format::{
        DATASET_VERSION, File, digest_of, manifest_bytes, read_manifest, read_scenes, read_secret,
        scenes_bytes, write_scene,
    },
};
use seal::{Keyring, Salt};
use std::{
    collections::BTreeMap,
    fs::OpenOptions,
    io::{Read, Write},
    path::{Path, PathBuf},
};

mod seal;
mod split;

pub use seal::Passphrase;
pub use split::{KnownSeed, SplitFolder};

/// Largest file, bytes: a scene's missions take some megabytes.
const MAX_FILE_BYTES: u64 = 1 << 30;

/// Data set files.
#[derive(Clone, Debug)]
pub struct DatasetFiles {
    root: PathBuf,
}

impl DatasetFiles {
    /// Opens the data set in `root`, existing or not.
    pub fn at(root: &Path) -> Self {
        Self { root: root.to_owned() }
    }

    /// Returns the folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Returns the manifest path.
    pub fn manifest_path(&self) -> PathBuf {
        self.root.join("dataset.json")
    }

    /// Returns the scene list path.
    pub fn scenes_path(&self, split: &str) -> PathBuf {
        self.root.join(split).join("scenes.jsonl")
    }

    /// Returns the path to a scene's public missions.
    pub fn missions_path(&self, split: &str, scene: &str) -> PathBuf {
        self.root.join(split).join("missions").join(format!("{scene}.jsonl"))
    }

    /// Returns the path to a scene's ground truth.
    pub fn sealed_path(&self, split: &str, scene: &str) -> PathBuf {
        self.root.join(split).join("sealed").join(format!("{scene}.jsonl"))
    }

    /// Returns the path to a secret split's seed.
    pub fn secret_path(&self, split: &str) -> PathBuf {
        self.root.join(split).join("sealed").join("seed.json")
    }

    /// Returns true for a complete data set.
    pub fn is_complete(&self) -> bool {
        self.manifest_path().is_file()
    }

    /// Reads the manifest.
    pub fn manifest(&self) -> Result<Manifest, Failure> {
        let path = self.manifest_path();
        let bytes = read(&path).map_err(|failure| {
            failure.hinted("build a data set there with: avln data dataset build CONFIG --out FOLDER")
        })?;
        parsed(&path, &bytes, read_manifest)
    }

    /// Reads a scene list.
    pub fn scenes(&self, split: &SplitLine) -> Result<Vec<SceneLine>, Failure> {
        check_plain(&split.name)?;
        self.scenes_in(split, &read(&self.scenes_path(&split.name))?)
    }

    fn scenes_in(&self, split: &SplitLine, bytes: &[u8]) -> Result<Vec<SceneLine>, Failure> {
        let path = self.scenes_path(&split.name);
        let scenes = parsed(&path, bytes, |file| read_scenes(file, &split.digest))?;
        scenes.iter().try_for_each(|scene| check_plain(&scene.name))?;
        Ok(scenes)
    }

    /// Reads a secret split's seed; `None` for other splits.
    pub fn secret(&self, split: &str) -> Result<Option<SecretFile>, Failure> {
        check_plain(split)?;
        let path = self.secret_path(split);
        if !path.is_file() {
            return Ok(None);
        }
        parsed(&path, &read(&path)?, read_secret).map(Some)
    }

    /// Writes a secret split's seed.
    pub fn write_secret(&self, split: &str, secret: &SecretFile) -> Result<(), Failure> {
        let json = serde_json::to_vec_pretty(secret).map_err(Failure::internal)?;
        write_private(&self.secret_path(split), &json)
    }

    /// Returns true if a split is sealed.
    pub fn is_sealed(&self, split: &str) -> Result<bool, Failure> {
        Ok(seal::is_sealed(&read_as_is(&self.scenes_path(split))?))
    }

    /// Writes a scene list; returns the split's manifest line.
    pub fn write_scenes(&self, split: &str, scenes: &[SceneLine]) -> Result<SplitLine, Failure> {
        let bytes = scenes_bytes(scenes)?;
        write_private(&self.scenes_path(split), &bytes)?;
        let missions = scenes.iter().map(|scene| scene.missions).sum();
        Ok(SplitLine { name: split.to_owned(), scenes: scenes.len(), missions, digest: digest_of(&bytes) })
    }

    /// Writes `dataset.json`.
    pub fn write_manifest(&self, manifest: &Manifest) -> Result<(), Failure> {
        write_whole(&self.manifest_path(), &manifest_bytes(manifest)?)
    }

    /// Writes the statistics as JSON and as a page; returns the page's path.
    pub fn write_statistics(&self, name: &str, splits: &[(String, Statistics)]) -> Result<PathBuf, Failure> {
        let numbers: BTreeMap<_, _> =
            splits.iter().map(|(split, numbers)| (split.as_str(), numbers)).collect();
        let json = serde_json::to_vec_pretty(&numbers).map_err(Failure::internal)?;
        write_whole(&self.root.join("statistics.json"), &json)?;
        let page = self.root.join("statistics.html");
        write_whole(&page, avln_dataset::page(name, splits).as_bytes())?;
        Ok(page)
    }

    fn missing(&self, split: &str) -> Failure {
        Failure::scene(format!("data set {} has no split '{split}'", self.root.display()))
    }

    /// Seals missions, truth and scene list in place. Sealed files stay; they need the same passphrase.
    pub fn seal(&self, split: &str, passphrase: Passphrase) -> Result<Sealed, Failure> {
        let manifest = self.manifest()?;
        let line = manifest.splits.iter().find(|line| line.name == split);
        let line = line.ok_or_else(|| self.missing(split))?;
        let (ring, salt) = (Keyring::new(Some(passphrase)), Salt::random()?);
        let list = self.scenes_path(split);
        let mut paths = Vec::new();
        for scene in self.scenes_in(line, &ring.open(&list, read_as_is(&list)?)?)? {
            paths.extend([self.missions_path(split, &scene.name), self.sealed_path(split, &scene.name)]);
        }
        paths.extend(Some(self.secret_path(split)).filter(|path| path.is_file()));
        paths.push(list);
        let mut sealed = Sealed::default();
        for path in paths {
            let bytes = read_as_is(&path)?;
            if seal::is_sealed(&bytes) {
                ring.open(&path, bytes)?;
                sealed.before += 1;
            } else {
                write_private(&path, &ring.seal(&salt, &path, &bytes)?)?;
                sealed.now += 1;
            }
        }
        Ok(sealed)
    }

    /// Writes a data set from the built scenes of every split in `recipe`.
    pub fn write_built(&self, recipe: &Recipe, splits: &[Vec<BuiltScene>]) -> Result<(), Failure> {
        for (split, scenes) in recipe.splits.iter().zip(splits) {
            if let Some(secret) = SecretFile::of(recipe, &split.name) {
                self.write_secret(&split.name, &secret)?;
            }
            scenes.iter().try_for_each(|scene| self.write_built_scene(&split.name, scene))?;
        }
        let lines = splits.iter().map(|scenes| scenes.iter().map(|scene| scene.line.clone()).collect());
        self.complete(recipe, lines.collect::<Vec<_>>().as_slice())
    }

    /// Writes the files of a built scene.
    pub fn write_built_scene(&self, split: &str, built: &BuiltScene) -> Result<(), Failure> {
        self.write_scene_files(split, &built.line.name, &built.missions, &built.sealed)
    }

    fn write_scene_files(
        &self,
        split: &str,
        scene: &str,
        missions: &[u8],
        sealed: &[u8],
    ) -> Result<(), Failure> {
        write_private(&self.missions_path(split, scene), missions)?;
        write_private(&self.sealed_path(split, scene), sealed)
    }

    /// Writes the scene lists and the manifest, which marks a data set as complete.
    pub fn complete(&self, recipe: &Recipe, splits: &[Vec<SceneLine>]) -> Result<(), Failure> {
        let named = recipe.splits.iter().zip(splits);
        let lines = named.map(|(split, scenes)| self.write_scenes(&split.name, scenes));
        self.write_manifest(&Manifest {
            format: Manifest::FORMAT.to_owned(),
            version: DATASET_VERSION,
            name: recipe.name.clone(),
            rules: recipe.rules.clone(),
            recipe: Some(recipe.clone()),
            seed: None,
            splits: lines.collect::<Result<_, _>>()?,
        })
    }

    /// Writes a split as a data set; `seed` is the number that its missions were drawn with.
    pub fn write_split(&self, split: &Split, seed: Option<u64>) -> Result<(), Failure> {
        let mut lines = Vec::new();
        for scene in &split.scenes {
            let episodes: Vec<_> =
                split.episodes.iter().filter(|episode| episode.scene == scene.name).cloned().collect();
            let written = write_scene(scene, None, &episodes)?;
            self.write_scene_files(&split.name, &scene.name, &written.missions, &written.sealed)?;
            lines.push(written.line);
        }
        let line = self.write_scenes(&split.name, &lines)?;
        self.write_manifest(&Manifest {
            format: Manifest::FORMAT.to_owned(),
            version: DATASET_VERSION,
            name: split.name.clone(),
            rules: split.rules.clone(),
            recipe: None,
            seed,
            splits: vec![line],
        })
    }
}

/// File counts after sealing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sealed {
    /// Newly sealed files.
    pub now: usize,
    /// Previously sealed files.
    pub before: usize,
}

/// Checks that a scene or split name can be a file name: up to 100 letters, digits, `-`, `_` and `.`.
pub fn check_plain(name: &str) -> Result<(), Failure> {
    let fits = |letter: char| letter.is_ascii_alphanumeric() || matches!(letter, '-' | '_' | '.');
    if (1..=100).contains(&name.len()) && name.chars().all(fits) && !name.starts_with('.') {
        return Ok(());
    }
    Err(Failure::scene(format!(
        "'{}' cannot be the name of a scene or split of a data set",
        name.escape_debug()
    )))
}

/// Reads a data set file; sealed files are decrypted in memory.
pub fn read(path: &Path) -> Result<Vec<u8>, Failure> {
    seal::opened(path, read_as_is(path)?)
}

/// Parses the contents of a data set file.
fn parsed<T>(
    path: &Path,
    bytes: &[u8],
    parse: impl FnOnce(File<'_>) -> Result<T, FormatError>,
) -> Result<T, Failure> {
    let name = path.display().to_string();
    Ok(parse(File { name: &name, bytes }).map_err(DatasetError::from)?)
}

/// Reads a file without decryption.
fn read_as_is(path: &Path) -> Result<Vec<u8>, Failure> {
    let mut bytes = Vec::new();
    // One byte beyond the limit is enough to detect a larger file.
    let limited = |file: std::fs::File| file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes);
    std::fs::File::open(path).and_then(limited).map_err(|error| Failure::file("read", path, error))?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        let message = format!("{} is larger than {MAX_FILE_BYTES} bytes", path.display());
        return Err(Failure::data(message));
    }
    Ok(bytes)
}

/// Writes a file under another name and renames it, so that it is always complete.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    write_file(path, bytes, OpenOptions::new())
}

/// Writes a file like [`write_whole`], accessible by its owner only.
fn write_private(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    write_file(path, bytes, private_file())
}

fn write_file(path: &Path, bytes: &[u8], mut options: OpenOptions) -> Result<(), Failure> {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".partial");
    let partial = path.with_file_name(name);
    let folder = path.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder)
        .and_then(|()| options.write(true).create(true).truncate(true).open(&partial))
        .and_then(|mut file| file.write_all(bytes))
        .and_then(|()| std::fs::rename(&partial, path))
        .map_err(|error| Failure::file("write", path, error))
}
