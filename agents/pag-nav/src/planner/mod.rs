//! What to do next, given the map: where to search, what to ground, when to submit.

mod goals;
mod ground;
mod verify;
mod weights;

pub(crate) use goals::Goals;
pub(crate) use ground::{Candidate, Evidence, HeardThere, best};
pub(crate) use verify::{Demand, Gate, Stage};
pub use weights::{Weights, WeightsError};
