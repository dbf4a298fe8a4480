//! Data sets: building on all processors, checks, exports, imports, and labelled frames.

pub mod build;
pub mod check;
pub mod export;
pub mod frames;
pub mod import;
pub mod openness;
