//! Pictures and sound for replays, rendered on request. The arena implements [`ReplayRenderer`]; this module limits the load (one
//! rendering at a time, a short queue) and caches the results.

mod picture;
mod sound;

pub(crate) use picture::{depth_strip, picture, size_px};
pub(crate) use sound::{EpisodeSound, StepLevels, WINDOW_STEPS, sound, window_of};

use crate::error::RequestError;
use avln_episode::Pose;
use avln_store::EpisodeView;
use picture::Pictures;
use quick_cache::{OptionsBuilder, Weighter, sync::Cache};
use std::{fmt, future::Future, sync::Arc};
use tokio::sync::{Mutex, Semaphore};

/// Queue limit, including the current rendering.
const MAX_WAITING: usize = 8;
/// Picture cache size, bytes: some hundred steps.
const PICTURE_BYTES: u64 = 64 << 20;
/// Estimated picture count in the cache.
const PICTURES: usize = 256;
/// Sound cache size, bytes: four episodes at maximum length.
const SOUND_BYTES: u64 = 128 << 20;
/// Estimated sound count in the cache.
const SOUNDS: usize = 16;

/// A camera view to render.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewRequest {
    /// Phase id, which defines the rules and the scenes.
    pub phase: String,
    /// Scene name.
    pub scene: String,
    /// The agent's base pose.
    pub pose: Pose,
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Horizontal field of view, radians.
    pub hfov_rad: f32,
}

/// A rendered camera view.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RenderedView {
    /// `height × width × 3` bytes, sRGB.
    pub rgb: Vec<u8>,
    /// `height × width` values, metres; 0 for no hit.
    pub depth_m: Vec<f32>,
    /// Sensor range, metres.
    pub depth_max_m: f32,
}

/// An episode whose sound is to be rendered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SoundRequest {
    /// Phase id, which defines the rules, scenes and sounds.
    pub phase: String,
    /// Run id.
    pub run: String,
    /// Episode index in the run.
    pub ordinal: u32,
}

/// An episode's sound at both ears, from the observation before the first action to the last, at the sensors' sample rate and without
/// padding.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RenderedSound {
    /// Samples per step and ear.
    pub samples_per_step: usize,
    /// Sound pressure at the left ear.
    pub left: Vec<f32>,
    /// Sound pressure at the right ear.
    pub right: Vec<f32>,
}

/// Cause of a failed rendering, for the log.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct RenderError(pub String);

/// A renderer for views and sound, implemented by a running arena. A call may take seconds, on separate threads.
#[async_trait::async_trait]
pub trait ReplayRenderer: fmt::Debug + Send + Sync {
    /// Renders a camera view.
    ///
    /// # Errors
    /// If the phase or the scene is not available.
    async fn render_view(&self, request: ViewRequest) -> Result<RenderedView, RenderError>;

    /// Renders an episode's sound from the record.
    ///
    /// # Errors
    /// If the record is not available, or its replay differs.
    async fn render_sound(&self, request: SoundRequest) -> Result<RenderedSound, RenderError>;
}

/// A value with a known size.
trait ByteSize {
    fn bytes(&self) -> usize;
}

#[derive(Clone)]
struct ByteCount;

impl<T: ByteSize> Weighter<String, Arc<T>> for ByteCount {
    fn weight(&self, _: &String, value: &Arc<T>) -> u64 {
        value.bytes() as u64
    }
}

type ByteCache<T> = Cache<String, Arc<T>, ByteCount>;

/// The renderer with its queue and caches.
pub(crate) struct RenderQueue {
    renderer: Arc<dyn ReplayRenderer>,
    waiting: Semaphore,
    turn: Mutex<()>,
    pictures: ByteCache<Pictures>,
    sounds: ByteCache<EpisodeSound>,
}

/// The render queue; `None` on a server without a renderer.
pub(crate) type MaybeRenderQueue = Option<Arc<RenderQueue>>;

impl RenderQueue {
    pub(crate) fn new(renderer: Arc<dyn ReplayRenderer>) -> Self {
        Self {
            renderer,
            waiting: Semaphore::new(MAX_WAITING),
            turn: Mutex::default(),
            pictures: byte_cache(PICTURES, PICTURE_BYTES),
            sounds: byte_cache(SOUNDS, SOUND_BYTES),
        }
    }

