//! Sound sources in a building, and their waves at a listener.

use crate::building::{Building, BuildingCache, Reader, Settings, Writer};
use crate::geodesic::{GeodesicField, length_m};
use crate::head::Head;
use crate::images::Images;
use crate::impulse::{Arrival, ImpulseResponse, Listener};
use crate::late::{LateField, cells::Slice, tail::add_tail};
use crate::surfaces::Surfaces;
use crate::unreflected::UnreflectedWaves;
use avln_geom::{Point3, RayMesh, Vector3, angle};
use avln_scene::Scene;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// Memory limit for cached sources per building, bytes; sources in use also stay alive through their users.
const SOURCES_BYTES: usize = 64 << 20;

/// A building's acoustics, shared by all listeners. Results do not depend on earlier queries.
pub struct Acoustics {
    building: Arc<Building>,
    /// Most recently used first.
    sources: Mutex<VecDeque<Arc<Slot>>>,
    cache: Option<BuildingCache>,
}

/// Position bits.
type Key = [u32; 3];

/// A sound source with paths through the building, computed once, on first use. Cheap to clone.
#[derive(Clone)]
pub struct Source {
    slot: Arc<Slot>,
    head: Head,
}

struct Slot {
    building: Arc<Building>,
    position: Point3<f32>,
    cache: Option<BuildingCache>,
    // The first user computes the paths while others wait.
    paths: OnceLock<SourcePaths>,
}

/// The first arriving wave.
#[derive(Clone, Debug, PartialEq)]
pub struct FirstWave {
    /// Time from emission to the head centre, seconds.
    pub delay_s: f64,
    /// Horizontal direction, radians: 0 is ahead of the listener, left is positive.
    pub azimuth_rad: f32,
    /// Response at both ears.
    pub response: ImpulseResponse,
}

pub(crate) struct Heard {
    pub(crate) arrivals: Vec<Arrival>,
    pub(crate) echo: Vec<Slice>,
}

struct SourcePaths {
    /// Entry point into room air: `position`, unless enclosed by furniture.
    outlet: Point3<f32>,
    field: GeodesicField,
    images: Images,
    /// `None` for a position that is not finite.
    late: Option<LateField>,
}

impl Acoustics {
    /// Prepares `scene`; `rays` and `surfaces` must match the mesh.
    pub fn new(scene: &Scene, rays: Arc<RayMesh>, surfaces: Surfaces, settings: Settings) -> Self {
        if settings.ray_count > 0 {
            settings.head.prepare();
        }
        let building = Building::new(scene, rays, surfaces, settings);
        Self { building: Arc::new(building), sources: Mutex::default(), cache: None }
    }

    /// Returns the same building for a [`LevelMeter`](crate::LevelMeter). Its sources have shorter responses, larger cells and no
    /// discrete reflections, so that fewer rays are sufficient.
    #[must_use]
    pub fn for_levels(&self) -> Self {
        let building = Arc::new(self.building.for_levels());
        Self { building, sources: Mutex::default(), cache: self.cache.clone() }
    }

    /// Sets the persistent cache for sources.
    #[must_use]
    pub fn with_cache(self, cache: Option<BuildingCache>) -> Self {
        Self { cache, ..self }
    }

    /// Bytes in the building and all cached sources.
    pub fn resident_bytes(&self) -> usize {
        self.building.byte_count() + self.sources_bytes()
    }

    /// Bytes in all cached sources.
    pub fn sources_bytes(&self) -> usize {
        let sources = self.sources.lock().unwrap_or_else(PoisonError::into_inner);
        sources.iter().map(|slot| slot.byte_count()).sum()
    }

    /// Returns the source at `position`, world frame, metres. Inside closed furniture, the source plays from the adjacent air.
    pub fn source(&self, position: &Point3<f32>) -> Source {
        Source { slot: self.slot(position), head: self.building.settings.head.clone() }
    }

