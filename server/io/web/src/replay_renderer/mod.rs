//! Pictures and sound for replays, rendered on request. The arena implements [`ReplayRenderer`]; this module limits the load (one
//! rendering at a time, a short queue) and caches the results.

mod sound;

pub(crate) use sound::{EpisodeSound, StepLevels, WINDOW_STEPS, sound, window_of};

use crate::{
    error::{RequestError, Result},
    request::{PictureQuery, PictureSensor, RequestContext, StrictQuery},
};
use avln_episode::Pose;
use avln_store::{EpisodeView, Replay};
use axum::{
    Extension,
    body::Bytes,
    extract::Path,
    http::header,
    response::{IntoResponse, Response},
};
use quick_cache::{OptionsBuilder, Weighter, sync::Cache};
use std::{fmt, future::Future, sync::Arc};
use tokio::sync::{Mutex, Semaphore};

/// Queue limit, including the current rendering.
const MAX_WAITING: usize = 8;
// Picture cache size, bytes: some hundred steps.
const PICTURE_BYTES: u64 = 64 << 20;
const PICTURES: usize = 256;
// Sound cache size, bytes: four episodes at maximum length.
const SOUND_BYTES: u64 = 128 << 20;
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

/// A request for an episode's sound.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SoundRequest {
    /// Phase id, which defines the rules, scenes and sounds.
    pub phase: String,
    /// Run id.
    pub run: String,
    /// Episode index in the run.
    pub ordinal: u32,
}

/// An episode's sound at both ears, from before the first action to the last, at the sensors' sample rate, unpadded.
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
    /// Renders a camera view. Fails if the phase or the scene is not available.
    async fn render_view(&self, request: ViewRequest) -> Result<RenderedView, RenderError>;
    /// Renders an episode's sound from the record. Fails if the record is not available, or the replay differs from it.
    async fn render_sound(&self, request: SoundRequest) -> Result<RenderedSound, RenderError>;
}

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
        let pictures = byte_cache(PICTURES, PICTURE_BYTES);
        let sounds = byte_cache(SOUNDS, SOUND_BYTES);
        Self { renderer, waiting: Semaphore::new(MAX_WAITING), turn: Mutex::default(), pictures, sounds }
    }

    async fn pictures(self: Arc<Self>, key: String, request: ViewRequest) -> Result<Arc<Pictures>> {
        let renderer = self.renderer.clone();
        let rendering = async move {
            let (width, height) = (request.width, request.height);
            let view = renderer.render_view(request).await.map_err(|error| failed("a picture", &error))?;
            on_blocking_thread(move || Pictures::new(&view, width, height)).await
        };
        self.find_or_render(|queue| &queue.pictures, key, rendering).await
    }

    /// Returns the episode sound; `None` if the viewer may not hear it or the agent requested no sound.
    pub(crate) async fn sound(self: Arc<Self>, view: &EpisodeView) -> Result<Option<Arc<EpisodeSound>>> {
        let Some(request) = sound::request_for(view) else { return Ok(None) };
        let renderer = self.renderer.clone();
        let key = format!("{} {}", request.run, request.ordinal);
        let rendering = async move {
            let sound = renderer.render_sound(request).await.map_err(|error| failed("sound", &error))?;
            on_blocking_thread(move || EpisodeSound::new(sound)).await
        };
        self.find_or_render(|queue| &queue.sounds, key, rendering).await.map(Some)
    }

    async fn find_or_render<T: ByteSize + Send + Sync + 'static>(
        self: Arc<Self>,
        cache: fn(&Self) -> &ByteCache<T>,
        key: String,
        rendering: impl Future<Output = Result<T>> + Send + 'static,
    ) -> Result<Arc<T>> {
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

async fn on_blocking_thread<T: Send + 'static>(
    work: impl FnOnce() -> Option<T> + Send + 'static,
) -> Result<T> {
    let span = tracing::Span::current();
    tokio::task::spawn_blocking(move || span.in_scope(work))
        .await
        .ok()
        .flatten()
        .ok_or(RequestError::Internal)
}

const MAX_SIDE_PX: u32 = 320;
/// Field of view for runs without recorded sensors, radians.
const DEFAULT_HFOV_RAD: f32 = std::f32::consts::FRAC_PI_2;
// Depth colour map from near to far: cividis, which also works for colour-blind visitors.
const DEPTH: [[f32; 3]; 9] = [
    [0.0, 34.0, 78.0],
    [27.0, 53.0, 110.0],
    [66.0, 78.0, 108.0],
    [95.0, 100.0, 110.0],
    [124.0, 123.0, 120.0],
    [155.0, 147.0, 119.0],
    [188.0, 174.0, 108.0],
    [223.0, 203.0, 88.0],
    [254.0, 232.0, 56.0],
];
const NO_HIT: [u8; 3] = [0, 0, 0];

#[derive(Debug, PartialEq)]
struct Pictures {
    rgb: Vec<u8>,
    depth: Vec<u8>,
}

