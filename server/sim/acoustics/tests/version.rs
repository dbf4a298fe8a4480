//! What is kept of sources is only found by programs that would work out the same.

mod common;

use avln_acoustics::{SoundPlace, SoundShelf};
use common::{point, two_rooms};
use std::sync::{Arc, Mutex};

#[derive(Default)]
struct Last(Mutex<Option<(String, Vec<u8>)>>);

impl SoundShelf for Last {
    fn find_sound(&self, _: &str) -> Option<Vec<u8>> {
        None
    }

    fn keep_sound(&self, name: &str, bytes: &[u8]) {
        *self.0.lock().unwrap() = Some((name.to_owned(), bytes.to_vec()));
    }
}

/// FNV-1a (Fowler, Noll and Vo).
fn hash(bytes: &[u8]) -> u64 {
    let mix = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, mix)
}

#[test]
fn the_version_changes_when_what_is_known_of_a_source_does() {
    let last = Arc::new(Last::default());
    let shelf: Arc<dyn SoundShelf> = Arc::clone(&last) as _;
    let acoustics = two_rooms(true).kept_at(Some(SoundPlace { shelf, name: "flat".into() }));
    acoustics.source(&point(2.5, 1.0, 1.5));
    let (name, bytes) = last.0.lock().unwrap().take().expect("a source");
    assert_eq!(
        (name.as_str(), hash(&bytes)),
        ("flat-402000003f8000003fc00000-16000-8192-2-4", 7_648_694_016_639_023_626),
        "sources are not what they were: count avln-acoustics' stored::VERSION up and put the new hash here"
    );
}
