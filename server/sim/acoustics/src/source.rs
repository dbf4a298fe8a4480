//! Sound sources in a building, and the waves that reach a listener from them.

use crate::air::Air;
use crate::geodesic::{GeodesicField, length_m};
use crate::images::Images;
use crate::impulse::{Arrival, ImpulseResponse};
use crate::late::{Cells, LateField, add_tail};
use crate::planes::Planes;
use crate::ways::Ways;
use crate::{Listener, Settings, Surfaces};
use avln_geom::{Point3, RayMesh, Vector3, angle};
use avln_scene::Scene;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// Sources kept per building, each up to half a megabyte; more of them and the smallest key is forgotten.
const MAX_SOURCES: usize = 256;

/// What a building does to sound. Shared by all who listen in it; answers do not depend on who asked before.
pub struct Acoustics {
    building: Arc<Building>,
    sources: Mutex<BTreeMap<[u32; 3], Arc<OnceLock<Source>>>>,
}

/// What is known of a building before anything sounds in it.
pub(crate) struct Building {
    pub(crate) air: Air,
    pub(crate) planes: Planes,
    pub(crate) surfaces: Surfaces,
    pub(crate) settings: Settings,
    /// Per triangle: its unit normal; 0 where it has no area.
    pub(crate) normals: Vec<Vector3<f32>>,
    pub(crate) cells: Cells,
}

/// A place from which sound comes, with all that is known of its ways through the building. Cheap to clone.
#[derive(Clone)]
pub struct Source {
    known: Arc<Known>,
}

/// A wave that is the first to arrive.
#[derive(Clone, Debug, PartialEq)]
pub struct FirstWave {
    /// From its emission until it passes the centre of the head, seconds.
    pub delay_s: f64,
    /// Where it comes from, in the horizontal plane: 0 is ahead of the listener, positive to the left.
    pub azimuth_rad: f32,
    /// What it alone is at the two ears.
    pub response: ImpulseResponse,
}

struct Known {
    building: Arc<Building>,
    position: Point3<f32>,
    /// Where sound leaves into the air of a room: `position`, unless that is shut in by furniture.
    outlet: Point3<f32>,
    field: GeodesicField,
    images: Images,
    /// `None` for a place that is not finite.
    late: Option<LateField>,
}

impl Acoustics {
    /// Prepares `scene`; `rays` must be built over the triangles of its mesh, and `surfaces` describe them.
    pub fn new(scene: &Scene, rays: Arc<RayMesh>, surfaces: Surfaces, settings: Settings) -> Self {
        let building = Building::new(scene, rays, surfaces, settings);
        Self { building: Arc::new(building), sources: Mutex::default() }
    }

    /// Bytes of what is known of the building and of all sources that are kept.
    pub fn resident_bytes(&self) -> usize {
        let sources = self.sources.lock().unwrap_or_else(PoisonError::into_inner);
        let known = sources.values().filter_map(|source| source.get());
        self.building.byte_count() + known.map(|source| source.known.byte_count()).sum::<usize>()
    }

    /// The source at `position`, world frame, metres; computed on first use.
    ///
    /// A position inside a closed piece of furniture sounds from the air next to it.
    pub fn source(&self, position: &Point3<f32>) -> Source {
        let key = [0, 1, 2].map(|axis| position[axis].to_bits());
        let slot = {
            let mut sources = self.sources.lock().unwrap_or_else(PoisonError::into_inner);
            if sources.len() >= MAX_SOURCES && !sources.contains_key(&key) {
                sources.pop_first();
            }
            Arc::clone(sources.entry(key).or_default())
        };
        slot.get_or_init(|| Source::new(Arc::clone(&self.building), position)).clone()
    }
}

