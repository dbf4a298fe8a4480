//! What one observation says: places in the start frame, sounds with a direction and a level.

mod audio;
mod geometry;

pub(crate) use audio::{Ear, Heard, itd_s};
pub(crate) use geometry::{Place, Stand, View};
