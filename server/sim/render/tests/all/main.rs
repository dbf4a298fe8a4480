//! The renderer compared with hand-computed values and double-precision rays; properties; golden images; bad
//! input; noise.
//!
//! All tests use the public interface, so they are independent of the implementation.

mod compare;
mod detail;
mod frames;
mod noise;
mod properties;
mod scenes;
