//! Training environments on small houses.

mod episodes;
mod memory;
mod senses;
mod sources;
