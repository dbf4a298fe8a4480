//! Listener steps per second, and preparation times for a building and a source.
//!
//! `cargo bench -p avln-acoustics`; a path argument opens a scene instead.

#![expect(clippy::disallowed_methods, reason = "a bench reads the clock")]

use avln_acoustics::{
    Acoustics, Bank, BuildingCache, Clip, Ears, Emitter, Head, Listener, SURFACE_BANDS, Settings, SoundCache,
    Source, Surface, Surfaces,
};
use avln_geom::{Point3, RayMesh, Rng};
use avln_houses::{HouseOptions, house};
use avln_scene::{InstanceId, Scene};
use std::collections::BTreeMap;
use std::hint::black_box;
use std::sync::{Arc, Mutex, OnceLock};
use std::time::{Duration, Instant};

const SAMPLES_PER_STEP: usize = 4000;

fn main() {
    let (_, bank) = timed("clip bank", || Bank::default().clips().collect::<Vec<Clip>>());
    let given = std::env::args().skip(1).find(|argument| std::path::Path::new(argument).exists());
    let scene = match given {
        Some(path) => avln_formats::open::open(path.as_ref()).expect("a scene"),
        None => house("bench", 7, &HouseOptions { rooms: 10..=10, ..Default::default() }),
    };
    let scene = Arc::new(scene);
    println!("{}: {} triangles, {} rooms", scene.name, scene.mesh.triangles.len(), scene.regions.len());
    timed("head", || Head::Sphere.prepare());
    let (_, rays) = timed("rays", || Arc::new(RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles)));
    let (_, acoustics) = timed("building", || {
        Acoustics::new(&scene, Arc::clone(&rays), Surfaces::by_material(&scene), Settings::default())
    });
    let mut places: Vec<_> = scene.objects.iter().map(|object| object.bounds.center()).collect();
    if places.is_empty() {
        places.push(scene.bounds().expect("surfaces").center());
    }
    let places: Vec<Point3<f32>> = places.iter().step_by(places.len().div_ceil(8).max(1)).copied().collect();
    let mut emitters = Vec::new();
    for (place, clip) in places.iter().zip(bank) {
        let before = acoustics.resident_bytes();
        let (_, source) = timed("source", || prepared(&acoustics, place));
        println!(
            "  {:.1} MB, {:.2} % of its energy leaves the building",
            (acoustics.resident_bytes() - before) as f64 / 1e6,
            100.0 * source.lost_share()
        );
        emitters.push(Emitter { source, clip, offset_samples: 0 });
    }
    responses("impulse response", &scene, &emitters);
    let dry = Settings { ray_count: 0, ..Settings::default() };
    let dry = Acoustics::new(&scene, Arc::clone(&rays), Surfaces::by_material(&scene), dry);
    let dry = emitters
        .iter()
        .map(|emitter| Emitter { source: dry.source(&emitter.source.position()), ..emitter.clone() });
    responses("without late energy", &scene, &dry.collect::<Vec<_>>());
    steps("steps", &scene, &emitters, 25, false);
    steps("steps, one source always rings", &scene, &emitters, 3, false);
    steps("steps to anywhere", &scene, &emitters, 25, true);
    let places: Vec<_> = emitters.iter().map(|emitter| emitter.source.position()).collect();
    warm(&scene, &rays, &places);
    hard();
}

fn prepared(acoustics: &Acoustics, place: &Point3<f32>) -> Source {
    let source = acoustics.source(place);
    source.prepare();
    source
}

/// Loads four cached sources, as the first episode in a prepared building does. Excludes the disk.
fn warm(scene: &Scene, rays: &Arc<RayMesh>, places: &[Point3<f32>]) {
    let place = BuildingCache { cache: Arc::new(Memory::default()), name: "bench".to_owned() };
    let open = || {
        let surfaces = Surfaces::by_material(scene);
        Acoustics::new(scene, Arc::clone(rays), surfaces, Settings::default()).with_cache(Some(place.clone()))
    };
    let sources = |acoustics: &Acoustics| {
        places.iter().take(4).for_each(|place| drop(black_box(prepared(acoustics, place))));
    };
    sources(&open());
    for _ in 0..3 {
        let acoustics = open();
        let begun = Instant::now();
        sources(&acoustics);
        println!("four sources that were kept: {:?}", begun.elapsed());
    }
}

/// The most expensive source: hard rooms without openings.
fn hard() {
    let large = HouseOptions { rooms: 24..=24, ..Default::default() };
    let mut houses = (5..25).map(|seed| house("hard", seed, &large));
    let mut scene = houses.find(|house| house.mesh.triangles.len() >= 50_000).expect("a house of that size");
    enclose(&mut scene);
    let shares = |share| [share; SURFACE_BANDS];
    let surface = Surface::new(shares(0.05), shares(0.1), shares(0.0)).expect("shares");
    let rays = Arc::new(RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles));
    let surfaces = Surfaces::uniform(&scene, surface);
    let acoustics = Acoustics::new(&scene, rays, surfaces, Settings::default());
    println!("hard and closed: {} triangles, {} rooms", scene.mesh.triangles.len(), scene.regions.len());
    for object in scene.objects.iter().step_by(scene.objects.len().div_ceil(4)) {
        let (_, source) = timed("source", || prepared(&acoustics, &object.bounds.center()));
        println!("  {:.2} % of its energy leaves the building", 100.0 * source.lost_share());
    }
}

