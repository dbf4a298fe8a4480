//! What one observation says: places in the start frame, things with a shape and colours, sounds with a direction and a
//! level; and what the cues of the goals say.

mod audio;
mod backend;
mod category;
mod color;
mod cue;
mod geometry;
mod objects;
mod sight;

pub use audio::{Ear, Heard, itd_s, sloped_itd_s};
pub use backend::{Classical, Recognition};
pub use category::likeness as category_likeness;
pub use color::Palette;
pub use cue::{Layout, Query, Words};
pub use geometry::{Place, Stand, View};
pub use objects::{Thing, things};
pub use sight::Sight;
