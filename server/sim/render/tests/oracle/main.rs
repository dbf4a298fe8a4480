//! The renderer against rays that are traced in double precision, one by one; its properties; its looks; bad input.
//!
//! Everything goes through the crate's public interface, so that these tests outlive the way pictures are made.

mod bad_input;
mod compare;
mod golden;
mod properties;
mod rays;
mod scenes;
