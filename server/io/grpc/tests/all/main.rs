//! The door in front of a toy house, seen by real clients over real connections.

mod abuse;
mod common;
mod endings;
mod misuse;
mod play;
mod resume;
mod services;
mod unary;
mod whatever;
