//! Wide vector instructions and memory-mapped files: all `unsafe` code of the workspace.
//!
//! The `README.md` of this crate contains the soundness arguments.
//!
//! *Never*: depends on its use.

mod mapped;
mod widest;

pub use mapped::Mapped;
pub use widest::{Width, Work, run_at};
