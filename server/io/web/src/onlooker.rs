//! What the body saw and heard: pictures and sound that are made when somebody asks for them. Whoever wires this door hands in who
//! can look and listen; one thing is made at a time, few visitors wait, and what was made is kept in memory.

mod ears;
mod parts;
mod picture;
mod shelf;
mod sound;

pub(crate) use ears::{WINDOW_STEPS, sound, window_of};
pub(crate) use picture::depth_strip;
pub(crate) use sound::{Levels, Sound};

use crate::{
    trouble::Trouble,
    visit::{self, Asked, PictureQuery, Visit},
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
use picture::Pictures;
use shelf::{Kept, Shelf};
use std::{fmt, future::Future, pin::Pin, sync::Arc};
use tokio::sync::{Mutex, Semaphore};

/// Visitors who wait, the one for whom something is being made included; the next is asked to come again.
const MAX_WAITING: usize = 8;
/// Memory for pictures that were made: some hundreds of them, bytes.
const PICTURE_BYTES: usize = 64 << 20;
/// Memory for sound that was made: four of the longest episodes, bytes.
const SOUND_BYTES: usize = 128 << 20;
/// Longest side of a picture, pixels.
const MAX_SIDE_PX: u32 = 320;
/// Where nobody said how wide the eyes are open.
const HFOV_RAD: f32 = std::f32::consts::FRAC_PI_2;

/// Where somebody looks from, and how.
#[derive(Clone, Debug, PartialEq)]
pub struct Glance {
    /// Id of the phase, whose rules and scenes hold.
    pub phase: String,
    /// Name of the scene.
    pub scene: String,
    /// Where the base of the body is.
    pub pose: Pose,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// How wide the picture is.
    pub hfov_rad: f32,
}

/// What there is to see.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Seen {
    /// `height × width × 3` bytes, sRGB.
    pub rgb: Vec<u8>,
    /// `height × width` metres; 0 where there is nothing within reach.
    pub depth_m: Vec<f32>,
    /// Depth is told up to here, metres.
    pub depth_max_m: f32,
}

/// An episode that is to be heard again.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Listening {
    /// Id of the phase, whose rules, scenes and sounds hold.
    pub phase: String,
    /// Id of the run.
    pub run: String,
    /// Place of the episode in the run's list, from 0.
    pub ordinal: u32,
}

/// What both ears were sent in an episode, from the observation before the first action to the last, at the rate of the agents'
/// sensors and without what a shorter step was filled up with.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Heard {
    /// Samples that each ear hears in a step.
    pub samples_per_step: usize,
    /// Sound pressure at the left ear, step after step.
    pub left: Vec<f32>,
    /// The same at the right ear.
    pub right: Vec<f32>,
}

/// Why nothing was seen or heard, for the organiser's log.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Blind(pub String);

/// What comes later.
pub type Looking = Pin<Box<dyn Future<Output = Result<Seen, Blind>> + Send>>;
/// What comes later, to be heard.
pub type Hearing = Pin<Box<dyn Future<Output = Result<Heard, Blind>> + Send>>;

/// Who can look into the scenes of phases, and listen there.
pub trait Onlooker: fmt::Debug + Send + Sync {
    /// Looks once. It may take seconds, on threads of its own.
    fn look(&self, glance: Glance) -> Looking;

    /// Hears a whole episode again as its agent was sent it, by its record. It may take seconds, on threads of its own.
    fn listen(&self, listening: Listening) -> Hearing;
}

/// Who looks and listens, who waits and what was made before.
pub(crate) struct Desk {
    onlooker: Arc<dyn Onlooker>,
    waiting: Semaphore,
    turn: Mutex<()>,
    pictures: Shelf<Pictures>,
    sounds: Shelf<Sound>,
}

/// The desk of this door, where somebody can look.
pub(crate) type MaybeDesk = Option<Arc<Desk>>;

impl Desk {
    pub(crate) fn new(onlooker: Arc<dyn Onlooker>) -> Self {
        let (waiting, turn) = (Semaphore::new(MAX_WAITING), Mutex::default());
        let (pictures, sounds) = (Shelf::new(PICTURE_BYTES), Shelf::new(SOUND_BYTES));
        Self { onlooker, waiting, turn, pictures, sounds }
    }

    /// The pictures of a glance.
    async fn pictures(self: Arc<Self>, key: String, glance: Glance) -> Result<Arc<Pictures>, Trouble> {
        let onlooker = self.onlooker.clone();
        let look = async move {
            let (width, height) = (glance.width, glance.height);
            let seen = onlooker.look(glance).await.map_err(|blind| failed("a picture", &blind))?;
            prepared(move || Pictures::of(&seen, width, height)).await
        };
        self.in_turn(|desk| &desk.pictures, key, look).await
    }

