//! Acoustics against theory, independent computations and a wave solver.

mod cache;
mod common;
mod ears;
mod head;
mod localisation;
mod reverberation;
mod rooms;
mod sofa;
mod sofa_file;