impl Pictures {
    /// Encodes a view; `None` if the pixels do not match the size.
    fn new(view: &RenderedView, width: u32, height: u32) -> Option<Self> {
        let colour = |metres: &f32| depth_colour(*metres / view.depth_max_m.max(f32::MIN_POSITIVE));
        let depth: Vec<u8> = view.depth_m.iter().flat_map(colour).collect();
        Some(Self { rgb: encode_png(&view.rgb, width, height)?, depth: encode_png(&depth, width, height)? })
    }
}

impl ByteSize for Pictures {
    fn bytes(&self) -> usize {
        self.rgb.len() + self.depth.len()
    }
}

/// Returns the colour for a depth as a share of the sensor range.
fn depth_colour(share: f32) -> [u8; 3] {
    if share <= 0.0 || !share.is_finite() {
        return NO_HIT;
    }
    let position = share.min(1.0) * (DEPTH.len() - 1) as f32;
    let below = (position as usize).min(DEPTH.len() - 2);
    let rest = position - below as f32;
    [0, 1, 2].map(|channel| {
        (DEPTH[below][channel] * (1.0 - rest) + DEPTH[below + 1][channel] * rest).round() as u8
    })
}

/// Returns the legend colours for depth, with positions in percent.
pub(crate) fn depth_strip() -> Vec<(u32, String)> {
    let colour = |position: u32| {
        let [red, green, blue] = depth_colour((position as f32 + 5.0) / 100.0);
        (position, format!("#{red:02x}{green:02x}{blue:02x}"))
    };
    (0..100).step_by(10).map(colour).collect()
}

fn encode_png(pixels: &[u8], width: u32, height: u32) -> Option<Vec<u8>> {
    if pixels.len() != width as usize * height as usize * 3 {
        return None;
    }
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    encoder.write_header().ok()?.write_image_data(pixels).ok()?;
    Some(out)
}

pub(crate) async fn picture(
    context: RequestContext,
    Path((run, ordinal, file)): Path<(String, String, String)>,
    Extension(queue): Extension<MaybeRenderQueue>,
    StrictQuery(query): StrictQuery<PictureQuery>,
) -> Result<Response> {
    let view = context.episode(&run, &ordinal).await?;
    let unknown = || RequestError::unknown("picture", format!("{file} of episode {ordinal} of run {run}"));
    let queue = queue.ok_or_else(unknown)?;
    let step = file.strip_suffix(".png").and_then(|step| step.parse::<usize>().ok()).ok_or_else(unknown)?;
    let view_request = view_request(&view, step).ok_or_else(unknown)?;
    let key = format!("{run} {} {step}", view.ordinal);
    let pictures = queue.pictures(key, view_request).await?;
    let png = match query.sensor {
        Some(PictureSensor::Depth) => &pictures.depth,
        Some(PictureSensor::Rgb) | None => &pictures.rgb,
    };
    Ok(([(header::CONTENT_TYPE, "image/png")], Bytes::from(png.clone())).into_response())
}

/// Returns the view after `step` steps; `None` if the viewer may not see it or the episode was shorter.
fn view_request(view: &EpisodeView, step: usize) -> Option<ViewRequest> {
    let replay = view.replay.as_ref()?;
    let [x, y, z] = *replay.path.get(step)?;
    let pose = Pose { position: [x, y, z].into(), heading_rad: *replay.headings_rad.get(step)? };
    let [width, height] = size_px(replay);
    Some(ViewRequest {
        phase: view.run.phase.clone(),
        scene: replay.scene.clone(),
        pose,
        width,
        height,
        hfov_rad: replay.sensors.as_ref().map_or(DEFAULT_HFOV_RAD, |sensors| sensors.hfov_rad),
    })
}

/// Returns width and height in the camera's aspect ratio.
pub(crate) fn size_px(replay: &Replay) -> [u32; 2] {
    let (width, height) = replay.sensors.as_ref().map_or((1, 1), |sensors| (sensors.width, sensors.height));
    let longest = f64::from(width.max(height).max(1));
    [width, height].map(|side| ((f64::from(side.max(1)) / longest * f64::from(MAX_SIDE_PX)) as u32).max(1))
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

    #[test]
    fn depth_colours_grow_brighter_with_distance() {
        assert_eq!(depth_colour(0.0), NO_HIT);
        assert_eq!(depth_colour(f32::NAN), NO_HIT);
        assert_eq!(depth_colour(1e-9), [0, 34, 78]);
        assert_eq!(depth_colour(1.0), [254, 232, 56]);
        assert_eq!(depth_colour(7.0), [254, 232, 56]);
        let brightness =
            |share: f32| depth_colour(share).iter().map(|&channel| u32::from(channel)).sum::<u32>();
        assert!((1..20).all(|step| brightness(step as f32 / 20.0) < brightness((step + 1) as f32 / 20.0)));
    }

    #[test]
    fn views_of_the_wrong_size_are_rejected() {
        let view = RenderedView { rgb: vec![9; 12], depth_m: vec![1.0; 4], depth_max_m: 10.0 };
        let pictures = Pictures::new(&view, 2, 2).expect("the right size");
        assert!(pictures.rgb.starts_with(b"\x89PNG") && pictures.depth.starts_with(b"\x89PNG"));
        assert_eq!(Pictures::new(&view, 3, 2), None);
        assert_eq!(Pictures::new(&RenderedView { depth_m: vec![], ..view }, 2, 2), None);
    }
}
