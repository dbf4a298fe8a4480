//! Specular reflections as discrete waves: mirror images of a source in the building's planes.
//!
//! Source: Vorländer (1989), "Simulation of the transient and steady-state sound propagation in rooms using a
//! new combined ray-tracing/image-source algorithm", J. Acoust. Soc. Am. 86: rays find the plane sequences.

use crate::bands::{BANDS, BandLoss, SILENT_DB, air_loss, both};
use crate::building::{Building, Reader, Writer};
use crate::impulse::Arrival;
use crate::planes::{Plane, PlaneId};
use crate::surfaces::{SURFACE_BANDS, Surface};
use crate::unreflected::disc_point;
use avln_geom::{Aabb, Point3, Vector3, angle};
use std::collections::BTreeMap;
use std::f32::consts::TAU;

/// Largest bounce count in a sequence.
pub(crate) const MAX_ORDER: usize = 3;

/// Rays that search for sequences.
const RAYS: usize = 32_768;

/// Sequences with fewer rays remain in the late energy.
const MIN_RAYS: u32 = 8;

/// Wave limit per position, strongest first.
const MAX_ARRIVALS: usize = 40;

/// A ray's mirror planes, in order from the source.
type Sequence = [Option<PlaneId>; MAX_ORDER];

type Sequences = BTreeMap<Sequence, RayHits>;

pub(crate) struct Images {
    outlet: Point3<f32>,
    /// Sorted by sequence.
    images: Vec<Image>,
}

struct Image {
    sequence: Sequence,
    /// Source position in the last mirror.
    position: Point3<f32>,
    /// Per mirror: bounds around the ray hits, including gaps between rays.
    lit: [Aabb; MAX_ORDER],
}

/// Ray statistics for a sequence.
struct RayHits {
    rays: u32,
    /// Per mirror: bounds around the hits, and the longest path to them in metres.
    hits: [(Aabb, f32); MAX_ORDER],
}

impl Default for RayHits {
    fn default() -> Self {
        let [min, max] = [f32::INFINITY, f32::NEG_INFINITY].map(|at| Point3::from([at; 3]));
        let nowhere = Aabb { min, max };
        Self { rays: 0, hits: [(nowhere, 0.0); MAX_ORDER] }
    }
}

impl RayHits {
    /// Adds a ray: per mirror the hit and the path length in metres.
    fn add(&mut self, bounces: &[(Point3<f32>, f32)]) {
        self.rays += 1;
        for ((lit, farthest_m), (point, path_m)) in self.hits.iter_mut().zip(bounces) {
            *lit = lit.including(point);
            *farthest_m = farthest_m.max(*path_m);
        }
    }
}

impl Images {
    /// Finds the images up to the order in the settings, at most three.
    pub(crate) fn new(building: &Building, outlet: &Point3<f32>) -> Self {
        let mut found = Sequences::new();
        if building.settings.reflection_order > 0 {
            for ray in 0..RAYS {
                follow(building, outlet, angle::spread_direction(ray, RAYS), &mut found);
            }
        }
        let hits = found.into_iter().filter(|(_, found)| found.rays >= MIN_RAYS);
        let images = hits.map(|(sequence, found)| Image::new(building, outlet, sequence, &found));
        Self { outlet: *outlet, images: images.collect() }
    }

    pub(crate) fn write(&self, writer: &mut Writer) {
        let words: Vec<_> = self.images.iter().map(Image::words).collect();
        writer.words(words.as_flattened());
    }

    /// Reads the output of [`Images::write`]; `None` if it does not fit the building.
    pub(crate) fn read(reader: &mut Reader, building: &Building, outlet: &Point3<f32>) -> Option<Self> {
        let words = reader.words()?;
        let images = words.as_chunks().0.iter().map(|words| Image::read(words, building));
        Some(Self { outlet: *outlet, images: images.collect::<Option<_>>()? })
    }

    pub(crate) fn byte_count(&self) -> usize {
        size_of_val(self.images.as_slice())
    }

