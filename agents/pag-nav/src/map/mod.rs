//! What the whole episode has said so far, in one frame: where one can stand, what has been seen, where sounds come
//! from.

mod occupancy;
mod sound;
mod source;
mod things;

pub(crate) use occupancy::{CELL_M, Cell, Occupancy};
pub(crate) use sound::SoundField;
pub(crate) use source::{Estimate, SourceBelief, range_m};
pub(crate) use things::Things;
