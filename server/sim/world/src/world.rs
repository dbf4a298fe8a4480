use crate::SceneAssets;
use avln_acoustics::{Clip, Ears, Emitter, Head, Listener};
use avln_geom::{Point3, Pose, Vector3};
use avln_navmesh::NavPoint;
use avln_render::{Camera, CameraImage, Noise};
use std::sync::Arc;

/// Largest distance of a start from the navmesh, metres.
const MAX_SNAP_M: f32 = 0.3;
/// Collision threshold: share of the requested forward distance.
const FULL_STEP: f32 = 0.99;

/// The body's measures and senses.
#[derive(Clone, Debug, PartialEq)]
pub struct WorldOptions {
    /// Length of a step forward, metres.
    pub forward_m: f32,
    /// Angle of a turn, degrees.
    pub turn_deg: u32,
    /// Camera above the base, metres.
    pub camera_height_m: f32,
    /// Ears above the base, metres.
    pub ear_height_m: f32,
    /// Reach of depth, metres.
    pub depth_max_m: f32,
    /// Samples that each ear hears in a step, at 16 kHz.
    pub samples_per_step: usize,
    /// The picture taken each step; `None` for none.
    pub view: Option<CameraView>,
    /// True to render audio.
    pub audio: bool,
    /// Head model.
    pub head: Head,
    /// Noise of the pictures that the body perceives; none in those taken by [`SceneAssets::render`].
    pub noise: Noise,
}

/// Size and angle of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraView {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Angle between left and right border, radians, in (0, pi).
    pub hfov_rad: f32,
}

/// Something that can sound.
#[derive(Clone, Debug, PartialEq)]
pub struct SoundSource {
    /// Position, world frame.
    pub position: Point3<f32>,
    /// Repeated clip.
    pub clip: Clip,
    /// Clip position at the start of the episode, samples.
    pub offset_samples: usize,
}

/// A motion of the body in a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// Stand still.
    Stay,
    /// A step forward, sliding along obstacles.
    Forward,
    /// Turn to the left on the spot.
    Left,
    /// Turn to the right on the spot.
    Right,
}

/// Result of a motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moved {
    /// True if an obstacle stopped or deflected a forward step.
    pub collided: bool,
    /// Horizontal distance moved, metres.
    pub displacement_m: f32,
}

/// Sensor readings of a step.
#[derive(Clone, Debug, PartialEq)]
pub struct Senses {
    /// Camera image, if requested.
    pub frame: Option<CameraImage>,
    /// `2 × samples_per_step` samples, the left ear first, if audio was asked for.
    pub audio: Option<Vec<f32>>,
}

/// Why a body cannot start.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum StartError {
    /// The start is too far from the floor.
    #[error(
        "cannot start in scene `{scene}` at ({x}, {y}, {z}): the floor is more than {limit_m} m away; \
         choose a start on the navmesh"
    )]
    OffNavMesh {
        /// Name of the scene.
        scene: String,
        /// World position, metres.
        x: f32,
        /// World position, metres.
        y: f32,
        /// World position, metres.
        z: f32,
        /// The farthest that it may be.
        limit_m: f32,
    },
}

/// A body in a building.
pub struct World {
    assets: Arc<SceneAssets>,
    options: WorldOptions,
    start_heading_rad: f32,
    /// Degrees turned to the left since the start, 0 to 359.
    turned_deg: u32,
    standing: NavPoint,
    /// Motion count.
    steps: u64,
    ears: Option<Ears>,
}

impl World {
    /// Places a body on the floor at `start`, with the possible sound sources.
    ///
    /// # Errors
    /// If the start is off the navmesh.
    pub fn new(
        assets: Arc<SceneAssets>,
        start: Pose,
        options: WorldOptions,
        sources: Vec<SoundSource>,
    ) -> Result<World, StartError> {
        let standing = stand(&assets, &start.position)?;
        let ears = options.audio.then(|| ears(&assets, &options, sources));
        let start_heading_rad = start.heading_rad;
        Ok(Self { assets, options, start_heading_rad, turned_deg: 0, standing, steps: 0, ears })
    }

