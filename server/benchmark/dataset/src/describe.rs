//! Sentences: facts of a scene, claims, words for the claims, and a sentence check.

mod check;
mod lexicon;
mod phrase;
mod relate;
mod writer;

pub(crate) use check::{fits_only, unsaid};
pub(crate) use relate::Facts;
pub(crate) use writer::Writer;

#[cfg(test)]
mod tests;
