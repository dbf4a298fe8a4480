//! Training environments on small houses.

mod episodes;
mod maps;
mod memory;
mod sources;
mod teachers;