    /// Returns a source's slot, moved to the front; the oldest slots are dropped above the memory limit.
    fn slot(&self, position: &Point3<f32>) -> Arc<Slot> {
        let mut sources = self.sources.lock().unwrap_or_else(PoisonError::into_inner);
        let found = sources.iter().position(|known| known.key() == key(position));
        let new = || {
            let (building, cache) = (Arc::clone(&self.building), self.cache.clone());
            Arc::new(Slot { building, position: *position, cache, paths: OnceLock::new() })
        };
        let slot = found.and_then(|index| sources.remove(index)).unwrap_or_else(new);
        sources.push_front(Arc::clone(&slot));
        let mut sum = 0;
        let kept = sources.iter().take_while(|slot| {
            sum += slot.byte_count();
            sum <= SOURCES_BYTES
        });
        let kept = kept.count().max(1);
        sources.truncate(kept);
        slot
    }
}

fn key(position: &Point3<f32>) -> Key {
    [0, 1, 2].map(|axis| position[axis].to_bits())
}

impl Slot {
    fn key(&self) -> Key {
        key(&self.position)
    }

    /// Bytes in the paths; 0 until they are computed.
    fn byte_count(&self) -> usize {
        self.paths.get().map_or(0, SourcePaths::byte_count)
    }

    fn paths(&self) -> &SourcePaths {
        self.paths.get_or_init(|| self.load_or_compute())
    }

    /// Reads the paths from the cache, or computes and stores them.
    // The span has no field: positions of sources are hidden facts.
    #[tracing::instrument(level = "debug", name = "sound_source", skip_all)]
    fn load_or_compute(&self) -> SourcePaths {
        let Some(BuildingCache { cache, name }) = &self.cache else {
            return SourcePaths::new(&self.building, &self.position);
        };
        let name = self.building.settings.source_name(name, self.key());
        let found = cache.load_sound(&name);
        let found = found.and_then(|bytes| SourcePaths::read(&bytes, &self.building));
        found.unwrap_or_else(|| {
            let paths = SourcePaths::new(&self.building, &self.position);
            cache.store_sound(&name, &paths.to_bytes());
            paths
        })
    }

    fn arrivals(&self, listener: &Point3<f32>) -> Vec<Arrival> {
        let paths = self.paths();
        if !finite(listener) || !finite(&paths.outlet) {
            return Vec::new();
        }
        let mut arrivals = self.waves().arrivals(listener);
        arrivals.extend(paths.images.arrivals(&self.building, listener, &arrivals));
        arrivals
    }

    fn waves(&self) -> UnreflectedWaves<'_> {
        let SourcePaths { field, outlet, .. } = self.paths();
        UnreflectedWaves { building: &self.building, field, outlet }
    }
}

impl SourcePaths {
    fn new(building: &Building, position: &Point3<f32>) -> Self {
        let air = &building.air;
        let mut outlet = *position;
        let mut seeds = if finite(position) { air.visible_cells(position) } else { Vec::new() };
        if seeds.is_empty() && finite(position) {
            seeds.extend(air.nearest_cell(position));
            outlet = seeds.first().map_or(outlet, |cell| air.grid.center(*cell));
        }
        let field = GeodesicField::new(air, &outlet, &seeds);
        let images = Images::new(building, &outlet);
        let late = finite(&outlet).then(|| LateField::new(building, &outlet, &images));
        Self { outlet, field, images, late }
    }

    fn to_bytes(&self) -> Vec<u8> {
        let Self { outlet, field, images, late } = self;
        let mut writer = Writer::default();
        writer.words(&[outlet.x, outlet.y, outlet.z].map(f32::to_bits));
        field.write(&mut writer);
        images.write(&mut writer);
        if let Some(late) = late {
            late.write(&mut writer);
        }
        writer.bytes
    }

    /// Reads the output of [`SourcePaths::to_bytes`]; `None` if it does not fit the building.
    fn read(bytes: &[u8], building: &Building) -> Option<Self> {
        let mut reader = Reader::new(bytes);
        let outlet = Point3::from(*reader.words()?.first_chunk::<3>()?).map(f32::from_bits);
        let field = GeodesicField::read(&mut reader, &building.air)?;
        let images = Images::read(&mut reader, building, &outlet)?;
        let late = if reader.is_at_end() { None } else { Some(LateField::read(&mut reader, building)?) };
        Some(Self { outlet, field, images, late })
    }

