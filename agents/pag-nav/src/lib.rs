//! PAG-Nav: the reference agent, a client like everyone else.
//!
//! Start reading at [`PagNav`] and [`run`].
//!
//! *Never*: links anything of the server; learns anything but what its observations say.

mod agent;
mod decide;
mod map;
mod options;
mod perception;
mod planner;

pub use agent::PagNav;
pub use options::{Options, run, run_with};
pub use planner::Weights;
