//! Light: RGB, planar depth and hidden instance ids.
