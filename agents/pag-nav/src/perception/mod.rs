//! What one observation says: places in the start frame, things with a shape and colours, sounds with a direction and a
//! level; and what the cues of the goals say.

mod audio;
mod category;
mod color;
mod cue;
mod geometry;
mod objects;

pub(crate) use audio::{Ear, Heard, itd_s};
pub(crate) use category::likeness as category_likeness;
pub(crate) use color::Palette;
pub(crate) use cue::{Layout, Query, Words};
pub(crate) use geometry::{Place, Stand, View};
pub(crate) use objects::{Thing, things};
