//! Training environments on small houses.

mod episodes;
mod memory;
mod sources;
