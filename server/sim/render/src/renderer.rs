//! The renderer: colour, depth and instance images of a scene.

use crate::camera::{Camera, CameraImage};
use crate::light::lit;
use crate::model::{Model, Replacements};
use crate::raster::{Raster, Scratch};
use crate::shade::Shader;
use avln_geom::RayMesh;
use avln_scene::{InstanceId, Scene, Texture};
use avln_simd::{Width, run_at};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// A scene renderer. Equal cameras give equal bytes.
pub struct Renderer {
    /// Built for the first image.
    model: OnceLock<Model>,
    /// Built for the first image with [`Detail::HalfPixel`].
    replacements: OnceLock<Replacements>,
    /// Source data; empty once the model is built.
    source: Mutex<Option<Source>>,
    /// Memory for reuse.
    idle: Mutex<Vec<Scratch>>,
}

/// Detail of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Detail {
    /// All triangles.
    #[default]
    Exact,
    /// Fewer triangles, moved by about half a pixel at most.
    HalfPixel,
}

/// A persistent model cache.
pub trait ModelCache: Send + Sync {
    /// Returns the model stored as `name`, if present and intact.
    fn find(&self, name: &str) -> Option<Model>;
    /// Stores a model. Returns an equal model, possibly in shared memory.
    fn keep(&self, name: &str, model: Model) -> Model;
}

/// An entry in a model cache.
#[derive(Clone)]
pub struct ModelCacheEntry {
    /// Cache.
    pub cache: Arc<dyn ModelCache>,
    /// Entry name, unique by scene content.
    pub name: String,
}

#[derive(Clone)]
struct Source {
    scene: Arc<Scene>,
    /// Textures that replace the scene's own.
    textures: Option<Arc<Vec<Texture>>>,
    rays: Arc<RayMesh>,
    place: Option<ModelCacheEntry>,
}

impl Source {
    #[tracing::instrument(level = "debug", name = "render_model", skip_all, fields(scene = self.scene.name))]
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
    /// Creates a renderer; `rays` contains the scene triangles in order.
    pub fn new(scene: Arc<Scene>, rays: Arc<RayMesh>) -> Self {
        Self::of(Source { scene, textures: None, rays, place: None })
    }

    /// Creates a renderer with `textures` instead of the scene's own, and a model cache entry. Textures are
    /// freed once the model exists.
    pub fn with_cache(
        scene: Arc<Scene>,
        textures: Vec<Texture>,
        rays: Arc<RayMesh>,
        place: Option<ModelCacheEntry>,
    ) -> Self {
        Self::of(Source { scene, textures: Some(Arc::new(textures)), rays, place })
    }

    fn of(source: Source) -> Self {
        Self {
            model: OnceLock::new(),
            replacements: OnceLock::new(),
            source: Mutex::new(Some(source)),
            idle: Mutex::default(),
        }
    }

    /// Returns the render data. The first call builds it and bakes the light.
    pub fn model(&self) -> &Model {
        let source = || self.source.lock().unwrap_or_else(PoisonError::into_inner);
        let model = self.model.get_or_init(|| {
            let source = source().clone();
            source.map_or_else(Model::default, |source| source.model())
        });
        // Textures are in the model now.
        *source() = None;
        model
    }

    /// Returns the render data size, bytes: the model including mapped files; before the first image, the
    /// textures passed to [`Renderer::with_cache`].
    pub fn resident_bytes(&self) -> usize {
        if let Some(model) = self.model.get() {
            return model.byte_count() + self.replacements.get().map_or(0, Replacements::byte_count);
        }
        let source = self.source.lock().unwrap_or_else(PoisonError::into_inner);
        let textures = source.as_ref().and_then(|source| source.textures.as_deref());
        textures.map_or(0, |textures| textures.iter().map(|texture| texture.pixels.len()).sum())
    }

    /// Renders an image; the first takes longer, see [`Renderer::model`]. Surfaces are two-sided; texels
    /// below the material's alpha cutoff are holes.
    pub fn render(&self, camera: &Camera) -> CameraImage {
        self.draw(camera, None, Width::Eight)
    }

    /// Renders with vector instructions of at most this width; the image is equal for all.
    pub fn render_with(&self, camera: &Camera, vectors: Width) -> CameraImage {
        self.draw(camera, None, vectors)
    }

    /// Renders with this detail; the first image with [`Detail::HalfPixel`] takes longer.
    pub fn render_at(&self, camera: &Camera, detail: Detail) -> CameraImage {
        let replacements = match detail {
            Detail::Exact => None,
            Detail::HalfPixel => {
                Some(self.replacements.get_or_init(|| Replacements::new(&self.model().view())))
            }
        };
        self.draw(camera, replacements, Width::Eight)
    }

    fn draw(&self, camera: &Camera, replacements: Option<&Replacements>, vectors: Width) -> CameraImage {
        let Camera { width, height, depth_max_m, .. } = *camera;
        let pixels = width as usize * height as usize;
        let mut frame = CameraImage {
            width,
            height,
            rgb: vec![0; 3 * pixels],
            depth: vec![0.0; pixels],
            instances: vec![InstanceId::NONE; pixels],
        };
        let idle = || self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        let mut scratch = idle().pop().unwrap_or_default();
        let (view, lens) = (self.model().view(), camera.lens());
        scratch.screen.clear(width as usize, height as usize);
        run_at(vectors, Raster { view, replacements, lens, scratch: &mut scratch });
        run_at(vectors, Shader { view, depth_max_m, scratch: &scratch, frame: &mut frame });
        idle().push(scratch);
        frame
    }
}
