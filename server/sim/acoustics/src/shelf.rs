//! A persistent cache of acoustic data.

use std::sync::Arc;

/// A persistent cache of source data between runs of the program.
pub trait SoundShelf: Send + Sync {
    /// Returns the bytes stored as `name`, if present and intact.
    fn find_sound(&self, name: &str) -> Option<Vec<u8>>;
    /// Stores bytes; failures are ignored.
    fn keep_sound(&self, name: &str, bytes: &[u8]);
}

/// The part of a cache for the sources of a building.
#[derive(Clone)]
pub struct SoundPlace {
    /// The shelf.
    pub shelf: Arc<dyn SoundShelf>,
    /// A name that only buildings with the same content and surfaces have.
    pub name: String,
}