    /// Returns the view pictures.
    async fn pictures(
        self: Arc<Self>,
        key: String,
        request: ViewRequest,
    ) -> Result<Arc<Pictures>, RequestError> {
        let renderer = self.renderer.clone();
        let rendering = async move {
            let (width, height) = (request.width, request.height);
            let view = renderer.render_view(request).await.map_err(|error| failed("a picture", &error))?;
            on_blocking_thread(move || Pictures::new(&view, width, height)).await
        };
        self.find_or_render(|queue| &queue.pictures, key, rendering).await
    }

    /// Returns the episode sound; `None` if the viewer may not hear it or the agent requested no sound.
    pub(crate) async fn sound(
        self: Arc<Self>,
        view: &EpisodeView,
    ) -> Result<Option<Arc<EpisodeSound>>, RequestError> {
        let Some(request) = sound::request_for(view) else { return Ok(None) };
        let renderer = self.renderer.clone();
        let key = format!("{} {}", request.run, request.ordinal);
        let rendering = async move {
            let sound = renderer.render_sound(request).await.map_err(|error| failed("sound", &error))?;
            on_blocking_thread(move || EpisodeSound::new(sound)).await
        };
        self.find_or_render(|queue| &queue.sounds, key, rendering).await.map(Some)
    }

    /// Returns the cached value, or renders and caches it.
    async fn find_or_render<T: ByteSize + Send + Sync + 'static>(
        self: Arc<Self>,
        cache: fn(&Self) -> &ByteCache<T>,
        key: String,
        rendering: impl Future<Output = Result<T, RequestError>> + Send + 'static,
    ) -> Result<Arc<T>, RequestError> {
        if let Some(cached) = cache(&self).get(&key) {
            return Ok(cached);
        }
        // A separate task: the rendering is completed and cached even if the visitor leaves.
        let task = tokio::spawn(async move {
            let in_turn = async {
                let _permit = self.waiting.try_acquire().map_err(|_| RequestError::Crowded)?;
                let _turn = self.turn.lock().await;
                rendering.await.map(Arc::new)
            };
            cache(&self).get_or_insert_async(&key, in_turn).await
        });
        task.await.map_err(|error| {
            tracing::error!(%error, "the rendering of a picture or sound panicked");
            RequestError::Internal
        })?
    }
}

fn byte_cache<T: ByteSize>(items: usize, bytes: u64) -> ByteCache<T> {
    // A single shard: with several, items above a shard's share would not be cached.
    let options =
        OptionsBuilder::new().estimated_items_capacity(items).weight_capacity(bytes).shards(1).build();
    match options {
        Ok(options) => Cache::with_options(options, ByteCount, Default::default(), Default::default()),
        Err(_) => Cache::with_weighter(items, bytes, ByteCount),
    }
}

fn failed(what: &str, error: &RenderError) -> RequestError {
    tracing::error!(%error, "cannot render {what}");
    RequestError::Internal
}

/// Runs CPU-bound work on a blocking thread.
async fn on_blocking_thread<T: Send + 'static>(
    work: impl FnOnce() -> Option<T> + Send + 'static,
) -> Result<T, RequestError> {
    tokio::task::spawn_blocking(work).await.ok().flatten().ok_or(RequestError::Internal)
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Block(usize);

    impl ByteSize for Block {
        fn bytes(&self) -> usize {
            self.0
        }
    }

    #[test]
    fn caches_are_bounded_by_bytes() {
        let cache = byte_cache(4, 100);
        for index in 0..10 {
            cache.insert(index.to_string(), Arc::new(Block(40)));
            assert!(cache.weight() <= 100, "{}", cache.weight());
        }
        assert!(!cache.is_empty());
        cache.insert("too large".to_owned(), Arc::new(Block(101)));
        assert!(cache.get("too large").is_none() && cache.weight() <= 100);
    }

    #[test]
    fn an_item_of_half_the_cache_is_kept() {
        let cache = byte_cache(SOUNDS, SOUND_BYTES);
        cache.insert("long episode".to_owned(), Arc::new(Block(SOUND_BYTES as usize / 2)));
        assert!(cache.get("long episode").is_some());
    }
}
