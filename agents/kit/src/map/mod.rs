//! What the whole episode has said so far, in one frame: where one can stand, what has been seen, where sounds come
//! from.

mod elevation;
mod intensity;
mod level;
mod objects;
mod occupancy;
mod sound;
mod source;
mod storeys;

pub use elevation::{Climb, Elevation};
pub use intensity::Intensity;
pub use level::{expected_level, range_m};
pub use objects::{Object, Objects};
pub use occupancy::{CELL_M, Cell, Occupancy};
pub use sound::SoundField;
pub use source::{Estimate, SourceBelief};
pub use storeys::Storeys;