    /// Returns true if these mirrors, in this order, form an image.
    pub(crate) fn contains(&self, planes: &[PlaneId]) -> bool {
        if planes.is_empty() || planes.len() > MAX_ORDER {
            return false;
        }
        let sequence: Sequence = std::array::from_fn(|bounce| planes.get(bounce).copied());
        self.images.binary_search_by(|image| image.sequence.cmp(&sequence)).is_ok()
    }

    /// Returns the reflections at `listener`, strongest first. Reflections fade over half a metre at a
    /// mirror's edge, unless negligible compared with `others`, the unreflected waves.
    pub(crate) fn arrivals(
        &self,
        building: &Building,
        listener: &Point3<f32>,
        others: &[Arrival],
    ) -> Vec<Arrival> {
        let reach_m = building.settings.reach_m();
        let lit = self.images.iter().filter(|image| image.may_reach(building, listener, reach_m));
        let places = places_around(building, listener);
        let loudest_db = others.iter().map(strength_db).fold(f32::NEG_INFINITY, f32::max);
        let heard = lit.filter_map(|image| {
            let most_db = -10.0 * libm::log10f((image.position - listener).norm_squared());
            let count = if most_db < loudest_db - FAINT_DB { 1 } else { places.len() };
            image.blurred(building, &self.outlet, &places[..count])
        });
        let mut arrivals: Vec<_> = heard.collect();
        arrivals.sort_by(|a, b| strength_db(b).total_cmp(&strength_db(a)));
        arrivals.truncate(MAX_ARRIVALS);
        arrivals
    }
}

/// Level at 1 kHz re 1 m, decibels.
fn strength_db(arrival: &Arrival) -> f32 {
    -arrival.loss[3] - 20.0 * libm::log10f(arrival.length_m.max(0.1))
}

/// Waves weaker than the others by this need no fade, decibels.
const FAINT_DB: f32 = 12.0;

/// Blur radius at a reflection's edge, metres.
const BLUR_M: f32 = 0.25;

// If all rim points and the centre agree, no further points are tested.
const RIM: usize = 4;

/// The listener, then points spread over a horizontal disc around it, limited by obstacles; the rim first.
fn places_around(building: &Building, listener: &Point3<f32>) -> Vec<Point3<f32>> {
    const PLACES: usize = 14;
    let place = |index: usize| {
        let [cos, sin, radius_m] = disc_point(index, PLACES, BLUR_M);
        listener + Vector3::new(cos, 0.0, sin) * radius_m
    };
    let clear = |place: &Point3<f32>| building.air.rays.is_clear(listener, place);
    std::iter::once(*listener).chain((0..PLACES).rev().map(place).filter(clear)).collect()
}

/// Serialised words per image.
const WORDS: usize = MAX_ORDER + 3 + 6 * MAX_ORDER;

impl Image {
    fn words(&self) -> [u32; WORDS] {
        let mirrors = self.sequence.iter().map(|plane| plane.map_or(0, |plane| u32::from(plane.0) + 1));
        let corners = self.lit.iter().flat_map(|lit| [lit.min, lit.max]);
        let points = std::iter::once(self.position).chain(corners);
        let mut words = mirrors.chain(points.flat_map(|point| [point.x, point.y, point.z].map(f32::to_bits)));
        std::array::from_fn(|_| words.next().unwrap_or_default())
    }

    fn read(words: &[u32; WORDS], building: &Building) -> Option<Self> {
        let (mirrors, rest) = words.split_first_chunk::<MAX_ORDER>()?;
        let point = |index: usize| Point3::from([0, 1, 2].map(|axis| f32::from_bits(rest[3 * index + axis])));
        let is_known = |mirror: &u32| *mirror as usize <= building.planes.len();
        let plane = |mirror: u32| mirror.checked_sub(1).map(|plane| PlaneId(plane as u16));
        let lit = |bounce: usize| Aabb { min: point(2 * bounce + 1), max: point(2 * bounce + 2) };
        let known = mirrors.iter().all(is_known);
        known.then(|| Self {
            sequence: mirrors.map(plane),
            position: point(0),
            lit: std::array::from_fn(lit),
        })
    }

