//! Sentences: facts of a scene, claims made of them, words for the claims, and a check of each sentence.

mod check;
mod claim;
mod facts;
mod frames;
mod lexicon;
mod phrase;
mod relate;
mod spoken;
#[cfg(test)]
mod tests;
mod writer;

pub(crate) use check::fits_only;
pub use claim::Claims;
pub(crate) use facts::Facts;
pub(crate) use spoken::unsaid;
pub(crate) use writer::Writer;
