//! Sources that are kept sound the same as those that are worked out.

mod common;

use avln_acoustics::{Acoustics, ImpulseResponse, Listener, SoundPlace, SoundShelf};
use avln_geom::Point3;
use common::two_rooms;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

/// A shelf that counts what it gives.
#[derive(Default)]
struct Memory {
    kept: Mutex<BTreeMap<String, Vec<u8>>>,
    found: Mutex<u32>,
}

impl SoundShelf for Memory {
    fn find_sound(&self, name: &str) -> Option<Vec<u8>> {
        let found = self.kept.lock().unwrap().get(name).cloned();
        *self.found.lock().unwrap() += u32::from(found.is_some());
        found
    }

    fn keep_sound(&self, name: &str, bytes: &[u8]) {
        self.kept.lock().unwrap().insert(name.to_owned(), bytes.to_vec());
    }
}

fn kept(memory: &Arc<Memory>) -> Acoustics {
    let shelf: Arc<dyn SoundShelf> = Arc::clone(memory) as _;
    two_rooms(true).kept_at(Some(SoundPlace { shelf, name: "flat".into() }))
}

/// What the sources of a flat with two rooms do to some listeners.
fn heard(acoustics: &Acoustics) -> Vec<ImpulseResponse> {
    let sources = [[1.0, 1.2, 3.0], [7.0, 0.6, 0.8], [4.1, 0.5, 3.0]].map(Point3::from);
    let listeners = [([6.5, 1.0, 3.2], 0.3), ([1.5, 1.0, 1.0], -2.0)];
    let listeners = listeners.map(|(place, heading_rad)| Listener { position: place.into(), heading_rad });
    let responses = sources.iter().flat_map(|source| {
        let source = acoustics.source(source);
        listeners.map(|listener| source.impulse_response(&listener))
    });
    responses.collect()
}

#[test]
fn sources_sound_the_same_fresh_kept_and_found() {
    let fresh = heard(&two_rooms(true));
    assert!(fresh.iter().all(|response| response.len() > 1000));
    let memory = Arc::new(Memory::default());
    assert_eq!(heard(&kept(&memory)), fresh, "kept");
    assert_eq!((memory.kept.lock().unwrap().len(), *memory.found.lock().unwrap()), (3, 0));
    assert_eq!(heard(&kept(&memory)), fresh, "found");
    assert_eq!(*memory.found.lock().unwrap(), 3);
}

#[test]
fn bytes_that_do_not_fit_the_building_are_not_used() {
    let fresh = heard(&two_rooms(true));
    let memory = Arc::new(Memory::default());
    heard(&kept(&memory));
    let sound = memory.kept.lock().unwrap().clone();
    // A third of the file, whole lists of other lengths, and corners that lead nowhere.
    let damages: [fn(&mut Vec<u8>); 3] = [
        |bytes| bytes.truncate(bytes.len() / 3),
        |bytes| bytes.drain(..16).for_each(drop),
        |bytes| bytes[16..60].fill(0xff),
    ];
    for damage in damages {
        memory.kept.lock().unwrap().values_mut().for_each(damage);
        assert_eq!(heard(&kept(&memory)), fresh);
        assert_eq!(*memory.kept.lock().unwrap(), sound, "made anew");
    }
}
