//! Where what is known of sources is kept.

use std::sync::Arc;

/// Where what is known of sources is kept from one run of the program to the next.
pub trait SoundShelf: Send + Sync {
    /// The bytes that were kept as `name`, if they are there and none of them changed.
    fn find_sound(&self, name: &str) -> Option<Vec<u8>>;
    /// Keeps bytes, if that is possible.
    fn keep_sound(&self, name: &str, bytes: &[u8]);
}

/// A place on a shelf for the sources of one building.
#[derive(Clone)]
pub struct SoundPlace {
    /// The shelf.
    pub shelf: Arc<dyn SoundShelf>,
    /// A name that only buildings with the same content and surfaces have.
    pub name: String,
}