    /// What the agent of an episode was sent to hear; `None` where the viewer may not know it, or the agent asked for no sound.
    pub(crate) async fn sound(self: Arc<Self>, view: &EpisodeView) -> Result<Option<Arc<Sound>>, Trouble> {
        let Some(listening) = ears::listening(view) else { return Ok(None) };
        let (onlooker, key) = (self.onlooker.clone(), format!("{} {}", listening.run, listening.ordinal));
        let listen = async move {
            let heard = onlooker.listen(listening).await.map_err(|blind| failed("sound", &blind))?;
            prepared(move || Sound::of(heard)).await
        };
        self.in_turn(|desk| &desk.sounds, key, listen).await.map(Some)
    }

    /// What was made under `key` before, or is made now. It is finished and kept even when the visitor has gone.
    async fn in_turn<T: Kept + Send + Sync + 'static>(
        self: Arc<Self>,
        shelf: fn(&Self) -> &Shelf<T>,
        key: String,
        make: impl Future<Output = Result<T, Trouble>> + Send + 'static,
    ) -> Result<Arc<T>, Trouble> {
        if let Some(kept) = shelf(&self).find(&key) {
            return Ok(kept);
        }
        let made = tokio::spawn(async move {
            let _place = self.waiting.try_acquire().map_err(|_| Trouble::Crowded)?;
            let _turn = self.turn.lock().await;
            if let Some(kept) = shelf(&self).find(&key) {
                return Ok(kept);
            }
            let made = Arc::new(make.await?);
            shelf(&self).keep(key, made.clone());
            Ok(made)
        });
        made.await.map_err(|error| {
            tracing::error!(%error, "a picture or sound broke");
            Trouble::Internal
        })?
    }
}

/// Tells the organiser why something could not be made.
fn failed(what: &str, blind: &Blind) -> Trouble {
    tracing::error!(%blind, "{what} could not be made");
    Trouble::Internal
}

/// What takes the processor for a while, on a thread of its own.
async fn prepared<T: Send + 'static>(
    prepare: impl FnOnce() -> Option<T> + Send + 'static,
) -> Result<T, Trouble> {
    tokio::task::spawn_blocking(prepare).await.ok().flatten().ok_or(Trouble::Internal)
}

/// What the body saw at one step.
pub(crate) async fn picture(
    visit: Visit,
    Path((run, place, file)): Path<(String, String, String)>,
    Extension(desk): Extension<MaybeDesk>,
    Asked(query): Asked<PictureQuery>,
) -> Result<Response, Trouble> {
    let view = visit.reader.episode(&visit.viewer, &run, visit::ordinal(&place)?).await?;
    let none =
        || Trouble::Unknown { what: "picture", name: format!("{file} of episode {place} of run {run}") };
    let (desk, view) = (desk.ok_or_else(none)?, view.ok_or_else(none)?);
    let step = file.strip_suffix(".png").and_then(|step| step.parse::<usize>().ok()).ok_or_else(none)?;
    let glance = glance(&view, step).ok_or_else(none)?;
    let key = format!("{run} {} {step}", view.ordinal);
    let pictures = desk.pictures(key, glance).await?;
    let png = Bytes::from(if query.is_depth() { pictures.depth.clone() } else { pictures.rgb.clone() });
    Ok(([(header::CONTENT_TYPE, "image/png")], png).into_response())
}

/// Where the body of an episode was after so many steps; `None` where the viewer may not see it or it was not there.
fn glance(view: &EpisodeView, step: usize) -> Option<Glance> {
    let replay = view.replay.as_ref()?;
    let [x, y, z] = *replay.path.get(step)?;
    let pose = Pose { position: [x, y, z].into(), heading_rad: *replay.headings_rad.get(step)? };
    let [width, height] = size_px(replay);
    let hfov_rad = replay.sensors.as_ref().map_or(HFOV_RAD, |sensors| sensors.hfov_rad);
    Some(Glance { phase: view.run.phase.clone(), scene: replay.scene.clone(), pose, width, height, hfov_rad })
}

/// Pixels of the pictures of a replay, in the shape that the agent asked for.
pub(crate) fn size_px(replay: &Replay) -> [u32; 2] {
    let (width, height) = replay.sensors.as_ref().map_or((1, 1), |sensors| (sensors.width, sensors.height));
    let longest = f64::from(width.max(height).max(1));
    [width, height].map(|side| ((f64::from(side.max(1)) / longest * f64::from(MAX_SIDE_PX)) as u32).max(1))
}
