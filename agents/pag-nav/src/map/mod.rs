//! What the whole episode has said so far, in one frame: where one can stand, what has been seen, where sounds come
//! from.

mod intensity;
mod objects;
mod occupancy;
mod sound;
mod source;

pub(crate) use intensity::Intensity;
pub(crate) use objects::{Object, Objects};
pub(crate) use occupancy::{CELL_M, Cell, Occupancy};
pub(crate) use sound::SoundField;
pub(crate) use source::{Estimate, SourceBelief, range_m};