impl Building {
    pub(crate) fn new(scene: &Scene, rays: Arc<RayMesh>, surfaces: Surfaces, settings: Settings) -> Self {
        let air = Air::new(scene, rays);
        let cells = Cells::new(&air, LateField::most_cells(&settings));
        let normal = |triangle: usize| {
            let [a, b, c] = scene.corners(triangle);
            (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_default()
        };
        let normals = (0..scene.mesh.triangles.len()).map(normal).collect();
        Self { air, planes: Planes::new(scene), surfaces, settings, normals, cells }
    }

    fn byte_count(&self) -> usize {
        self.air.byte_count()
            + self.planes.byte_count()
            + self.cells.byte_count()
            + size_of_val(self.normals.as_slice())
    }
}

impl Source {
    fn new(building: Arc<Building>, position: &Point3<f32>) -> Self {
        let air = &building.air;
        let mut outlet = *position;
        let mut seeds = if finite(position) { air.clear_cells(position) } else { Vec::new() };
        if seeds.is_empty() && finite(position) {
            seeds.extend(air.nearest_cell(position));
            outlet = seeds.first().map_or(outlet, |cell| air.grid().center(*cell));
        }
        let field = GeodesicField::new(air, &outlet, &seeds);
        let images = Images::new(&building, &outlet);
        let late = finite(&outlet).then(|| LateField::new(&building, &outlet, &images));
        Self { known: Arc::new(Known { building, position: *position, outlet, field, images, late }) }
    }

    /// Where the source was put, world frame, metres.
    pub fn position(&self) -> Point3<f32> {
        self.known.position
    }

    /// What this source does to the two ears of `listener`. Empty for positions that are not finite.
    pub fn impulse_response(&self, listener: &Listener) -> ImpulseResponse {
        let known = &self.known;
        let arrivals = known.arrivals(&listener.position, listener.heading_rad);
        let mut response = ImpulseResponse::new(listener, &arrivals, &known.building.settings);
        // Through walls some may come earlier, but hardly any.
        if let (Some(first), Some(late)) = (arrivals.first(), &known.late) {
            let echo = late.at(&known.building, &listener.position);
            add_tail(&mut response, listener, &echo, first.length_m, &known.building.settings);
        }
        response
    }

    /// The wave that reaches `listener` before all others. `None` for positions that are not finite.
    pub fn first_wave(&self, listener: &Listener) -> Option<FirstWave> {
        let arrivals = self.known.arrivals(&listener.position, listener.heading_rad);
        let first = arrivals.first()?;
        Some(FirstWave {
            delay_s: first.delay_s(),
            azimuth_rad: azimuth_rad(&first.direction, listener.heading_rad),
            response: ImpulseResponse::new(listener, &arrivals[..1], &self.known.building.settings),
        })
    }

    /// Share of the source's energy that left the building through holes and open doors to the outside, 0 to 1.
    pub fn lost_share(&self) -> f32 {
        self.known.late.as_ref().map_or(1.0, LateField::lost_share)
    }

    /// Samples of the longest impulse response that this source may have.
    pub(crate) fn response_samples(&self) -> usize {
        self.known.building.settings.response_samples()
    }

    /// Metres that the first sound travels to `point`; `None` when no air leads there.
    pub fn distance_m(&self, point: &Point3<f32>) -> Option<f32> {
        if !finite(point) || !finite(&self.known.outlet) {
            return None;
        }
        if self.known.building.air.rays().is_clear(point, &self.known.outlet) {
            return Some((self.known.outlet - point).norm());
        }
        self.known.ways().shortest(point).map(|way| length_m(&way))
    }
}

impl Known {
    fn byte_count(&self) -> usize {
        let late = self.late.as_ref().map_or(0, LateField::byte_count);
        self.field.byte_count() + self.images.byte_count() + late
    }

    fn arrivals(&self, listener: &Point3<f32>, heading_rad: f32) -> Vec<Arrival> {
        if finite(listener) && finite(&self.outlet) && heading_rad.is_finite() {
            let mut arrivals = self.ways().arrivals(listener);
            let mirrored = self.images.arrivals(&self.building, listener, &arrivals);
            arrivals.extend(mirrored);
            arrivals
        } else {
            Vec::new()
        }
    }

    fn ways(&self) -> Ways<'_> {
        Ways { building: &self.building, field: &self.field, outlet: &self.outlet }
    }
}

/// Angle of a direction (unit vector, world frame) from straight ahead, positive to the left; 0 for up and down.
fn azimuth_rad(direction: &Vector3<f32>, heading_rad: f32) -> f32 {
    let (sin, cos) = angle::sin_cos(heading_rad);
    angle::atan2(direction.z * sin - direction.x * cos, -direction.x * sin - direction.z * cos)
}

fn finite(point: &Point3<f32>) -> bool {
    // Beyond this a house is not a house, and squares overflow.
    const FAR_M: f32 = 1e6;
    point.iter().all(|coordinate| coordinate.abs() < FAR_M)
}
