//! Maps for one episode in the pose frame: free floor, surface heights, object hypotheses, sound sources.

pub(crate) mod elevation;
pub(crate) mod objects;
pub(crate) mod occupancy;
pub(crate) mod sound_field;
pub(crate) mod source;

pub use elevation::{ClimbPath, Elevation, Storeys};
pub use objects::{ObjectHypothesis, ObjectMemory};
pub use occupancy::{CELL_M, Cell, Occupancy};
pub use sound_field::SoundField;
pub use source::{IntensityMemory, SourceBelief, SourceEstimate, expected_level, range_m};
