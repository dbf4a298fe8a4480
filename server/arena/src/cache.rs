//! Disk cache for render models and sound sources, shared by runs and processes.

use crate::{Failure, ids};
use avln_render::{Model, ModelCache};
use avln_simd::Mapped;
use avln_world::{Cache, SoundCache};
use std::{
    fs::{self, File},
    io::{self, Write},
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::SystemTime,
};

/// Default size limit, GiB: a hundred scans, a thousand procedural houses or 3,500 sound sources.
const BUDGET_GIB: u32 = 4;

/// File with another limit, GiB in digits.
const LIMIT_FILE: &str = "limit_gib";

/// Hash prefix length in sound files, bytes. Models contain a hash.
const HASH_BYTES: usize = 32;

/// A folder with render models and sound sources. Files are never modified, but renamed into place.
pub struct CacheFolder {
    folder: PathBuf,
    budget_bytes: u64,
    /// True after the first warning about unwritable files.
    warned: AtomicBool,
}

impl CacheFolder {
    /// Cache path in a data folder.
    pub const IN_DATA: &str = "cache/scenes";

    /// Opens the cache in `folder`, created on first use, with the stored limit or 4 GiB.
    pub fn at(folder: &Path) -> Self {
        Self::with_budget(folder, u64::from(limit_gib(folder)) << 30)
    }

    /// Stores the limit for all programs that start later, GiB.
    pub fn limit(folder: &Path, gib: u32) -> Result<(), Failure> {
        let written =
            fs::create_dir_all(folder).and_then(|()| fs::write(folder.join(LIMIT_FILE), gib.to_string()));
        written.map_err(|error| {
            Failure::file("store the cache limit in", folder, error).hinted("add write permission")
        })
    }

    /// Returns the size limit, bytes.
    pub fn budget_bytes(&self) -> u64 {
        self.budget_bytes
    }

    /// Opens the cache with another limit.
    pub fn with_budget(folder: &Path, budget_bytes: u64) -> Self {
        Self { folder: folder.to_owned(), budget_bytes, warned: AtomicBool::new(false) }
    }

    /// Returns an existing data folder's cache. Commands with an optional cache create no folder.
    pub fn of_data(data: &Path) -> Option<Arc<dyn Cache>> {
        data.is_dir().then(|| Arc::new(Self::at(&data.join(Self::IN_DATA))) as Arc<dyn Cache>)
    }

    /// Returns the model path. Program versions have separate files.
    fn model_path(&self, name: &str) -> PathBuf {
        self.folder.join(format!("{name}-{}.model", Model::VERSION))
    }

    fn sound_path(&self, name: &str) -> PathBuf {
        self.folder.join(format!("{name}.sound"))
    }

    fn write(&self, path: &Path, bytes: u64, content: impl FnOnce(File) -> io::Result<()>) -> io::Result<()> {
        fs::create_dir_all(&self.folder)?;
        // Before the write: the folder must never exceed the limit.
        self.make_room(bytes)?;
        let random = ids::random_hex().map_err(io::Error::other)?;
        let unfinished = self.folder.join(format!("{random}.part"));
        let written =
            File::create_new(&unfinished).and_then(content).and_then(|()| fs::rename(&unfinished, path));
        if written.is_err() {
            let _ = fs::remove_file(&unfinished);
        }
        written
    }

    /// Deletes the least recently used files until `bytes` more fit.
    fn make_room(&self, bytes: u64) -> io::Result<()> {
        let mut files = self.files()?;
        let mut sum = files.iter().map(|file| file.bytes).sum::<u64>().saturating_add(bytes);
        files.sort();
        for file in files {
            if sum <= self.budget_bytes {
                break;
            }
            // Another process may have deleted it.
            let _ = fs::remove_file(&file.path);
            sum -= file.bytes;
        }
        Ok(())
    }

    /// Lists all cache files, including unfinished ones.
    fn files(&self) -> io::Result<Vec<CachedFile>> {
        let is_ours = |path: &PathBuf| {
            path.extension().is_some_and(|end| end == "model" || end == "sound" || end == "part")
        };
        let paths = fs::read_dir(&self.folder)?.filter_map(|entry| Some(entry.ok()?.path()));
        Ok(paths.filter(is_ours).filter_map(CachedFile::at).collect())
    }

