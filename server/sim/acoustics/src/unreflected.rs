//! Waves without a mirror: direct, diffracted or transmitted.

use crate::bands::{BandLoss, SILENT_DB, air_loss, both, diffraction_loss};
use crate::building::Building;
use crate::geodesic::{APART_M, AirPath, GeodesicField, LONGER_M, horizontal_m, length_m};
use crate::impulse::Arrival;
use crate::surfaces::{SURFACE_BANDS, Surface};
use avln_geom::{Point3, RayMesh, Vector3, angle};
use std::f32::consts::TAU;

/// A source's unreflected waves.
pub(crate) struct UnreflectedWaves<'a> {
    pub(crate) building: &'a Building,
    pub(crate) field: &'a GeodesicField,
    pub(crate) outlet: &'a Point3<f32>,
}

impl UnreflectedWaves<'_> {
    /// Returns the direct wave; if the source is hidden, up to two diffracted waves and an audible
    /// transmitted wave. The shortest path through the air is first.
    pub(crate) fn arrivals(&self, listener: &Point3<f32>) -> Vec<Arrival> {
        let seen = visibility(&self.building.air.rays, listener, self.outlet);
        if seen.center {
            // At the shadow boundary the diffraction loss fades in with the hidden share.
            let loss = diffraction_loss(0.0).map(|db| db * (1.0 - seen.share));
            return vec![straight(listener, self.outlet, &loss)];
        }
        let mut arrivals = self.around(listener, &seen);
        arrivals.extend(self.through_walls(listener));
        arrivals
    }

    /// Shortest path through the air; `None` if unreachable.
    pub(crate) fn shortest(&self, listener: &Point3<f32>) -> Option<AirPath> {
        let air = &self.building.air;
        let near = air.visible_cells(listener);
        if !near.is_empty() {
            return self.field.path(air, listener, &near);
        }
        // Enclosed or outside: use the path from the nearest air.
        let cell = air.nearest_cell(listener)?;
        let mut path = self.field.path(air, &air.grid.center(cell), &[cell])?;
        path.insert(0, *listener);
        Some(path)
    }

    fn around(&self, listener: &Point3<f32>, seen: &Visibility) -> Vec<Arrival> {
        let Some(first) = self.shortest(listener) else { return Vec::new() };
        let hidden = 1.0 - seen.share;
        let mut arrivals = vec![self.bent(&first, hidden, 1.0)];
        let share = (2.0 * hidden - 1.0).max(0.0);
        if share > 0.0
            && let Some(second) = self.field.second_path(&self.building.air, &first)
        {
            let share = share * independence(&first, &second);
            arrivals.extend((share > 0.0).then(|| self.bent(&second, hidden, share)));
        }
        arrivals
    }

    /// Wave on a bent path with pressure share `share`.
    fn bent(&self, path: &[Point3<f32>], hidden: f32, share: f32) -> Arrival {
        let length_m = length_m(path);
        let detour_m = length_m - (self.outlet - path[0]).norm();
        let faded_db = -20.0 * libm::log10f(share.max(1e-5));
        let border = diffraction_loss(0.0).map(|db| db * (hidden - 1.0) + faded_db);
        let loss = both(&diffraction_loss(detour_m), &border);
        Arrival { direction: first_leg(path), length_m, loss: both(&air_loss(length_m), &loss) }
    }

    /// Wave transmitted through all surfaces; `None` if blocked.
    fn through_walls(&self, listener: &Point3<f32>) -> Option<Arrival> {
        let (direction, length_m) = bearing(self.outlet, listener);
        let (mut loss, mut from_m) = ([0.0; SURFACE_BANDS], 0.0);
        for crossed in 0..MAX_SURFACES {
            let from = self.outlet + direction * from_m;
            let Some(hit) = self.building.air.rays.cast(&from, &direction, length_m - from_m) else {
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
const MAX_SURFACES: usize = 64;

/// Surfaces closer than this count as one, metres.
const SURFACE_GAP_M: f32 = 5e-4;

fn transmission_db(surface: &Surface, band: usize) -> f32 {
    let share = surface.transmission[band];
    if share > 1e-10 { -10.0 * libm::log10f(share) } else { SILENT_DB }
}

/// Weight for a second path as a separate wave, 0 to 1, by direction and length.
fn independence(first: &[Point3<f32>], second: &[Point3<f32>]) -> f32 {
    let apart = horizontal_m(&first[1], &second[1]) / APART_M - 1.0;
    let shorter = 1.0 - (length_m(second) - length_m(first)) / LONGER_M;
    apart.clamp(0.0, 1.0) * shorter.clamp(0.0, 1.0)
}

fn straight(listener: &Point3<f32>, outlet: &Point3<f32>, loss: &BandLoss) -> Arrival {
    let (direction, length_m) = bearing(listener, outlet);
    Arrival { direction, length_m, loss: both(&air_loss(length_m), loss) }
}

/// Unit vector and distance in metres; straight ahead at heading 0 for equal points.
fn bearing(from: &Point3<f32>, to: &Point3<f32>) -> (Vector3<f32>, f32) {
    let offset = to - from;
    let length_m = offset.norm();
    if length_m < 1e-6 { (Vector3::new(0.0, 0.0, -1.0), length_m) } else { (offset / length_m, length_m) }
}

/// Direction in which a path leaves the listener, ignoring adjacent corners.
fn first_leg(path: &[Point3<f32>]) -> Vector3<f32> {
    const NEAR_M: f32 = 0.02;
    let ahead = path[1..].iter().find(|point| (*point - path[0]).norm() > NEAR_M);
    bearing(&path[0], ahead.unwrap_or(&path[path.len() - 1])).0
}

const RAYS: usize = 32;
const RADIUS_M: f32 = 0.3;

/// Visible source share: a soft shadow boundary instead of a switch.
struct Visibility {
    /// True if the centre line is clear.
    center: bool,
    /// Clear share, 0 to 1, among rays with both ends in the same air as the centre line.
    share: f32,
}

fn visibility(rays: &RayMesh, listener: &Point3<f32>, source: &Point3<f32>) -> Visibility {
    let line = source - listener;
    let center = rays.is_clear(listener, source);
    if line.norm() < RADIUS_M {
        return Visibility { center, share: if center { 1.0 } else { 0.0 } };
    }
    let (mut clear, mut counted) = (0, 0);
    for offset in bundle(&line) {
        let (from, to) = (listener + offset, source + offset);
        if rays.is_clear(listener, &from) && rays.is_clear(source, &to) {
            counted += 1;
            clear += usize::from(rays.is_clear(&from, &to));
        }
    }
    let share = if counted == 0 { f32::from(u8::from(center)) } else { clear as f32 / counted as f32 };
    Visibility { center, share }
}

/// Offsets perpendicular to `line`, spread over a disc.
fn bundle(line: &Vector3<f32>) -> impl Iterator<Item = Vector3<f32>> + use<> {
    let up = if line.x.abs() + line.z.abs() > 1e-3 * line.y.abs() { Vector3::y() } else { Vector3::x() };
    let side = line.cross(&up).normalize();
    let top = side.cross(line).normalize();
    (0..RAYS).map(move |ray| {
        let [cos, sin, radius_m] = disc_point(ray, RAYS, RADIUS_M);
        (side * cos + top * sin) * radius_m
    })
}

/// Point `index` of `count` in a sunflower pattern (Vogel 1979): cosine, sine, radius in metres.
pub(crate) fn disc_point(index: usize, count: usize, disc_radius_m: f32) -> [f32; 3] {
    /// Golden angle, turns.
    const GOLDEN_SHARE: f32 = 0.381_966;
    let radius_m = disc_radius_m * ((index as f32 + 0.5) / count as f32).sqrt();
    let (sin, cos) = angle::sin_cos(TAU * GOLDEN_SHARE * index as f32);
    [cos, sin, radius_m]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Settings;
    use crate::tests::{HARD, Soup, building};

    /// A source in a building.
    struct Heard {
        building: Building,
        field: GeodesicField,
        outlet: Point3<f32>,
    }

    impl Heard {
        fn new(soup: &Soup, surface: Surface, outlet: [f32; 3]) -> Self {
            let settings = Settings { reflection_order: 0, ray_count: 0, ..Settings::default() };
            let building = building(soup, surface, settings);
            let outlet = Point3::from(outlet);
            let seeds = building.air.visible_cells(&outlet);
            let field = GeodesicField::new(&building.air, &outlet, &seeds);
            Self { building, field, outlet }
        }

        fn at(&self, x: f32, z: f32) -> Vec<Arrival> {
            let paths =
                UnreflectedWaves { building: &self.building, field: &self.field, outlet: &self.outlet };
            paths.arrivals(&Point3::new(x, 1.0, z))
        }
    }

    /// Total level, octaves from 125 Hz to 4 kHz, decibels relative to 1 m.
    fn level_db(arrivals: &[Arrival]) -> f32 {
        10.0 * arrivals.iter().map(energy).sum::<f32>().log10()
    }

    fn energy(wave: &Arrival) -> f32 {
        wave.loss[..6].iter().map(|db| 10.0_f32.powf(-0.1 * db)).sum::<f32>()
            / (wave.length_m * wave.length_m)
    }

    /// Mean direction.
    fn bearing_of(arrivals: &[Arrival]) -> Vector3<f32> {
        arrivals.iter().map(|wave| wave.direction * energy(wave)).sum::<Vector3<f32>>().normalize()
    }

    /// Azimuth of a direction, degrees from +x towards +z.
    fn azimuth_deg(direction: &Vector3<f32>) -> f32 {
        direction.z.atan2(direction.x).to_degrees()
    }

    /// A flat 2.6 m high with floor and ceiling; `blocks` are walls on the plan, from (x, z) to (x, z).
    fn flat(size: [f32; 2], blocks: &[[[f32; 2]; 2]]) -> Soup {
        let [x, z] = size;
        let mut soup = Soup::default();
        soup.block([-0.2, -0.2, -0.2], [x + 0.2, 0.0, z + 0.2]);
        soup.block([-0.2, 2.6, -0.2], [x + 0.2, 2.8, z + 0.2]);
        let outer = [
            [[-0.2, -0.2], [0.0, z + 0.2]],
            [[x, -0.2], [x + 0.2, z + 0.2]],
            [[0.0, -0.2], [x, 0.0]],
            [[0.0, z], [x, z + 0.2]],
        ];
        for [[x0, z0], [x1, z1]] in outer.iter().chain(blocks) {
            soup.block([*x0, 0.0, *z0], [*x1, 2.6, *z1]);
        }
        soup
    }

    /// Two adjacent rooms, each 4 m long in x; a door from z = 1.0 to 1.9.
    fn two_rooms() -> Soup {
        flat([8.2, 4.0], &[[[4.0, 0.0], [4.2, 1.0]], [[4.0, 1.9], [4.2, 4.0]]])
    }

    /// Two rooms with a second door from z = 3.0 to 3.9.
    fn two_doors() -> Soup {
        flat([8.2, 5.0], &[[[4.0, 0.0], [4.2, 1.0]], [[4.0, 1.9], [4.2, 3.0]], [[4.0, 3.9], [4.2, 5.0]]])
    }

    /// Three rooms in a row with doors at opposite ends.
    fn three_rooms() -> Soup {
        flat(
            [12.0, 4.0],
            &[
                [[3.8, 0.0], [4.0, 0.4]],
                [[3.8, 1.3], [4.0, 4.0]],
                [[7.8, 0.0], [8.0, 2.7]],
                [[7.8, 3.6], [8.0, 4.0]],
            ],
        )
    }

    #[test]
    fn level_and_bearing_are_smooth_through_doorways() {
        let walks = [
            ([5.0, 0.3], [5.0, 3.7]),
            ([7.5, 3.0], [3.0, 1.2]),
            ([4.7, 3.8], [4.7, 0.2]),
            ([7.5, 0.3], [7.5, 3.8]),
            ([7.0, 1.45], [3.0, 1.45]),
        ];
        for source in [[2.5, 1.0, 3.4], [1.0, 1.2, 1.3], [3.0, 0.6, 0.5], [0.5, 1.0, 3.8]] {
            for (soup, walk) in
                [two_rooms(), two_doors()].iter().flat_map(|soup| walks.map(|walk| (soup, walk)))
            {
                let heard = Heard::new(soup, HARD, source);
                let waves: Vec<_> = along(walk).map(|[x, z]| heard.at(x, z)).collect();
                for (pair, place) in waves.windows(2).zip(along(walk)) {
                    let step_db = (level_db(&pair[1]) - level_db(&pair[0])).abs();
                    assert!(step_db <= 1.5, "{step_db} dB within 5 cm at {place:?} from {source:?}");
                    let turn_deg = bearing_of(&pair[0]).angle(&bearing_of(&pair[1])).to_degrees();
                    assert!(turn_deg <= 10.0, "{turn_deg} degrees within 5 cm at {place:?} from {source:?}");
                }
            }
        }
    }

    /// Places 5 cm apart on a straight line.
    fn along((from, to): ([f32; 2], [f32; 2])) -> impl Iterator<Item = [f32; 2]> {
        let steps = ((to[0] - from[0]).hypot(to[1] - from[1]) / 0.05) as usize;
        (0..=steps).map(move |step| {
            [0, 1].map(|axis| from[axis] + (to[axis] - from[axis]) * step as f32 / steps as f32)
        })
    }

    /// Returns true if the first wave at (x, z) comes through a door in the plane x = `wall_x`, within five
    /// degrees.
    fn comes_from(heard: &Heard, [x, z]: [f32; 2], wall_x: f32, door: [f32; 2]) -> bool {
        let azimuth = |at_z: f32| azimuth_deg(&Vector3::new(wall_x - x, 0.0, at_z - z)).rem_euclid(360.0);
        let (one, other) = (azimuth(door[0]), azimuth(door[1]));
        let found = azimuth_deg(&heard.at(x, z)[0].direction).rem_euclid(360.0);
        (one.min(other) - 5.0..=one.max(other) + 5.0).contains(&found)
    }

    #[test]
    fn first_waves_arrive_from_the_last_door() {
        let one = Heard::new(&two_rooms(), HARD, [2.5, 1.0, 3.4]);
        for place in [[5.5, 3.0], [6.0, 3.5], [7.5, 3.6], [5.0, 3.2], [7.8, 0.3]] {
            assert!(comes_from(&one, place, 4.2, [1.0, 1.9]), "{place:?}");
        }
        for source in [[1.0, 1.0, 3.0], [2.0, 1.5, 0.5], [3.0, 0.5, 3.5]] {
            let two = Heard::new(&three_rooms(), HARD, source);
            for place in [[9.0, 0.5], [11.0, 3.5], [11.5, 0.3], [8.5, 2.0]] {
                assert!(comes_from(&two, place, 8.0, [2.7, 3.6]), "{place:?} from {source:?}");
            }
        }
    }

    #[test]
    fn two_doorways_emit_two_waves() {
        let heard = Heard::new(&two_doors(), HARD, [1.0, 1.0, 2.45]);
        // Both doors are equally distant: (1, 2.45) to the jambs at z = 1.9 and z = 3.0 and on.
        let waves = heard.at(7.2, 2.45);
        let path_m = 2.0 * 3.0_f32.hypot(0.55) + 0.2;
        assert_eq!(waves.len(), 2);
        for wave in &waves {
            assert!((-0.01..0.05).contains(&(wave.length_m - path_m)), "{} m, not {path_m} m", wave.length_m);
        }
        let azimuths = [0, 1].map(|wave| azimuth_deg(&waves[wave].direction).abs());
        let jamb_deg = 180.0 - 0.55_f32.atan2(3.0).to_degrees();
        assert!(azimuths.iter().all(|azimuth| (azimuth - jamb_deg).abs() < 1.5), "{azimuths:?}");
        assert!((waves[0].direction.z + waves[1].direction.z).abs() < 0.03);
        // A single door allows a single path, regardless of furniture.
        let mut furnished = two_rooms();
        furnished.block([5.2, 0.0, 2.6], [6.2, 0.7, 3.4]);
        assert_eq!(Heard::new(&furnished, HARD, [2.5, 1.0, 3.4]).at(7.0, 3.2).len(), 1);
    }

    #[test]
    fn deeper_shadows_lose_more_high_frequencies() {
        let heard = Heard::new(&two_rooms(), HARD, [2.5, 1.0, 3.4]);
        let tilts: Vec<_> = (0..8)
            .map(|step| 1.3 + 0.3 * step as f32)
            .map(|z| heard.at(4.9, z)[0].loss)
            .map(|loss| loss[5] - loss[0])
            .collect();
        assert!(tilts.is_sorted(), "{tilts:?}");
        assert!(tilts[0] < 5.0 && tilts[7] > 12.0, "{tilts:?}");
    }

    #[test]
    fn transmission_passes_both_wall_surfaces() {
        let closed = flat([8.2, 4.0], &[[[4.0, 0.0], [4.2, 4.0]]]);
        assert!(Heard::new(&closed, HARD, [2.0, 1.0, 2.0]).at(6.0, 2.0).is_empty());
        let thin = Surface { transmission: [0.1, 0.03, 0.01, 0.003, 0.001, 0.0], ..HARD };
        let waves = Heard::new(&closed, thin, [2.0, 1.0, 2.0]).at(6.0, 2.0);
        assert_eq!(waves.len(), 1);
        assert!((waves[0].length_m - 4.0).abs() < 1e-4 && waves[0].direction.x < -0.999);
        let air = air_loss(4.0);
        for (band, due_db) in [20.0, 30.458, 40.0, 50.458, 60.0, SILENT_DB, SILENT_DB].into_iter().enumerate()
        {
            assert!(
                (waves[0].loss[band] - air[band] - due_db).abs() < 0.01,
                "band {band}: {}",
                waves[0].loss[band]
            );
        }
    }

    #[test]
    fn storeys_connect_through_the_stairwell() {
        // Two storeys of 6 x 4 m; the slab between them ends 1.2 m before the wall x = 6.
        let mut house = flat([6.0, 4.0], &[]);
        let upper: Vec<_> = house.corners.iter().map(|[x, y, z]| [*x, y + 2.8, *z]).collect();
        house.corners.retain(|corner| corner[1] < 2.5);
        house.corners.extend(upper.into_iter().filter(|corner| corner[1] > 2.9));
        house.block([-0.2, 2.6, -0.2], [4.8, 2.8, 4.2]);
        let heard = Heard::new(&house, HARD, [1.5, 4.0, 2.0]);
        let wave = &heard.at(1.5, 2.0)[0];
        // Around both edges of the slab at x = 4.8: 3.3 m horizontal and 1.6 m up, 0.2 m, then 3.3 m horizontal
        // and 1.2 m up.
        let path_m = 3.3_f32.hypot(1.6) + 0.2 + 3.3_f32.hypot(1.2);
        assert!((-0.02..0.06).contains(&(wave.length_m - path_m)), "{} m, not {path_m} m", wave.length_m);
        let elevation_deg = wave.direction.y.asin().to_degrees();
        assert!((elevation_deg - 1.6_f32.atan2(3.3).to_degrees()).abs() < 3.0, "{elevation_deg}");
    }
}
