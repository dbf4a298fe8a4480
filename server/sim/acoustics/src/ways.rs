//! Waves without a mirror: direct, diffracted, or transmitted.

use crate::bands::{BandLoss, air_loss, both, diffraction_loss};
use crate::geodesic::{GeodesicField, Way, horizontal_m, length_m};
use crate::impulse::Arrival;
use crate::source::Building;
use crate::surfaces::{SURFACE_BANDS, Surface};
use crate::visibility::{Visibility, visibility};
use avln_geom::{Point3, Vector3};

/// Loss of a silent band, decibels.
pub(crate) const SILENT_DB: f32 = 100.0;

/// Separation of last bends below which two paths count as one, metres; from twice this they count as two.
pub(crate) const APART_M: f32 = 0.5;

/// Longest detour of a second path relative to the shortest, metres.
pub(crate) const LONGER_M: f32 = 3.0;

/// Paths of a source through the air of a building.
pub(crate) struct Ways<'a> {
    pub(crate) building: &'a Building,
    pub(crate) field: &'a GeodesicField,
    pub(crate) outlet: &'a Point3<f32>,
}

impl Ways<'_> {
    /// Returns the direct wave; if the source is hidden, up to two diffracted waves and the transmitted wave,
    /// if audible. The shortest path through the air is first.
    pub(crate) fn arrivals(&self, listener: &Point3<f32>) -> Vec<Arrival> {
        let seen = visibility(self.building.air.rays(), listener, self.outlet);
        if seen.center {
            // At the shadow boundary the diffraction loss fades in with the hidden share.
            let loss = diffraction_loss(0.0).map(|db| db * (1.0 - seen.share));
            return vec![straight(listener, self.outlet, &loss)];
        }
        let mut arrivals = self.around(listener, &seen);
        arrivals.extend(self.through_walls(listener));
        arrivals
    }

    /// The shortest path through the air; `None` if unreachable from `listener`.
    pub(crate) fn shortest(&self, listener: &Point3<f32>) -> Option<Way> {
        let air = &self.building.air;
        let near = air.clear_cells(listener);
        if !near.is_empty() {
            return self.field.way(air, listener, &near);
        }
        // Enclosed or outside: the path of the nearest air.
        let cell = air.nearest_cell(listener)?;
        let mut way = self.field.way(air, &air.grid().center(cell), &[cell])?;
        way.insert(0, *listener);
        Some(way)
    }

    fn around(&self, listener: &Point3<f32>, seen: &Visibility) -> Vec<Arrival> {
        let Some(first) = self.shortest(listener) else { return Vec::new() };
        let hidden = 1.0 - seen.share;
        let mut arrivals = vec![self.bent(&first, hidden, 1.0)];
        let share = (2.0 * hidden - 1.0).max(0.0);
        if share > 0.0
            && let Some(second) = self.field.second_way(&self.building.air, &first)
        {
            let share = share * independence(&first, &second);
            arrivals.extend((share > 0.0).then(|| self.bent(&second, hidden, share)));
        }
        arrivals
    }

    /// The wave on a bent path with the pressure share `share`.
    fn bent(&self, way: &[Point3<f32>], hidden: f32, share: f32) -> Arrival {
        let length_m = length_m(way);
        let detour_m = length_m - (self.outlet - way[0]).norm();
        let faded_db = -20.0 * libm::log10f(share.max(1e-5));
        let border = diffraction_loss(0.0).map(|db| db * (hidden - 1.0) + faded_db);
        let loss = both(&diffraction_loss(detour_m), &border);
        Arrival { direction: first_leg(way), length_m, loss: both(&air_loss(length_m), &loss) }
    }

    /// The wave transmitted through all surfaces; `None` if a surface blocks it.
    fn through_walls(&self, listener: &Point3<f32>) -> Option<Arrival> {
        let (direction, length_m) = bearing(self.outlet, listener);
        let (mut loss, mut from_m) = ([0.0; SURFACE_BANDS], 0.0);
        for crossed in 0..MOST_SURFACES {
            let from = self.outlet + direction * from_m;
            let Some(hit) = self.building.air.rays().cast(&from, &direction, length_m - from_m) else {
                let loss = std::array::from_fn(|band| loss[band.min(SURFACE_BANDS - 1)]);
                // If the line touches an edge, the diffracted wave is sufficient.
                return (crossed > 0).then(|| straight(listener, self.outlet, &loss));
            };
            let surface = self.building.surfaces.of(hit.triangle);
            loss = std::array::from_fn(|band| (loss[band] + transmission_db(surface, band)).min(SILENT_DB));
            from_m += hit.distance + SURFACE_GAP_M;
            if loss.iter().all(|db| *db >= SILENT_DB) {
                return None;
            }
        }
        None
    }
}

/// Limit on consecutive surfaces; more block the wave.
const MOST_SURFACES: usize = 64;

/// Surfaces closer than this count as one, metres.
const SURFACE_GAP_M: f32 = 5e-4;

fn transmission_db(surface: &Surface, band: usize) -> f32 {
    let share = surface.transmission[band];
    if share > 1e-10 { -10.0 * libm::log10f(share) } else { SILENT_DB }
}

/// Weight of a second path as a separate wave, 0 to 1, by direction and length.
fn independence(first: &[Point3<f32>], second: &[Point3<f32>]) -> f32 {
    let apart = horizontal_m(&first[1], &second[1]) / APART_M - 1.0;
    let shorter = 1.0 - (length_m(second) - length_m(first)) / LONGER_M;
    apart.clamp(0.0, 1.0) * shorter.clamp(0.0, 1.0)
}

fn straight(listener: &Point3<f32>, outlet: &Point3<f32>, loss: &BandLoss) -> Arrival {
    let (direction, length_m) = bearing(listener, outlet);
    Arrival { direction, length_m, loss: both(&air_loss(length_m), loss) }
}

/// Unit vector from `from` to `to` and the distance in metres; straight ahead at heading 0 for equal points.
fn bearing(from: &Point3<f32>, to: &Point3<f32>) -> (Vector3<f32>, f32) {
    let offset = to - from;
    let length_m = offset.norm();
    if length_m < 1e-6 { (Vector3::new(0.0, 0.0, -1.0), length_m) } else { (offset / length_m, length_m) }
}

/// Direction in which a path leaves the listener, ignoring adjacent corners.
fn first_leg(way: &[Point3<f32>]) -> Vector3<f32> {
    const NEAR_M: f32 = 0.02;
    let ahead = way[1..].iter().find(|point| (*point - way[0]).norm() > NEAR_M);
    bearing(&way[0], ahead.unwrap_or(&way[way.len() - 1])).0
}

#[cfg(test)]
mod tests;
