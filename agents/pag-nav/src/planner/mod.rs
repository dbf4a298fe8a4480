//! What to do next, given the map: where to search, when to claim.

mod goals;
mod motion;
mod path;
mod turns;
mod weights;

pub(crate) use goals::Goals;
pub(crate) use motion::Motion;
pub(crate) use path::{Path, path};
pub(crate) use turns::Turns;
pub use weights::Weights;
