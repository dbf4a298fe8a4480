//! The world of an episode: a body in a building, its motion and senses.

use crate::assets::{SceneAssets, SoundSource};
use avln_acoustics::{Ears, Emitter, Head, Listener};
use avln_geom::{Point3, Pose, Vector3};
use avln_navmesh::NavPoint;
use avln_render::{Camera, CameraImage, Detail, Noise};
use std::sync::Arc;

/// Largest distance between start and navmesh, metres.
const MAX_SNAP_M: f32 = 0.3;
// Rounding can shorten a free step; below this share of the requested distance it is a collision.
const FULL_STEP: f32 = 0.99;

/// Body measures and senses.
#[derive(Clone, Debug, PartialEq)]
pub struct WorldOptions {
    /// Forward step, metres.
    pub forward_m: f32,
    /// Turn, degrees.
    pub turn_deg: u32,
    /// Camera above the base, metres.
    pub camera_height_m: f32,
    /// Ears above the base, metres.
    pub ear_height_m: f32,
    /// Depth range, metres.
    pub depth_max_m: f32,
    /// Samples per ear and step, at 16 kHz.
    pub samples_per_step: usize,
    /// Camera view per step, if any.
    pub view: Option<CameraView>,
    /// True to render audio.
    pub audio: bool,
    /// Head model.
    pub head: Head,
    /// Image noise for the body; [`SceneAssets::render`] adds none.
    pub noise: Noise,
}

/// Image size and angle of view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraView {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Horizontal angle of view, radians, in (0, pi).
    pub hfov_rad: f32,
}

/// A body motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// Stand still.
    Stay,
    /// A step forward, sliding at obstacles.
    Forward,
    /// Turn to the left on the spot.
    Left,
    /// Turn to the right on the spot.
    Right,
}

/// The result of a motion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moved {
    /// True if an obstacle stopped or deflected a forward step.
    pub collided: bool,
    /// Horizontal distance, metres.
    pub displacement_m: f32,
}

/// Sensor readings.
#[derive(Clone, Debug, PartialEq)]
pub struct Senses {
    /// Camera image, if requested.
    pub frame: Option<CameraImage>,
    /// `2 × samples_per_step` samples, left ear first, if requested.
    pub audio: Option<Vec<f32>>,
}

/// An impossible start.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum StartError {
    /// The start is off the floor.
    #[error(
        "cannot start in scene `{scene}` at ({}, {}, {}): the floor is more than {limit_m} m away; \
         choose a start on the navmesh",
        .position.x, .position.y, .position.z
    )]
    OffNavMesh {
        /// Scene name.
        scene: String,
        /// World position, metres.
        position: Point3<f32>,
        /// Largest permitted distance, metres.
        limit_m: f32,
    },
}

/// A body in a building.
pub struct World {
    assets: Arc<SceneAssets>,
    options: WorldOptions,
    detail: Detail,
    start_heading_rad: f32,
    /// Degrees turned left since the start, 0 to 359.
    turned_deg: u32,
    standing: NavPoint,
    /// Motion count.
    steps: u64,
    ears: Option<Ears>,
}

impl World {
    /// Places a body on the floor at `start`, with possible sound sources.
    ///
    /// # Errors
    /// If the start is off the navmesh.
    pub fn new(
        assets: Arc<SceneAssets>,
        start: Pose,
        options: WorldOptions,
        sources: Vec<SoundSource>,
    ) -> Result<World, StartError> {
        let standing = assets.navmesh.snap(&start.position, MAX_SNAP_M).ok_or_else(|| {
            let scene = assets.scene.name.clone();
            StartError::OffNavMesh { scene, position: start.position, limit_m: MAX_SNAP_M }
        })?;
        let ears = options.audio.then(|| ears(&assets, &options, sources));
        let start_heading_rad = start.heading_rad;
        let detail = Detail::Exact;
        Ok(Self { assets, options, detail, start_heading_rad, turned_deg: 0, standing, steps: 0, ears })
    }

    /// Sets the detail of the body's images.
    pub fn set_detail(&mut self, detail: Detail) {
        self.detail = detail;
    }