    fn byte_count(&self) -> usize {
        let late = self.late.as_ref().map_or(0, LateField::byte_count);
        self.field.byte_count() + self.images.byte_count() + late
    }
}

impl Source {
    /// Computes or loads the paths, unless it has them.
    pub fn prepare(&self) {
        self.slot.paths();
    }

    /// Returns the source with a different head model.
    #[must_use]
    pub fn with_head(&self, head: &Head) -> Self {
        Self { slot: Arc::clone(&self.slot), head: head.clone() }
    }

    /// Position, world frame, metres.
    pub fn position(&self) -> Point3<f32> {
        self.slot.position
    }

    /// Returns the response at both ears. Empty for non-finite positions.
    pub fn impulse_response(&self, listener: &Listener) -> ImpulseResponse {
        self.response(listener, &self.heard_at(&listener.position))
    }

    /// Returns all arrivals at a position, independent of the heading.
    pub(crate) fn heard_at(&self, place: &Point3<f32>) -> Heard {
        let arrivals = self.slot.arrivals(place);
        let late = self.slot.paths().late.as_ref().filter(|_| !arrivals.is_empty());
        let echo = late.map_or_else(Vec::new, |late| late.at(&self.slot.building, place));
        Heard { arrivals, echo }
    }

    /// Computes [`Source::impulse_response`] from the arrivals at the listener position.
    pub(crate) fn response(&self, listener: &Listener, heard: &Heard) -> ImpulseResponse {
        let settings = &self.settings();
        let arrivals = if listener.heading_rad.is_finite() { heard.arrivals.as_slice() } else { &[] };
        let mut response = ImpulseResponse::new(listener, arrivals, settings);
        // Waves through walls may arrive earlier, but carry hardly any energy.
        if let Some(first) = arrivals.first() {
            add_tail(&mut response, listener, &heard.echo, first.length_m, settings);
        }
        response
    }

    pub(crate) fn head(&self) -> &Head {
        &self.head
    }

    fn settings(&self) -> Settings {
        Settings { head: self.head.clone(), ..self.slot.building.settings.clone() }
    }

    /// Returns the first wave. `None` for non-finite positions.
    pub fn first_wave(&self, listener: &Listener) -> Option<FirstWave> {
        let arrivals = self.slot.arrivals(&listener.position);
        let first = arrivals.first().filter(|_| listener.heading_rad.is_finite())?;
        Some(FirstWave {
            delay_s: first.delay_s(),
            azimuth_rad: azimuth_rad(&first.direction, listener.heading_rad),
            response: ImpulseResponse::new(listener, &arrivals[..1], &self.settings()),
        })
    }

    /// Energy share that left the building through holes and open doors, 0 to 1.
    pub fn lost_share(&self) -> f32 {
        self.slot.paths().late.as_ref().map_or(1.0, |late| late.lost_share)
    }

    pub(crate) fn response_samples(&self) -> usize {
        self.slot.building.settings.response_samples()
    }

    /// Shortest path length to `point`, metres; `None` if unreachable.
    pub fn distance_m(&self, point: &Point3<f32>) -> Option<f32> {
        if !finite(point) || !finite(&self.slot.paths().outlet) {
            return None;
        }
        if self.slot.building.air.rays.is_clear(point, &self.slot.paths().outlet) {
            return Some((self.slot.paths().outlet - point).norm());
        }
        self.slot.waves().shortest(point).map(|path| length_m(&path))
    }
}

/// Angle between a direction and straight ahead, positive to the left; 0 for up and down.
fn azimuth_rad(direction: &Vector3<f32>, heading_rad: f32) -> f32 {
    let (sin, cos) = angle::sin_cos(heading_rad);
    angle::atan2(direction.z * sin - direction.x * cos, -direction.x * sin - direction.z * cos)
}

fn finite(point: &Point3<f32>) -> bool {
    // Larger coordinates are no building, and their squares overflow.
    const FAR_M: f32 = 1e6;
    point.iter().all(|coordinate| coordinate.abs() < FAR_M)
}
