use crate::camera::{Camera, CameraImage};
use crate::light::lit;
use crate::model::Model;
use crate::raster::{Raster, Scratch};
use crate::shade::Shader;
use avln_geom::RayMesh;
use avln_scene::{InstanceId, Scene, Texture};
use avln_simd::{Width, run_at};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// A renderer of a scene. Equal cameras give equal bytes.
pub struct Renderer {
    /// Made for the first picture.
    model: OnceLock<Model>,
    /// Source data; empty once the model is built.
    source: Mutex<Option<Source>>,
    /// Memory of pictures that are finished, for those to come.
    idle: Mutex<Vec<Scratch>>,
}

/// A persistent cache of models.
pub trait ModelCache: Send + Sync {
    /// Returns the model stored as `name`, if present and intact.
    fn find(&self, name: &str) -> Option<Model>;
    /// Stores a model. Returns an equal model, possibly in shared memory.
    fn keep(&self, name: &str, model: Model) -> Model;
}

/// A place on a shelf.
#[derive(Clone)]
pub struct ModelCacheEntry {
    /// The shelf.
    pub cache: Arc<dyn ModelCache>,
    /// A name that only scenes with the same content have.
    pub name: String,
}

#[derive(Clone)]
struct Source {
    scene: Arc<Scene>,
    /// Those that materials use instead of the scene's own.
    textures: Option<Arc<Vec<Texture>>>,
    rays: Arc<RayMesh>,
    place: Option<ModelCacheEntry>,
}

impl Source {
    fn model(&self) -> Model {
        let Some(ModelCacheEntry { cache, name }) = &self.place else { return self.build() };
        cache.find(name).unwrap_or_else(|| cache.keep(name, self.build()))
    }

    fn build(&self) -> Model {
        let lit = lit(&self.scene, &self.rays);
        let textures = self.textures.as_deref().unwrap_or(&self.scene.textures);
        Model::build(&self.scene, lit.as_ref().unwrap_or(&self.scene.mesh), textures)
    }
}

impl Renderer {
    /// Creates a renderer of `scene`; `rays` contains the triangles in the same order.
    pub fn new(scene: Arc<Scene>, rays: Arc<RayMesh>) -> Self {
        Self::of(Source { scene, textures: None, rays, place: None })
    }

    /// Creates a renderer of `scene` with `textures` instead of its own and a model cache at `place`; `rays`
    /// contains the triangles in the same order. Textures are freed once the model exists.
    pub fn with_cache(
        scene: Arc<Scene>,
        textures: Vec<Texture>,
        rays: Arc<RayMesh>,
        place: Option<ModelCacheEntry>,
    ) -> Self {
        Self::of(Source { scene, textures: Some(Arc::new(textures)), rays, place })
    }

    fn of(source: Source) -> Self {
        Self { model: OnceLock::new(), source: Mutex::new(Some(source)), idle: Mutex::default() }
    }

    /// Render data. The first call builds it and bakes the light of lamps.
    pub fn model(&self) -> &Model {
        let source = || self.source.lock().unwrap_or_else(PoisonError::into_inner);
        let model = self.model.get_or_init(|| {
            let source = source().clone();
            source.map_or_else(Model::default, |source| source.model())
        });
        *source() = None;
        model
    }

    /// Size of the render data in bytes: the model including mapped files; before the first image, the
    /// textures passed to [`Renderer::shelved`].
    pub fn resident_bytes(&self) -> usize {
        self.model.get().map_or_else(|| self.waiting_bytes(), Model::byte_count)
    }

    /// Bytes of textures that wait to be made into a model.
    fn waiting_bytes(&self) -> usize {
        let source = self.source.lock().unwrap_or_else(PoisonError::into_inner);
        let textures = source.as_ref().and_then(|source| source.textures.as_deref());
        textures.map_or(0, |textures| textures.iter().map(|texture| texture.pixels.len()).sum())
    }

    /// Renders `camera`. The first image takes longer, see [`Renderer::model`]. Surfaces are two-sided;
    /// texels below the alpha cutoff of the material are holes.
    pub fn render(&self, camera: &Camera) -> CameraImage {
        self.render_with(camera, Width::Eight)
    }

    /// [`Renderer::render`] with vector instructions of at most this width; the frame is the same for all.
    pub fn render_with(&self, camera: &Camera, width: Width) -> CameraImage {
        let mut frame = CameraImage::empty(camera);
        let idle = || self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        let mut scratch = idle().pop().unwrap_or_default();
        let (view, lens) = (self.model().view(), camera.lens());
        scratch.screen.clear(camera.width as usize, camera.height as usize);
        run_at(width, Raster { view, lens, scratch: &mut scratch });
        let depth_max_m = camera.depth_max_m;
        run_at(width, Shader { view, depth_max_m, scratch: &scratch, frame: &mut frame });
        idle().push(scratch);
        frame
    }
}

impl CameraImage {
    /// An empty image.
    fn empty(camera: &Camera) -> Self {
        let pixels = camera.width as usize * camera.height as usize;
        Self {
            width: camera.width,
            height: camera.height,
            rgb: vec![0; 3 * pixels],
            depth: vec![0.0; pixels],
            instances: vec![InstanceId::NONE; pixels],
        }
    }
}
