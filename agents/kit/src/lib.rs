//! Building blocks of agents: mapping, path following, hearing, perception and the run loop.
//!
//! Start reading at [`map`] and [`perception`]. [`path`] and [`explorer`] turn points into actions; [`hearing`] measures
//! sound, models the sounding order and infers Submit outcomes; [`perception::Hints`] passes ground truth to privileged agents of the
//! same process; [`run`] makes a program of an agent. The feature `onnx` adds perception by
//! user-supplied models.
//!
//! *Never*: links a server crate other than `avln-simd`; chooses targets or Submits; uses information beyond observations
//! (except [`perception::Hints`]).

pub mod explorer;
pub mod geometry;
pub mod hearing;
pub mod map;
#[cfg(feature = "onnx")]
pub mod onnx;
pub mod path;
pub mod perception;
pub mod run;

/// Range within which agents compare objects with goals, metres.
pub const LOOK_M: f32 = 2.8;
