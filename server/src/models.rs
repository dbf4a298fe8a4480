//! Models of scenes, kept in a folder: the next run need not make them, and processes that draw the same scene share their
//! memory.
//!
//! Everything in the folder can be made anew. Whatever is wrong with it is a warning and never an error.

use crate::arena::secret;
use avln_geom::RayMesh;
use avln_machine::Mapped;
use avln_render::{Model, Place, Renderer, Shelf};
use avln_scene::{Scene, digest::digest};
use std::{
    fs::{self, File},
    io,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::SystemTime,
};

/// Bytes of all files together, at most: some hundred scans or a thousand procedural houses.
const BUDGET_BYTES: u64 = 4 << 30;

/// A folder of models. A file is written under another name, moved into place when it is complete, and never written again.
pub struct ModelFolder {
    folder: PathBuf,
    budget_bytes: u64,
    /// Whether somebody was told that files cannot be written.
    complained: AtomicBool,
}

impl ModelFolder {
    /// Where the models of a data folder lie in it.
    pub const IN_DATA: &str = "cache/models";

    /// The models in `folder`, which is made when the first one is kept; 4 GiB of them at most, and those that nobody asked
    /// for longest make room for new ones.
    pub fn at(folder: &Path) -> Self {
        Self::with_budget(folder, BUDGET_BYTES)
    }

    /// [`ModelFolder::at`], with another limit.
    pub fn with_budget(folder: &Path, budget_bytes: u64) -> Self {
        Self { folder: folder.to_owned(), budget_bytes, complained: AtomicBool::new(false) }
    }

    /// The models of the data folder at `data`, where that is there: commands that can do without do not make it.
    pub fn of_data(data: &Path) -> Option<Arc<dyn Shelf>> {
        data.is_dir().then(|| Arc::new(Self::at(&data.join(Self::IN_DATA))) as Arc<dyn Shelf>)
    }

    /// Where the model called `name` lies. Another version of the program has files of its own.
    fn path(&self, name: &str) -> PathBuf {
        self.folder.join(format!("{name}-{}.model", Model::VERSION))
    }

    /// Writes a model and gives back the file.
    fn write(&self, name: &str, model: &Model) -> io::Result<PathBuf> {
        fs::create_dir_all(&self.folder)?;
        self.make_room(model.byte_count() as u64)?;
        let random = secret::random_hex().map_err(io::Error::other)?;
        let unfinished = self.folder.join(format!("{random}.part"));
        let path = self.path(name);
        let written = File::create_new(&unfinished)
            .and_then(|file| model.write(file))
            .and_then(|()| fs::rename(&unfinished, &path));
        if written.is_err() {
            let _ = fs::remove_file(&unfinished);
        }
        written.map(|()| path)
    }

    /// Deletes files, those that were used least recently first, until `bytes` more fit.
    fn make_room(&self, bytes: u64) -> io::Result<()> {
        let mut files = self.files()?;
        let mut sum = files.iter().map(|file| file.bytes).sum::<u64>().saturating_add(bytes);
        files.sort();
        for file in files {
            if sum <= self.budget_bytes {
                break;
            }
            // Somebody else may have deleted it.
            let _ = fs::remove_file(&file.path);
            sum -= file.bytes;
        }
        Ok(())
    }

    /// All files of this kind of folder, those that were left unfinished too.
    fn files(&self) -> io::Result<Vec<Kept>> {
        let is_ours = |path: &PathBuf| path.extension().is_some_and(|end| end == "model" || end == "part");
        let paths = fs::read_dir(&self.folder)?.filter_map(|entry| Some(entry.ok()?.path()));
        Ok(paths.filter(is_ours).filter_map(Kept::at).collect())
    }

    /// Says once that models are not kept.
    fn complain(&self, error: &io::Error) {
        if !self.complained.swap(true, Ordering::Relaxed) {
            let folder = self.folder.display();
            tracing::warn!(%folder, %error, "cannot keep prepared scenes, they are made anew at each start; give the folder write permission and space");
        }
    }
}

/// A scene that is ready to be drawn.
pub struct Studio {
    /// The scene, without textures: the renderer has them.
    pub scene: Arc<Scene>,
    /// Its triangles.
    pub rays: Arc<RayMesh>,
    /// What takes pictures of it.
    pub renderer: Renderer,
}

impl Studio {
    /// Gets `scene` ready; what pictures are made from is looked for and kept on `models`.
    pub fn new(mut scene: Scene, models: Option<Arc<dyn Shelf>>) -> Self {
        let place = models.map(|shelf| Place { shelf, name: digest(&scene) });
        let textures = std::mem::take(&mut scene.textures);
        let scene = Arc::new(scene);
        let rays = Arc::new(RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles));
        let renderer = Renderer::shelved(Arc::clone(&scene), textures, Arc::clone(&rays), place);
        Self { scene, rays, renderer }
    }
}

/// A file, ordered by when it was last used.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Kept {
    used: SystemTime,
    path: PathBuf,
    bytes: u64,
}

impl Kept {
    /// The file at `path`; `None` when it has just gone.
    fn at(path: PathBuf) -> Option<Self> {
        let about = fs::metadata(&path).ok()?;
        Some(Self { used: about.modified().unwrap_or(SystemTime::UNIX_EPOCH), bytes: about.len(), path })
    }
}

impl Shelf for ModelFolder {
    fn find(&self, name: &str) -> Option<Model> {
        let path = self.path(name);
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
        match self.write(name, &model).and_then(|path| Mapped::open(&path)) {
            Ok(bytes) => Model::read(bytes).unwrap_or(model),
            Err(error) => {
                self.complain(&error);
                model
            }
        }
    }
}

/// Notes that a file was used. Where that is not allowed it may be deleted before others: no result depends on it.
fn touch(path: &Path) {
    let _ = File::open(path).and_then(|file| file.set_modified(SystemTime::now()));
}

/// Deletes a file that is no model.
fn discard(path: &Path, error: &str) {
    let file = path.display();
    tracing::warn!(%file, %error, "a prepared scene cannot be used; it is deleted and made anew");
    let _ = fs::remove_file(path);
}

#[cfg(test)]
mod tests;
