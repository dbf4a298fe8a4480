//! Sentences: facts of a scene, claims made of them, words for the claims, and a check of each sentence.

mod check;
mod facts;
mod frames;
mod lexicon;
mod phrase;
mod relate;
#[cfg(test)]
mod tests;
mod writer;

pub(crate) use check::{fits_only, unsaid};
pub use facts::Claims;
pub(crate) use facts::Facts;
pub(crate) use writer::Writer;
