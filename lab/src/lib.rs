//! Tools around the arena: baseline suite, calibration, demonstrations, data sets, pictures of scenes, and the check before
//! a run.

pub mod calibration;
pub mod dataset;
pub mod doctor;
pub mod npy;
mod parallel;
pub mod preview;
pub mod rollout;
pub mod scene_renderer;
pub mod suite;
