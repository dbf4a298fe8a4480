use super::*;
use avln_geom::{UnitQuaternion, angle};
use avln_houses::{HouseOptions, house};
use avln_scene::{Scene, digest::digest};
use avln_world::{Body, Cached, Camera, CameraImage, SceneAssets};
use std::sync::LazyLock;
use std::time::Duration;
use tempfile::TempDir;

static HOUSE: LazyLock<Scene> = LazyLock::new(|| house("kept", 3, &HouseOptions::small()));
/// Images of the house from an uncached model.
static PLAIN: LazyLock<Vec<Vec<u8>>> = LazyLock::new(|| pictures(None));

fn folder() -> TempDir {
    TempDir::new().expect("a folder for temporary files")
}

fn cache(folder: &Path) -> Option<Arc<dyn Cache>> {
    Some(Arc::new(CacheFolder::at(folder)))
}

/// All bytes of some pictures of the house, as a server takes them.
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

/// Names of the files in a folder.
fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").file_name());
    let mut names: Vec<String> = entries.map(|name| name.to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

#[test]
fn a_limit_holds_for_all_who_open_the_folder_later() {
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
fn pictures_are_the_same_from_models_that_are_made_kept_and_found() {
    let folder = folder();
    let first: Vec<_> = PLAIN.iter().map(|picture| picture[..3 * 64 * 48].to_vec()).collect();
    assert!(first.iter().any(|rgb| rgb.iter().any(|&value| value != first[0][0])), "something is seen");
    assert_eq!(pictures(cache(folder.path())), *PLAIN, "kept");
    assert_eq!(names(folder.path()), [format!("{}-{}.model", digest(&HOUSE), Model::VERSION)]);
    assert!(CacheFolder::at(folder.path()).find(&digest(&HOUSE)).is_some());
    assert_eq!(pictures(cache(folder.path())), *PLAIN, "found");
}

#[test]
fn processes_that_keep_the_same_model_at_once_do_not_disturb_each_other() {
    let folder = folder();
    let taken: Vec<_> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..3).map(|_| scope.spawn(|| pictures(cache(folder.path())))).collect();
        threads.into_iter().map(|thread| thread.join().expect("pictures")).collect()
    });
    assert!(taken.iter().all(|pictures| *pictures == *PLAIN));
    assert_eq!(names(folder.path()).len(), 1);
}

#[test]
fn damaged_files_are_replaced() {
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
    for damaged in [flipped(0), flipped(20), flipped(sound.len() / 2), flipped(sound.len() - 1), half, vec![]]
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
fn models_stay_in_memory_where_no_folder_can_be_made() {
    let folder = folder();
    let file = folder.path().join("a file");
    fs::write(&file, b"no folder").expect("a file");
    assert_eq!(pictures(cache(&file.join("models"))), *PLAIN);
    let models = CacheFolder::at(&file.join("models"));
    assert!(models.find("house").is_none());
    models.keep("house", Model::default());
    assert!(models.complained.load(Ordering::Relaxed));
    assert_eq!(fs::read(&file).expect("the file"), b"no folder");
}

#[test]
fn files_that_were_used_least_recently_make_room() {
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
fn a_data_folder_is_not_made_for_its_models() {
    let folder = folder();
    assert!(CacheFolder::of_data(&folder.path().join("none")).is_none());
    assert!(CacheFolder::of_data(folder.path()).is_some());
    assert!(names(folder.path()).is_empty());
}

#[test]
fn sounds_come_back_as_they_were_kept_or_not_at_all() {
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
