//! Memory use of acoustics.

use avln_acoustics::{Acoustics, Bank, Ears, Emitter, Listener, Settings, Surfaces};
use avln_geom::RayMesh;
use avln_houses::{HouseOptions, house};
use std::sync::Arc;

const MB: usize = 1_000_000;

#[test]
fn a_source_takes_8_mb_at_most_and_an_environment_64() {
    let scene = house("large", 5, &HouseOptions { rooms: 24..=24, storeys: 2..=2, ..Default::default() });
    let rays = Arc::new(RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles));
    // Where energy gets to and how it is stored is the same for few rays as for many.
    let settings = Settings { ray_count: 1024, ..Settings::default() };
    let acoustics = Acoustics::new(&scene, rays, Surfaces::by_material(&scene), settings);
    let objects = scene.objects.iter().step_by(scene.objects.len().div_ceil(4));
    let mut emitters = Vec::new();
    for (object, clip) in objects.zip(Bank::default().clips()) {
        let before = acoustics.resident_bytes();
        let source = acoustics.source(&object.bounds.center());
        let bytes = acoustics.resident_bytes() - before;
        assert!((MB / 10..8 * MB).contains(&bytes), "{bytes} bytes of a source");
        emitters.push(Emitter { source, clip, offset_samples: 0 });
    }
    assert_eq!(emitters.len(), 4);
    let place = scene.regions[0].bounds.center();
    let mut ears = Ears::new(emitters, 4000);
    for step in 0..12 {
        // All four ring, and each was just heard anew.
        let listener = Listener { position: place, heading_rad: 0.1 * step as f32 };
        ears.hear(&listener, Some(step % 4));
    }
    let bytes = acoustics.resident_bytes() + ears.resident_bytes();
    assert!((4 * MB..64 * MB).contains(&bytes), "{bytes} bytes of an environment");
    assert!(ears.resident_bytes() <= ears.most_bytes(), "{} bytes are promised", ears.most_bytes());
    println!("{} bytes, {} of them for the ears", bytes, ears.resident_bytes());
}
