//! Cached sources and memory use.

use crate::common::{point, two_rooms};
use avln_acoustics::{
    Acoustics, Bank, BuildingCache, Ears, Emitter, ImpulseResponse, Listener, Settings, SoundCache, Surfaces,
};
use avln_geom::{Point3, RayMesh};
use avln_houses::{HouseOptions, house};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

/// A cache that counts hits.
#[derive(Default)]
struct Memory {
    kept: Mutex<BTreeMap<String, Vec<u8>>>,
    found: Mutex<u32>,
}

impl SoundCache for Memory {
    fn load_sound(&self, name: &str) -> Option<Vec<u8>> {
        let found = self.kept.lock().unwrap().get(name).cloned();
        *self.found.lock().unwrap() += u32::from(found.is_some());
        found
    }

    fn store_sound(&self, name: &str, bytes: &[u8]) {
        self.kept.lock().unwrap().insert(name.to_owned(), bytes.to_vec());
    }
}

fn kept(memory: &Arc<Memory>) -> Acoustics {
    let cache: Arc<dyn SoundCache> = Arc::clone(memory) as _;
    two_rooms(true).with_cache(Some(BuildingCache { cache, name: "flat".into() }))
}

/// Responses for some sources and listeners in two rooms.
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
fn cached_sources_equal_computed_sources() {
    let fresh = heard(&two_rooms(true));
    assert!(fresh.iter().all(|response| response.len() > 1000));
    let memory = Arc::new(Memory::default());
    assert_eq!(heard(&kept(&memory)), fresh, "kept");
    assert_eq!((memory.kept.lock().unwrap().len(), *memory.found.lock().unwrap()), (3, 0));
    assert_eq!(heard(&kept(&memory)), fresh, "found");
    assert_eq!(*memory.found.lock().unwrap(), 3);
}

#[test]
fn invalid_cached_bytes_are_recomputed() {
    let fresh = heard(&two_rooms(true));
    let memory = Arc::new(Memory::default());
    heard(&kept(&memory));
    let sound = memory.kept.lock().unwrap().clone();
    // A third of the bytes, wrong list lengths, and invalid corners.
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

#[derive(Default)]
struct Last(Mutex<Option<(String, Vec<u8>)>>);

impl SoundCache for Last {
    fn load_sound(&self, _: &str) -> Option<Vec<u8>> {
        None
    }

    fn store_sound(&self, name: &str, bytes: &[u8]) {
        *self.0.lock().unwrap() = Some((name.to_owned(), bytes.to_vec()));
    }
}

/// FNV-1a (Fowler, Noll and Vo).
fn hash(bytes: &[u8]) -> u64 {
    let mix = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, mix)
}

#[test]
fn version_changes_with_source_data() {
    let last = Arc::new(Last::default());
    let cache: Arc<dyn SoundCache> = Arc::clone(&last) as _;
    let acoustics = two_rooms(true).with_cache(Some(BuildingCache { cache, name: "flat".into() }));
    acoustics.source(&point(2.5, 1.0, 1.5)).prepare();
    let (name, bytes) = last.0.lock().unwrap().take().expect("a source");
    assert_eq!(
        (name.as_str(), hash(&bytes)),
        ("flat-402000003f8000003fc00000-16000-8192-2-5", 1_061_310_019_922_464_816),
        "sources are not what they were: count avln-acoustics' cache::VERSION up and put the new hash here"
    );
}

const MB: usize = 1_000_000;

#[test]
fn sources_take_8_mb_and_environments_64_mb() {
    let scene = house("large", 5, &HouseOptions { rooms: 24..=24, storeys: 2..=2, ..Default::default() });
    let rays = Arc::new(RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles));
    // Memory use hardly depends on the ray count.
    let settings = Settings { ray_count: 1024, ..Settings::default() };
    let acoustics = Acoustics::new(&scene, rays, Surfaces::by_material(&scene), settings);
    let objects = scene.objects.iter().step_by(scene.objects.len().div_ceil(4));
    let mut emitters = Vec::new();
    for (object, clip) in objects.zip(Bank::default().clips()) {
        let before = acoustics.resident_bytes();
        let source = acoustics.source(&object.bounds.center());
        assert_eq!(acoustics.resident_bytes(), before, "computed on first use");
        source.prepare();
        let bytes = acoustics.resident_bytes() - before;
        assert!((MB / 10..8 * MB).contains(&bytes), "{bytes} bytes of a source");
        emitters.push(Emitter { source, clip, offset_samples: 0 });
    }
    assert_eq!(emitters.len(), 4);
    let place = scene.regions[0].bounds.center();
    let mut ears = Ears::new(emitters, 4000);
    for step in 0..12 {
        // All four sources ring.
        let listener = Listener { position: place, heading_rad: 0.1 * step as f32 };
        ears.hear(&listener, Some(step % 4));
    }
    let bytes = acoustics.resident_bytes() + ears.resident_bytes();
    assert!((4 * MB..64 * MB).contains(&bytes), "{bytes} bytes of an environment");
    assert!(ears.resident_bytes() <= ears.max_bytes(), "{} bytes are promised", ears.max_bytes());
    println!("{} bytes, {} of them for the ears", bytes, ears.resident_bytes());
}