/// Encloses a building in a box, so that no door leads outside.
fn enclose(scene: &mut Scene) {
    let outside = scene.bounds().expect("surfaces");
    let [low, high] = [outside.min.coords.add_scalar(-1.0), outside.max.coords.add_scalar(1.0)];
    let mesh = &mut scene.mesh;
    let first = mesh.positions.len() as u32;
    for corner in 0..8 {
        let along = |axis: usize| if corner >> axis & 1 == 0 { low[axis] } else { high[axis] };
        mesh.positions.push(Point3::new(along(0), along(1), along(2)));
        mesh.uvs.push(Default::default());
        mesh.colors.push([255; 3]);
    }
    for face in [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]] {
        let [a, b, c, d] = face.map(|corner: u32| first + corner);
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
        mesh.material_of.extend([0; 2]);
        mesh.instance_of.extend([InstanceId::NONE; 2]);
    }
}

/// An in-memory cache.
#[derive(Default)]
struct Memory(Mutex<BTreeMap<String, Vec<u8>>>);

impl SoundCache for Memory {
    fn load_sound(&self, name: &str) -> Option<Vec<u8>> {
        self.0.lock().expect("nothing panics").get(name).cloned()
    }

    fn store_sound(&self, name: &str, bytes: &[u8]) {
        self.0.lock().expect("nothing panics").insert(name.to_owned(), bytes.to_vec());
    }
}

/// Processor time in this thread if available, otherwise elapsed time.
fn busy() -> Duration {
    let told = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = told.and_then(|text| text.split(' ').next()?.parse().ok());
    static START: OnceLock<Instant> = OnceLock::new();
    nanoseconds.map_or_else(|| START.get_or_init(Instant::now).elapsed(), Duration::from_nanos)
}

/// Random positions a metre above the lowest floor, inside rooms if known.
fn wander(scene: &Scene, rng: &mut Rng) -> Listener {
    let room =
        rng.choose(&scene.regions).map_or_else(|| scene.bounds().expect("surfaces"), |region| region.bounds);
    let along = |rng: &mut Rng, axis: usize| rng.range(room.min[axis] + 0.3, room.max[axis] - 0.3);
    let position = Point3::new(along(rng, 0), room.min.y + 1.0, along(rng, 2));
    Listener { position, heading_rad: rng.range(-3.0, 3.0) }
}

fn responses(what: &str, scene: &Scene, emitters: &[Emitter]) {
    let mut rng = Rng::new(1);
    let before = busy();
    let mut times: Vec<Duration> = (0..2000)
        .map(|call| {
            let place = wander(scene, &mut rng);
            let start = Instant::now();
            black_box(emitters[call % emitters.len()].source.impulse_response(&place));
            start.elapsed()
        })
        .collect();
    times.sort();
    let mean = (busy() - before) / times.len() as u32;
    println!("{what}: median {:?}, 99 % {:?}, worst {:?}", times[1000], times[1980], times[1999]);
    println!("  mean {mean:?} of processor time");
}

/// Alternates steps of 25 cm and turns of 30 degrees, or jumps to random positions. Sources alternate every
/// `window` steps; with few steps the previous source still rings.
fn steps(what: &str, scene: &Scene, emitters: &[Emitter], window: usize, leaps: bool) {
    const STEPS: usize = 2000;
    let (mut rng, mut place) = (Rng::new(2), wander(scene, &mut Rng::new(3)));
    let mut ears = Ears::new(emitters.to_vec(), SAMPLES_PER_STEP);
    let before = busy();
    let mut times: Vec<Duration> = (0..STEPS)
        .map(|step| {
            match step % 40 {
                _ if leaps => place = wander(scene, &mut rng),
                0 => place = wander(scene, &mut rng),
                even if even % 2 == 0 => place.position.x += 0.25 * if even < 20 { 1.0 } else { -1.0 },
                _ => place.heading_rad += std::f32::consts::FRAC_PI_6,
            }
            let start = Instant::now();
            black_box(ears.hear(&place, Some(step / window % emitters.len())));
            start.elapsed()
        })
        .collect();
    times.sort();
    let mean = (busy() - before) / STEPS as u32;
    println!("{what}: median {:?}, 99 % {:?}; mean {mean:?} of processor time", times[1000], times[1980]);
}

fn timed<T>(what: &str, work: impl FnOnce() -> T) -> (Duration, T) {
    let start = busy();
    let result = work();
    let took = busy() - start;
    println!("{what}: {took:?} of processor time");
    (took, result)
}