    fn new(building: &Building, outlet: &Point3<f32>, sequence: Sequence, found: &RayHits) -> Self {
        let mirrors = sequence.iter().flatten().map(|id| building.planes.plane(*id));
        let position = mirrors.fold(*outlet, |point, plane| plane.mirrored(&point));
        // Approximate spacing between neighbouring rays; larger at grazing incidence.
        let spread = 2.0 * (2.0 * TAU / RAYS as f32).sqrt();
        let lit = found.hits.map(|(lit, farthest_m)| lit.grown(spread * farthest_m + BLUR_M));
        Self { sequence, position, lit }
    }

    /// Rejects cheaply: returns true if the line from the image to `listener` crosses the lit mirror parts.
    fn may_reach(&self, building: &Building, listener: &Point3<f32>, reach_m: f32) -> bool {
        let (mut seen, mut from) = (self.position, *listener);
        let mut passes = |(id, lit): (&PlaneId, &Aabb)| {
            let plane = building.planes.plane(*id);
            let point = crossing(plane, &from, &seen).filter(|point| lit.contains(point));
            from = point.unwrap_or(from);
            seen = plane.mirrored(&seen);
            point.is_some()
        };
        let near = (self.position - listener).norm_squared() < reach_m * reach_m;
        let mut mirrors =
            self.sequence.iter().zip(&self.lit).rev().filter_map(|(id, lit)| Some((id.as_ref()?, lit)));
        near && mirrors.all(&mut passes)
    }

    /// Returns the wave to the first place, scaled by the energy share at all places.
    fn blurred(&self, building: &Building, outlet: &Point3<f32>, places: &[Point3<f32>]) -> Option<Arrival> {
        let loss_at = |place: &Point3<f32>| self.path_loss(building, outlet, place);
        let (near, rest) = places.split_at(places.len().min(1 + RIM));
        let mut losses: Vec<_> = near.iter().filter_map(loss_at).collect();
        let mirrors = losses.first().copied()?;
        let mut share = 1.0;
        if losses.len() < near.len() {
            losses.extend(rest.iter().filter_map(loss_at));
            share = losses.len() as f32 / places.len() as f32;
        }
        let offset = self.position - places[0];
        let length_m = offset.norm();
        let other_db = air_loss(length_m).map(|db| db - 10.0 * libm::log10f(share));
        let loss = both(&mirrors, &other_db);
        let heard = loss.iter().any(|db| *db < SILENT_DB);
        let loss = loss.map(|db| db.min(SILENT_DB));
        heard.then(|| Arrival { direction: offset / length_m, length_m, loss })
    }

    /// Returns the mirror losses, if rays confirm every mirror and find no obstacle.
    fn path_loss(&self, building: &Building, outlet: &Point3<f32>, place: &Point3<f32>) -> Option<BandLoss> {
        let mut loss = [0.0; BANDS];
        let (mut seen, mut from) = (self.position, *place);
        for id in self.sequence.iter().rev().flatten() {
            let plane = building.planes.plane(*id);
            let point = crossing(plane, &from, &seen)?;
            let triangle = first_on(building, *id, &from, &point)?;
            loss = both(&loss, &mirror_loss(building.surfaces.of(triangle)));
            let side = plane.height_m(&from).signum();
            from = point + plane.normal * (side * (plane.slack_m + 1e-3));
            seen = plane.mirrored(&seen);
        }
        building.air.rays.is_clear(&from, outlet).then_some(loss)
    }
}

fn crossing(plane: &Plane, from: &Point3<f32>, to: &Point3<f32>) -> Option<Point3<f32>> {
    let (here, there) = (plane.height_m(from), plane.height_m(to));
    let apart = (here > 0.0 && there < 0.0) || (here < 0.0 && there > 0.0);
    apart.then(|| from + (to - from) * (here / (here - there)))
}

