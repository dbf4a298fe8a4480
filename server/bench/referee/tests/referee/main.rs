//! The referee from outside, on a hand-made floor.

mod floor;
mod rules;
mod sounds;