    fn warn_once(&self, error: &io::Error) {
        if !self.warned.swap(true, Ordering::Relaxed) {
            let folder = self.folder.display();
            tracing::warn!(%folder, %error, "cannot store prepared scenes, so every start prepares them again; check write permission and free space");
        }
    }
}

fn limit_gib(folder: &Path) -> u32 {
    let path = folder.join(LIMIT_FILE);
    let Ok(text) = fs::read_to_string(&path) else { return BUDGET_GIB };
    text.trim().parse().unwrap_or_else(|error| {
        let file = path.display();
        tracing::warn!(%file, %error, "the file does not contain a number of GiB; the limit is {BUDGET_GIB}; set --cache-size");
        BUDGET_GIB
    })
}

/// A file, ordered by last use.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct CachedFile {
    used: SystemTime,
    path: PathBuf,
    bytes: u64,
}

impl CachedFile {
    /// Reads the metadata; `None` if another process has deleted the file.
    fn at(path: PathBuf) -> Option<Self> {
        let about = fs::metadata(&path).ok()?;
        Some(Self { used: about.modified().unwrap_or(SystemTime::UNIX_EPOCH), bytes: about.len(), path })
    }
}

impl ModelCache for CacheFolder {
    fn find(&self, name: &str) -> Option<Model> {
        let path = self.model_path(name);
        let read = match Mapped::open(&path) {
            Ok(bytes) => Model::read(bytes).map_err(|error| error.to_string()),
            Err(error) if error.kind() == io::ErrorKind::NotFound => return None,
            Err(error) => Err(error.to_string()),
        };
        read.inspect(|_| touch(&path)).inspect_err(|error| discard(&path, error)).ok()
    }

    fn keep(&self, name: &str, model: Model) -> Model {
        if model.byte_count() as u64 > self.budget_bytes {
            return model;
        }
        let (path, bytes) = (self.model_path(name), model.byte_count() as u64);
        let written = self.write(&path, bytes, |file| model.write(file));
        match written.and_then(|()| Mapped::open(&path)) {
            Ok(bytes) => Model::read(bytes).unwrap_or(model),
            Err(error) => {
                self.warn_once(&error);
                model
            }
        }
    }
}

impl SoundCache for CacheFolder {
    fn load_sound(&self, name: &str) -> Option<Vec<u8>> {
        let path = self.sound_path(name);
        let mut bytes = match fs::read(&path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return None,
            Err(error) => {
                discard(&path, &error.to_string());
                return None;
            }
        };
        let content = bytes.split_off(HASH_BYTES.min(bytes.len()));
        if blake3::hash(&content).as_bytes()[..] != bytes[..] {
            discard(&path, "the content does not fit its hash");
            return None;
        }
        touch(&path);
        Some(content)
    }

    fn store_sound(&self, name: &str, bytes: &[u8]) {
        let count = (HASH_BYTES + bytes.len()) as u64;
        if count > self.budget_bytes {
            return;
        }
        let content = |mut file: File| {
            file.write_all(blake3::hash(bytes).as_bytes())?;
            file.write_all(bytes)
        };
        if let Err(error) = self.write(&self.sound_path(name), count, content) {
            self.warn_once(&error);
        }
    }
}

/// Marks a file as used. After a failure it may be evicted earlier, which affects no result.
fn touch(path: &Path) {
    let _ = File::open(path).and_then(|file| file.set_modified(SystemTime::now()));
}

