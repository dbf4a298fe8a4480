//! Building blocks of agents: mapping, path following, hearing, perception and the run loop.
//!
//! ```
//! use avln_kit::hearing::itd_s;
//!
//! // Sound from 30 degrees to the left reaches the left ear 0.34 ms earlier.
//! let delay_s = itd_s(30_f32.to_radians());
//! assert!((delay_s - 0.34e-3).abs() < 0.01e-3);
//! ```
//!
//! Start reading at [`map`] and [`perception`]. [`perception::Hints`] passes ground truth to privileged
//! agents of the same process. The feature `onnx` adds perception by user-supplied models.
//!
//! This crate never links a server crate other than `avln-simd`, chooses targets or Submits, or uses
//! information beyond observations (except [`perception::Hints`]).

pub mod explorer;
pub mod geometry;
pub mod hearing;
/// Maps for one episode in the pose frame: free floor, surface heights, object hypotheses, rooms, sounds.
pub mod map {
    pub(crate) mod bearings;
    pub(crate) mod elevation;
    pub(crate) mod objects;
    pub(crate) mod occupancy;
    pub(crate) mod rooms;
    pub(crate) mod sound_field;
    pub(crate) mod source;

    pub use bearings::BearingMemory;
    pub use elevation::{ClimbPath, Elevation, Storeys};
    pub use objects::{FreshLook, ObjectHypothesis, ObjectMemory};
    pub use occupancy::{CELL_M, Cell, Occupancy};
    pub use rooms::{GoalPrior, NEUTRAL, ROOMS, RoomMemory, RoomMix};
    pub use sound_field::SoundField;
    pub use source::{IntensityMemory, SourceBelief, SourceEstimate, expected_level, range_m};
}
#[cfg(feature = "onnx")]
pub mod onnx;
pub mod outcome;
pub mod path;
pub mod perception;
pub mod run;

/// Range within which agents compare objects with goals, metres.
pub const LOOK_M: f32 = 2.8;
