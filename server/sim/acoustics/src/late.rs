//! Late energy: all reflections without a discrete direction.

mod bins;
mod cells;
mod diffuse;
mod directed;
mod envelope;
mod field;
mod fourier;
mod lags;
mod march;
mod noise;
mod tail;
mod trace;

pub(crate) use cells::Cells;
pub(crate) use diffuse::HeardField;
pub(crate) use field::{Echo, LateField};
pub(crate) use tail::add_tail;

#[cfg(test)]
mod tests;