fn discard(path: &Path, error: &str) {
    let file = path.display();
    tracing::warn!(%file, %error, "cannot use a file in the cache; it is deleted and regenerated");
    let _ = fs::remove_file(path);
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_geom::{UnitQuaternion, angle};
    use avln_houses::{HouseOptions, house};
    use avln_scene::{Scene, digest::digest};
    use avln_world::{Body, Cached, Camera, CameraImage, SceneAssets};
    use std::{sync::LazyLock, time::Duration};
    use tempfile::TempDir;

    static HOUSE: LazyLock<Scene> = LazyLock::new(|| house("kept", 3, &HouseOptions::small()));
    /// Images from an uncached model.
    static PLAIN: LazyLock<Vec<Vec<u8>>> = LazyLock::new(|| pictures(None));

    fn folder() -> TempDir {
        TempDir::new().expect("a folder for temporary files")
    }

    fn cache(folder: &Path) -> Option<Arc<dyn Cache>> {
        Some(Arc::new(CacheFolder::at(folder)))
    }

    /// Renders four pictures and returns their bytes.
    fn pictures(cache: Option<Arc<dyn Cache>>) -> Vec<Vec<u8>> {
        let cached = cache.map(|cache| Cached { cache, name: digest(&HOUSE) });
        let assets = SceneAssets::prepare_cached(HOUSE.clone(), &Body::default(), cached).expect("a house");
        let middle = assets.scene.bounds().expect("walls").center();
        let eye = avln_geom::Point3::new(middle.x, 1.5, middle.z);
        let turned = (0..4).map(|turn| angle::about_up(turn as f32 * 1.6));
        let picture = |world_from_camera: UnitQuaternion<f32>| {
            let (width, height) = (64, 48);
            bytes(&assets.render(&Camera {
                eye,
                world_from_camera,
                width,
                height,
                hfov_rad: 1.5,
                depth_max_m: 50.0,
            }))
        };
        turned.map(picture).collect()
    }

    fn bytes(frame: &CameraImage) -> Vec<u8> {
        let depth = frame.depth.iter().flat_map(|depth| depth.to_bits().to_le_bytes());
        let ids = frame.instances.iter().flat_map(|id| id.0.to_le_bytes());
        frame.rgb.iter().copied().chain(depth).chain(ids).collect()
    }

    /// Lists file names.
    fn names(folder: &Path) -> Vec<String> {
        let entries =
            fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").file_name());
        let mut names: Vec<String> = entries.map(|name| name.to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    #[test]
    fn stored_limit_applies_to_later_programs() {
        let folder = folder();
        let path = folder.path().join("cache");
        assert_eq!(CacheFolder::at(&path).budget_bytes(), 4 << 30);
        CacheFolder::limit(&path, 20).expect("writable");
        assert_eq!(CacheFolder::at(&path).budget_bytes(), 20 << 30);
        fs::write(path.join(LIMIT_FILE), "much").expect("writable");
        assert_eq!(CacheFolder::at(&path).budget_bytes(), 4 << 30);
        fs::write(folder.path().join("file"), "").expect("writable");
        assert!(CacheFolder::limit(&folder.path().join("file"), 1).is_err());
    }

    #[test]
    fn cached_models_render_identical_pictures() {
        let folder = folder();
        let first: Vec<_> = PLAIN.iter().map(|picture| picture[..3 * 64 * 48].to_vec()).collect();
        assert!(first.iter().any(|rgb| rgb.iter().any(|&value| value != first[0][0])), "something is seen");
        assert_eq!(pictures(cache(folder.path())), *PLAIN, "kept");
        assert_eq!(names(folder.path()), [format!("{}-{}.model", digest(&HOUSE), Model::VERSION)]);
        assert!(CacheFolder::at(folder.path()).find(&digest(&HOUSE)).is_some());
        assert_eq!(pictures(cache(folder.path())), *PLAIN, "found");
    }

    #[test]
    fn concurrent_writers_store_one_model() {
        let folder = folder();
        let taken: Vec<_> = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..3).map(|_| scope.spawn(|| pictures(cache(folder.path())))).collect();
            threads.into_iter().map(|thread| thread.join().expect("pictures")).collect()
        });
        assert!(taken.iter().all(|pictures| *pictures == *PLAIN));
        assert_eq!(names(folder.path()).len(), 1);
    }

    #[test]
    fn damaged_models_are_replaced() {
        let folder = folder();
        let models = CacheFolder::at(folder.path());
        assert_eq!(pictures(cache(folder.path())), *PLAIN);
        let path = models.model_path(&digest(&HOUSE));
        let sound = fs::read(&path).expect("a model");
        let flipped = |at: usize| {
            let mut bytes = sound.clone();
            bytes[at] ^= 4;
            bytes
        };
        let half = sound[..sound.len() / 2].to_vec();
        for damaged in
            [flipped(0), flipped(20), flipped(sound.len() / 2), flipped(sound.len() - 1), half, vec![]]
        {
            // The old file may be mapped: it is replaced, not written to.
            fs::remove_file(&path).expect("the file of the round before");
            fs::write(&path, &damaged).expect("a file");
            assert!(models.find(&digest(&HOUSE)).is_none() && !path.exists());
            assert_eq!(pictures(cache(folder.path())), *PLAIN);
            assert_eq!(fs::read(&path).expect("made anew"), sound);
        }
    }

    #[test]
    fn unwritable_folder_keeps_models_in_memory() {
        let folder = folder();
        let file = folder.path().join("a file");
        fs::write(&file, b"no folder").expect("a file");
        assert_eq!(pictures(cache(&file.join("models"))), *PLAIN);
        let models = CacheFolder::at(&file.join("models"));
        assert!(models.find("house").is_none());
        models.keep("house", Model::default());
        assert!(models.warned.load(Ordering::Relaxed));
        assert_eq!(fs::read(&file).expect("the file"), b"no folder");
    }

    #[test]
    fn least_recently_used_files_are_evicted() {
        let folder = folder();
        let bytes = Model::default().byte_count() as u64;
        let models = CacheFolder::with_budget(folder.path(), 3 * bytes);
        let used = |name: &str, s: u64| {
            let file = File::open(folder.path().join(name)).expect("a file");
            file.set_modified(SystemTime::UNIX_EPOCH + Duration::from_secs(s)).expect("a time");
        };
        let file = |name: &str| format!("{name}-{}.model", Model::VERSION);
        fs::write(folder.path().join("left.part"), vec![0; bytes as usize]).expect("a file");
        fs::write(folder.path().join("notes.txt"), b"somebody's own").expect("a file");
        for name in ["a", "b"] {
            models.keep(name, Model::default());
        }
        ["left.part", &file("a"), &file("b")].into_iter().zip(1..).for_each(|(name, s)| used(name, s));
        models.keep("c", Model::default());
        assert_eq!(names(folder.path()), [&file("a"), &file("b"), &file("c"), "notes.txt"]);
        assert!(models.find("a").is_some(), "which makes it used");
        models.keep("d", Model::default());
        assert_eq!(names(folder.path()), [&file("a"), &file("c"), &file("d"), "notes.txt"]);
        let small = CacheFolder::with_budget(folder.path(), bytes - 1);
        assert_eq!(small.keep("large", Model::default()).byte_count() as u64, bytes);
        assert_eq!(names(folder.path()).len(), 4, "what is too large is not kept, and nothing goes for it");
    }

    #[test]
    fn missing_data_folder_is_not_created() {
        let folder = folder();
        assert!(CacheFolder::of_data(&folder.path().join("none")).is_none());
        assert!(CacheFolder::of_data(folder.path()).is_some());
        assert!(names(folder.path()).is_empty());
    }

    #[test]
    fn damaged_sounds_are_never_returned() {
        let folder = folder();
        let sounds = CacheFolder::at(folder.path());
        assert!(sounds.load_sound("kitchen").is_none());
        for bytes in [&b"a source"[..], &[], &[7; 10_000]] {
            sounds.store_sound("kitchen", bytes);
            assert_eq!(sounds.load_sound("kitchen").as_deref(), Some(bytes));
        }
        let path = sounds.sound_path("kitchen");
        let whole = fs::read(&path).expect("a file");
        for damaged in [&whole[..9_000], &whole[..20], &[]] {
            fs::write(&path, damaged).expect("a file");
            assert!(sounds.load_sound("kitchen").is_none() && !path.exists());
        }
        let mut flipped = whole.clone();
        flipped[5_000] ^= 1;
        fs::write(&path, flipped).expect("a file");
        assert!(sounds.load_sound("kitchen").is_none() && !path.exists());
    }
}
