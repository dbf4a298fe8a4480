//! Training environments on small houses.

mod episodes;
mod maps;
mod memory;
mod senses;
mod sources;
mod teachers;