    /// Moves the body.
    pub fn advance(&mut self, motion: Motion) -> Moved {
        self.steps += 1;
        let turn_deg = self.options.turn_deg % 360;
        match motion {
            Motion::Stay => {}
            Motion::Forward => return self.step_forward(),
            Motion::Left => self.turned_deg = (self.turned_deg + turn_deg) % 360,
            Motion::Right => self.turned_deg = (self.turned_deg + 360 - turn_deg) % 360,
        }
        Moved::default()
    }

    fn step_forward(&mut self) -> Moved {
        let asked = self.pose().forward() * self.options.forward_m;
        let slide = self.assets.navmesh.slide(&self.standing, &asked);
        let offset = slide.end.position() - self.standing.position();
        let displacement_m = Vector3::new(offset.x, 0.0, offset.z).norm();
        self.standing = slide.end;
        let collided = slide.blocked || displacement_m < FULL_STEP * self.options.forward_m;
        Moved { collided, displacement_m }
    }

    /// Returns the body's pose, world frame.
    pub fn pose(&self) -> Pose {
        let turned_rad = (self.turned_deg as f32).to_radians();
        Pose::new(self.standing.position(), self.start_heading_rad + turned_rad)
    }

    /// Returns the camera's pinhole, world frame.
    pub fn eye(&self) -> Point3<f32> {
        self.standing.position() + Vector3::y() * self.options.camera_height_m
    }

    /// Returns the sensor readings; call it once per step, because it advances the sound. Only the source
    /// `sounding` emits; earlier sources ring out.
    pub fn sense(&mut self, sounding: Option<usize>) -> Senses {
        let frame = self.options.view.map(|view| self.look(view));
        Senses { frame, audio: self.hear(sounding) }
    }

    /// Returns the audio part instead of [`World::sense`], for steps without a used image.
    #[tracing::instrument(level = "debug", skip_all)]
    pub fn hear(&mut self, sounding: Option<usize>) -> Option<Vec<f32>> {
        let pose = self.pose();
        let position = pose.position + Vector3::y() * self.options.ear_height_m;
        let listener = Listener { position, heading_rad: pose.heading_rad };
        self.ears.as_mut().map(|ears| ears.hear(&listener, sounding))
    }

    /// Returns the body's camera with a view.
    pub fn camera(&self, view: CameraView) -> Camera {
        let CameraView { width, height, hfov_rad } = view;
        let world_from_camera = self.pose().rotation();
        let depth_max_m = self.options.depth_max_m;
        Camera { eye: self.eye(), world_from_camera, width, height, hfov_rad, depth_max_m }
    }

    #[tracing::instrument(level = "debug", name = "render", skip_all)]
    fn look(&self, view: CameraView) -> CameraImage {
        let mut image = self.assets.render_at(&self.camera(view), self.detail);
        self.options.noise.apply(&mut image, self.steps, self.options.depth_max_m);
        image
    }

    /// Returns a state hash: equal hashes after every motion mean equal trajectories. FNV-1a over pose, turns
    /// and motion count.
    pub fn state_hash(&self) -> u64 {
        let pose = self.pose();
        let bits = [pose.position.x, pose.position.y, pose.position.z, pose.heading_rad].map(f32::to_bits);
        let words = bits.into_iter().map(u64::from).chain([u64::from(self.turned_deg), self.steps]);
        words.flat_map(u64::to_le_bytes).fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
        })
    }

    /// Computes or loads the acoustics of all sources, instead of when they first sound.
    pub fn prepare_sound(&self) {
        self.ears.iter().for_each(Ears::prepare);
    }

    /// Returns the body's largest memory, bytes, without the building: the ringing sound.
    pub fn most_bytes(&self) -> usize {
        self.ears.as_ref().map_or(0, Ears::max_bytes)
    }

    /// Returns the building's shared data.
    pub fn assets(&self) -> &Arc<SceneAssets> {
        &self.assets
    }

    /// Returns the navmesh point under the body.
    pub fn standing(&self) -> NavPoint {
        self.standing
    }
}

fn ears(assets: &SceneAssets, options: &WorldOptions, sources: Vec<SoundSource>) -> Ears {
    let emitter = |SoundSource { position, clip, offset_samples }| Emitter {
        source: assets.source(&position).with_head(&options.head),
        clip,
        offset_samples,
    };
    Ears::new(sources.into_iter().map(emitter).collect(), options.samples_per_step)
}
