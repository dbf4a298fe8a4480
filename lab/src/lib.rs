//! Tools around the arena: baseline suite, calibration, demonstrations, data sets, scene previews and the doctor.

pub mod calibration;
/// Data sets: building, verifiers, checks, exports, imports and labelled frames.
pub mod dataset {
    pub mod build;
    pub mod check;
    pub mod export;
    pub mod frames;
    pub mod import;
    pub mod verifier;
}
pub mod doctor;
pub mod npy;
mod parallel;
pub mod preview;
pub mod rollout;
pub mod suite;

use avln_arena::{Failure, FailureKind};
use std::fmt::Display;

/// Wraps an error that no user input can cause.
pub(crate) fn internal(error: impl Display) -> Failure {
    Failure::new(FailureKind::Internal, error)
}
