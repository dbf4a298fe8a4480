//! The renderer compared with hand-computed values and double-precision rays; properties; golden images; bad
//! input; noise.
//!
//! All tests use the public interface, so they are independent of the implementation.

mod compare;
mod frames;
mod golden;
mod noise;
mod properties;
mod rays;
mod scenes;