    /// Moves the body.
    pub fn advance(&mut self, motion: Motion) -> Moved {
        self.steps += 1;
        let turn_deg = self.options.turn_deg % 360;
        match motion {
            Motion::Stay => Moved::NOT,
            Motion::Forward => self.step_forward(),
            Motion::Left => self.turn(turn_deg),
            Motion::Right => self.turn(360 - turn_deg),
        }
    }

    fn turn(&mut self, left_deg: u32) -> Moved {
        self.turned_deg = (self.turned_deg + left_deg) % 360;
        Moved::NOT
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

    /// Pose of the body, world frame.
    pub fn pose(&self) -> Pose {
        let turned_rad = (self.turned_deg as f32).to_radians();
        Pose::new(self.standing.position(), self.start_heading_rad + turned_rad)
    }

    /// The camera's pinhole, world frame.
    pub fn eye(&self) -> Point3<f32> {
        self.standing.position() + Vector3::y() * self.options.camera_height_m
    }

    /// Returns the present sensor readings. Call once per step: every call advances the sound by a step. Only
    /// the source `sounding` emits; earlier sources ring out.
    pub fn sense(&mut self, sounding: Option<usize>) -> Senses {
        let frame = self.options.view.map(|view| self.look(&view));
        Senses { frame, audio: self.hear(sounding) }
    }

    /// Audio part of [`World::sense`], instead of it: for steps without a used image.
    pub fn hear(&mut self, sounding: Option<usize>) -> Option<Vec<f32>> {
        let pose = self.pose();
        let position = pose.position + Vector3::y() * self.options.ear_height_m;
        let listener = Listener { position, heading_rad: pose.heading_rad };
        self.ears.as_mut().map(|ears| ears.hear(&listener, sounding))
    }

    fn look(&self, view: &CameraView) -> CameraImage {
        let mut frame = self.assets.render(&self.camera(view));
        self.options.noise.apply(&mut frame, self.steps, self.options.depth_max_m);
        frame
    }

    fn camera(&self, view: &CameraView) -> Camera {
        Camera {
            eye: self.eye(),
            world_from_camera: self.pose().rotation(),
            width: view.width,
            height: view.height,
            hfov_rad: view.hfov_rad,
            depth_max_m: self.options.depth_max_m,
        }
    }

    /// Hash of the state: equal hashes after every motion mean equal trajectories. FNV-1a over the bits of
    /// pose, turns and motion count.
    pub fn state_hash(&self) -> u64 {
        let pose = self.pose();
        let bits = [pose.position.x, pose.position.y, pose.position.z, pose.heading_rad].map(f32::to_bits);
        let words = bits.into_iter().map(u64::from).chain([u64::from(self.turned_deg), self.steps]);
        words.flat_map(u64::to_le_bytes).fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
        })
    }

    /// Largest memory of the body in bytes, without the building: the ringing sound.
    pub fn most_bytes(&self) -> usize {
        self.ears.as_ref().map_or(0, Ears::max_bytes)
    }

    /// Shared data of the building.
    pub fn assets(&self) -> &Arc<SceneAssets> {
        &self.assets
    }

    /// The point of the navmesh under the body.
    pub fn standing(&self) -> NavPoint {
        self.standing
    }
}

impl Moved {
    const NOT: Self = Self { collided: false, displacement_m: 0.0 };
}

fn stand(assets: &SceneAssets, position: &Point3<f32>) -> Result<NavPoint, StartError> {
    assets.navmesh.snap(position, MAX_SNAP_M).ok_or_else(|| StartError::OffNavMesh {
        scene: assets.scene.name.clone(),
        x: position.x,
        y: position.y,
        z: position.z,
        limit_m: MAX_SNAP_M,
    })
}

fn ears(assets: &SceneAssets, options: &WorldOptions, sources: Vec<SoundSource>) -> Ears {
    let emitter = |SoundSource { position, clip, offset_samples }| Emitter {
        source: assets.source(&position).with_head(&options.head),
        clip,
        offset_samples,
    };
    Ears::new(sources.into_iter().map(emitter).collect(), options.samples_per_step)
}
