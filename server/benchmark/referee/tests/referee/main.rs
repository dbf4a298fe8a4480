//! The referee from outside, on a hand-made floor.

mod floor;
mod replay;
mod rules;
mod sounds;
