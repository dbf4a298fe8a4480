//! Sentences: facts of a scene, claims made of them, words for the claims, and a check of each sentence.

mod check;
mod claim;
mod facts;
mod frames;
mod lexicon;
mod phrase;
mod relate;
#[cfg(test)]
mod tests;
mod writer;

pub(crate) use writer::Writer;
