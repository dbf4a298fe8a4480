//! The worked examples of docs/scoring.md and the properties of every score.

mod properties;
mod script;
mod worked;