/// Returns the first triangle on the line to `point` on plane `id`; `None` if another surface is hit.
fn first_on(building: &Building, id: PlaneId, from: &Point3<f32>, point: &Point3<f32>) -> Option<u32> {
    let offset = point - from;
    let length_m = offset.norm();
    let direction = offset / length_m.max(f32::MIN_POSITIVE);
    let plane = building.planes.plane(id);
    let steepness = plane.normal.dot(&direction).abs().max(0.02);
    let slack_m = (plane.slack_m + 1e-3) / steepness;
    let hit = building.air.rays.cast(from, &direction, length_m + slack_m)?;
    (building.planes.of(hit.triangle) == Some(id)).then_some(hit.triangle)
}

/// Loss at a bounce: all energy not reflected specularly.
fn mirror_loss(surface: &Surface) -> BandLoss {
    std::array::from_fn::<_, BANDS, _>(|band| {
        let band = band.min(SURFACE_BANDS - 1);
        let share = (surface.reflected(band) * (1.0 - surface.scattering[band])).clamp(0.0, 1.0);
        if share < 1e-10 { SILENT_DB } else { -10.0 * libm::log10f(share) }
    })
}

/// Adds all sequences of a ray.
fn follow(building: &Building, outlet: &Point3<f32>, mut direction: Vector3<f32>, found: &mut Sequences) {
    let mut sequence = [None; MAX_ORDER];
    let mut bounces = [(*outlet, 0.0); MAX_ORDER];
    let (mut from, mut path_m) = (*outlet, 0.0);
    for bounce in 0..building.settings.reflection_order.min(MAX_ORDER) {
        let reach_m = building.settings.reach_m() - path_m;
        let Some(hit) = building.air.rays.cast(&from, &direction, reach_m) else { return };
        let Some(id) = building.planes.of(hit.triangle) else { return };
        if bounce > 0 && sequence[bounce - 1] == Some(id) {
            return;
        }
        path_m += hit.distance;
        let (plane, point) = (building.planes.plane(id), from + direction * hit.distance);
        sequence[bounce] = Some(id);
        bounces[bounce] = (point, path_m);
        found.entry(sequence).or_default().add(&bounces[..=bounce]);
        let side = -plane.normal.dot(&direction).signum();
        from = point + plane.normal * (side * (plane.slack_m + 1e-3));
        direction = plane.reflected(&direction);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Settings;
    use crate::tests::{self as fixtures, Soup};

    const SURFACE: Surface = Surface {
        absorption: [0.1, 0.12, 0.15, 0.2, 0.3, 0.4],
        scattering: [0.1, 0.1, 0.2, 0.3, 0.4, 0.5],
        transmission: [0.05, 0.04, 0.03, 0.02, 0.01, 0.0],
    };

    fn building(soup: &Soup, reflection_order: usize) -> Building {
        fixtures::building(soup, SURFACE, Settings { reflection_order, ..Settings::default() })
    }

    /// Distances and bounce counts for all images in a box room up to `order`, nearest first (Allen and
    /// Berkley 1979).
    fn images_of_a_box(size: [f32; 3], source: [f32; 3], listener: [f32; 3], order: i32) -> Vec<(f32, i32)> {
        let along = |axis: usize| {
            (-order..=order).map(move |cell| {
                let (length, at) = (size[axis], source[axis]);
                let folded = if cell % 2 == 0 { at } else { length - at };
                (cell.abs(), cell as f32 * length + folded - listener[axis])
            })
        };
        let mut found = Vec::new();
        for (x, y, z) in along(0).flat_map(|x| along(1).flat_map(move |y| along(2).map(move |z| (x, y, z)))) {
            let bounces = x.0 + y.0 + z.0;
            if (1..=order).contains(&bounces) {
                found.push((Vector3::new(x.1, y.1, z.1).norm(), bounces));
            }
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        found
    }

    #[test]
    fn box_rooms_have_the_theoretical_images() {
        let size = [6.0, 2.7, 5.0];
        let (source, listener) = ([1.3, 1.1, 3.9], [4.4, 1.0, 1.7]);
        for (pieces, order) in [(1, 1), (1, 2), (9, 2), (1, 3)] {
            let building = building(&Soup::room(size, pieces), order);
            let images = Images::new(&building, &source.into());
            let mut arrivals = images.arrivals(&building, &listener.into(), &[]);
            arrivals.sort_by(|a, b| a.length_m.total_cmp(&b.length_m));
            let mut expected = images_of_a_box(size, source, listener, order as i32);
            expected.truncate(if order == 3 { 20 } else { expected.len() });
            assert!(
                order == 3 || arrivals.len() == expected.len(),
                "{} of {}",
                arrivals.len(),
                expected.len()
            );
            for (found, (length_m, bounces)) in arrivals.iter().zip(expected) {
                // A sample is 2.1 cm.
                assert!((found.length_m - length_m).abs() < 0.002, "{} not {length_m} m", found.length_m);
                for (band, db) in found.loss.iter().take(6).enumerate() {
                    let back = 1.0 - SURFACE.absorption[band] - SURFACE.transmission[band];
                    let mirrored = back * (1.0 - SURFACE.scattering[band]);
                    let due = -10.0 * bounces as f32 * mirrored.log10() + air_loss(length_m)[band];
                    assert!((db - due).abs() < 0.02, "band {band}: {db}, not {due} dB");
                }
            }
        }
    }

    /// An L-shaped room: 8 x 8 m without a corner of 4 x 4 m.
    fn l_shaped_room() -> Soup {
        let plan = [[0.0, 0.0], [8.0, 0.0], [8.0, 4.0], [4.0, 4.0], [4.0, 8.0], [0.0, 8.0]];
        let mut soup = Soup::default();
        for (i, [x, z]) in plan.into_iter().enumerate() {
            let [to_x, to_z] = plan[(i + 1) % plan.len()];
            soup.quad([[x, 0.0, z], [to_x, 0.0, to_z], [to_x, 3.0, to_z], [x, 3.0, z]]);
        }
        for y in [0.0, 3.0] {
            soup.quad([[0.0, y, 0.0], [8.0, y, 0.0], [8.0, y, 4.0], [0.0, y, 4.0]]);
            soup.quad([[0.0, y, 4.0], [4.0, y, 4.0], [4.0, y, 8.0], [0.0, y, 8.0]]);
        }
        soup
    }

    #[test]
    fn only_mirrors_visible_from_both_ends_reflect() {
        let building = building(&l_shaped_room(), 1);
        let images = Images::new(&building, &Point3::new(7.0, 1.2, 2.0));
        // The paths by the walls z = 0 and x = 0 pass the corner at (4, 4) at x = 3.59 for z = 4 and at z =
        // 3.60 for x = 4. From the second position the first path passes at x = 4.79, behind the corner, the
        // other at z = 3.57.
        for (listener, lengths_m) in
            [([2.0, 1.2, 6.8], &[10.121_27, 10.2][..]), ([3.5, 1.2, 7.5], &[11.853_27])]
        {
            let arrivals = images.arrivals(&building, &listener.into(), &[]);
            let found: Vec<_> = arrivals.iter().map(|arrival| arrival.length_m).collect();
            assert_eq!(found.len(), lengths_m.len(), "{found:?}");
            assert!(found.iter().zip(lengths_m).all(|(a, b)| (a - b).abs() < 1e-3), "{found:?}");
        }
    }

    #[test]
    fn images_contain_their_plane_sequences() {
        let building = building(&l_shaped_room(), 2);
        let images = Images::new(&building, &Point3::new(7.0, 1.2, 2.0));
        let floor = building.planes.of(12).expect("a floor");
        assert!(images.contains(&[floor]));
        assert!(!images.contains(&[]) && !images.contains(&[floor, floor]) && !images.contains(&[floor; 4]));
        let orders: Vec<_> =
            images.images.iter().map(|image| image.sequence.iter().flatten().count()).collect();
        assert!(orders.contains(&1) && orders.contains(&2) && !orders.contains(&3));
    }

    #[test]
    fn order_zero_has_no_reflections() {
        let building = building(&Soup::room([6.0, 2.7, 5.0], 1), 0);
        let images = Images::new(&building, &Point3::new(1.0, 1.0, 1.0));
        assert!(images.arrivals(&building, &Point3::new(4.0, 1.0, 2.0), &[]).is_empty());
    }
}
