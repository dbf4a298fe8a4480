//! What the body saw: pictures that are made when somebody asks for them. Whoever wires this door hands in who can look; one picture
//! is made at a time, few visitors wait, and pictures that were made are kept in memory.

mod picture;
mod shelf;

pub(crate) use picture::depth_strip;

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
use shelf::Shelf;
use std::{fmt, future::Future, pin::Pin, sync::Arc};
use tokio::sync::{Mutex, Semaphore};

/// Visitors who wait for pictures, the one whose picture is being made included; the next is asked to come again.
const MAX_WAITING: usize = 8;
/// Memory for pictures that were made: some hundreds of them, bytes.
const KEPT_BYTES: usize = 64 << 20;
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

/// Why nothing was seen, for the organiser's log.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Blind(pub String);

/// What comes later.
pub type Looking = Pin<Box<dyn Future<Output = Result<Seen, Blind>> + Send>>;

/// Who can look into the scenes of phases.
pub trait Onlooker: fmt::Debug + Send + Sync {
    /// Looks once. It may take seconds, on threads of its own.
    fn look(&self, glance: Glance) -> Looking;
}

/// Who looks, who waits and what was seen before.
pub(crate) struct Desk {
    onlooker: Arc<dyn Onlooker>,
    waiting: Semaphore,
    turn: Mutex<()>,
    shelf: Shelf,
}

/// The desk of this door, where somebody can look.
pub(crate) type MaybeDesk = Option<Arc<Desk>>;

impl Desk {
    pub(crate) fn new(onlooker: Arc<dyn Onlooker>) -> Self {
        let (waiting, turn) = (Semaphore::new(MAX_WAITING), Mutex::default());
        Self { onlooker, waiting, turn, shelf: Shelf::new(KEPT_BYTES) }
    }

    /// The pictures of a glance. A picture is finished and kept even when the visitor has gone.
    async fn pictures(self: Arc<Self>, key: String, glance: Glance) -> Result<Arc<Pictures>, Trouble> {
        if let Some(pictures) = self.shelf.find(&key) {
            return Ok(pictures);
        }
        tokio::spawn(async move { self.make(key, glance).await }).await.map_err(|error| {
            tracing::error!(%error, "a picture broke");
            Trouble::Internal
        })?
    }

    async fn make(&self, key: String, glance: Glance) -> Result<Arc<Pictures>, Trouble> {
        let _place = self.waiting.try_acquire().map_err(|_| Trouble::Crowded)?;
        let _turn = self.turn.lock().await;
        if let Some(pictures) = self.shelf.find(&key) {
            return Ok(pictures);
        }
        let (width, height) = (glance.width, glance.height);
        let seen = self.onlooker.look(glance).await.map_err(|blind| {
            tracing::error!(%blind, "a picture could not be made");
            Trouble::Internal
        })?;
        let pictures = tokio::task::spawn_blocking(move || Pictures::of(&seen, width, height)).await;
        let pictures = pictures.ok().flatten().map(Arc::new).ok_or(Trouble::Internal)?;
        self.shelf.keep(key, pictures.clone());
        Ok(pictures)
    }
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
