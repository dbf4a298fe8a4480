//! The renderer compared with double-precision rays; properties; golden images; bad input.
//!
//! All tests use the public interface, so they are independent of the implementation.

mod bad_input;
mod compare;
mod golden;
mod properties;
mod rays;
mod scenes;
