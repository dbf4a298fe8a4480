//! Rays that carry source energy through a building.

use super::cells::{CHANNELS, NO_CELL, doublings, slice_count, slice_of};
use crate::air::march;
use crate::building::Building;
use crate::images::{Images, MAX_ORDER};
use crate::planes::PlaneId;
use crate::surfaces::{SURFACE_BANDS, Surface};
use avln_geom::{Hit, Point3, Rng, Vector3, angle};
use std::f32::consts::{PI, TAU};

/// Rays with less initial energy in every band end: -65 dB.
const MIN_ENERGY_SHARE: f32 = 3.2e-7;

/// Bounce limit; only rays trapped in a crack exceed it.
const MAX_BOUNCES: u64 = 1 << 14;

/// Offset from the surface for the next leg, metres.
const OFF_SURFACE_M: f32 = 2e-4;

// Half the rays end at fourfold slice width, half the rest at eightfold width. Survivors count double, so
// every slice has equal statistics. A quarter continues to the end.
const MAX_HALVINGS: u32 = 2;

// Rare transmissions would give uneven statistics in quiet rooms.
const MIN_TRANSMISSION_PROBABILITY: f32 = 0.02;

pub(super) struct Tally {
    /// Row in `sums` per cell, [`NO_CELL`] without rays.
    pub(super) row_of: Vec<u32>,
    /// `rows × bins × CHANNELS`: energy per square metre relative to the source at 1 m, times cubic metres.
    pub(super) sums: Vec<f32>,
    pub(super) bins: usize,
    /// Energy share lost through holes, mean over bands.
    pub(super) lost_share: f32,
}

/// A ray at the start of a leg.
#[derive(Clone, Copy)]
struct Ray {
    index: u64,
    origin: Point3<f32>,
    direction: Vector3<f32>,
    /// Remaining energy share by band.
    weights: [f32; SURFACE_BANDS],
    length_m: f32,
    bounces: u64,
    halvings: u32,
    /// True if the ray passed through the last surface.
    transmitted: bool,
    /// `None` if the path is no discrete wave.
    path: Option<MirrorPath>,
}

impl Ray {
    /// Returns false if the ray ends because slices have become wider; survivors double their weights.
    fn survives(&mut self) -> bool {
        let due = doublings(self.length_m).saturating_sub(1).min(MAX_HALVINGS);
        while self.halvings < due {
            self.halvings += 1;
            self.weights.iter_mut().for_each(|weight| *weight *= 2.0);
        }
        self.index.is_multiple_of(1 << self.halvings)
    }
}

/// A ray's mirror sequence, while it may be a discrete wave.
#[derive(Clone, Copy, Default)]
struct MirrorPath {
    planes: [PlaneId; MAX_ORDER],
    len: usize,
    /// True if the ray passed through surfaces before any mirror.
    transmitted: bool,
}

impl MirrorPath {
    fn mirrored(mut self, plane: Option<PlaneId>) -> Option<Self> {
        let last = self.planes.get_mut(self.len).filter(|_| !self.transmitted)?;
        *last = plane?;
        Some(Self { len: self.len + 1, ..self })
    }

    fn transmitted(self) -> Option<Self> {
        (self.len == 0).then_some(Self { transmitted: true, ..self })
    }

    /// Returns true if this path is rendered as a discrete wave.
    fn is_wave(&self, images: &Images) -> bool {
        self.len == 0 || images.contains(&self.planes[..self.len])
    }
}

/// Traces rays from `outlet`; `key` seeds the random draws.
pub(super) fn trace(building: &Building, outlet: &Point3<f32>, images: &Images, key: u64) -> Tally {
    let bins = slice_count(building.settings.response_s);
    let count = building.settings.ray_count;
    let mut tracer = Tracer {
        building,
        images,
        key,
        reach_m: building.settings.reach_m(),
        energy: 4.0 * PI / count.max(1) as f32,
        tally: Tally { row_of: vec![NO_CELL; building.cells.len()], sums: Vec::new(), bins, lost_share: 0.0 },
    };
    let turn = random_turn(key);
    for index in 0..count {
        tracer.follow(Ray {
            index: index as u64,
            origin: *outlet,
            direction: turn * angle::spread_direction(index, count),
            weights: [1.0; SURFACE_BANDS],
            length_m: 0.0,
            bounces: 0,
            halvings: 0,
            transmitted: false,
            path: Some(MirrorPath::default()),
        });
    }
    tracer.tally.lost_share /= count.max(1) as f32;
    tracer.tally
}

struct Tracer<'a> {
    building: &'a Building,
    images: &'a Images,
    key: u64,
    reach_m: f32,
    energy: f32,
    tally: Tally,
}

impl Tracer<'_> {
    fn follow(&mut self, mut ray: Ray) {
        while ray.length_m < self.reach_m && ray.bounces < MAX_BOUNCES {
            let left_m = self.reach_m - ray.length_m;
            let hit = self.building.air.rays.cast(&ray.origin, &ray.direction, left_m);
            let leg_m = hit.map_or(left_m, |hit| hit.distance);
            let in_air = self.deposit(&ray, leg_m);
            let Some(hit) = hit else {
                self.count_lost(&ray, left_m);
                return;
            };
            ray.length_m += leg_m;
            self.interact(&mut ray, &hit, in_air);
            if !ray.survives() || ray.weights.iter().all(|weight| *weight < MIN_ENERGY_SHARE) {
                return;
            }
        }
    }

    /// Adds a leg to the cells it crosses. Returns true if it crossed room air.
    fn deposit(&mut self, ray: &Ray, leg_m: f32) -> bool {
        let (air, cells) = (&self.building.air, &self.building.cells);
        let counted = !ray.path.is_some_and(|path| path.is_wave(self.images));
        let mut in_air = false;
        let mut run = CellRun { cell: NO_CELL, from_m: 0.0, to_m: 0.0 };
        let (tally, energy) = (&mut self.tally, self.energy);
        march(&air.grid, &ray.origin, &ray.direction, leg_m, |voxel, from_m, to_m| {
            let cell = cells.cell_of[voxel];
            in_air |= cell != NO_CELL || air.in_room[voxel];
            if cell == run.cell {
                run.to_m = to_m;
            } else {
                let done = std::mem::replace(&mut run, CellRun { cell, from_m, to_m });
                if counted {
                    tally.add(ray, &done, energy);
                }
            }
        });
        if counted {
            tally.add(ray, &run, energy);
        }
        in_air
    }

    fn count_lost(&mut self, ray: &Ray, left_m: f32) {
        let end = ray.origin + ray.direction * left_m;
        if !self.building.air.grid.contains(&end) {
            self.tally.lost_share += mean(&ray.weights);
        }
    }

    /// Continues a ray at a surface: transmitted, scattered or mirrored.
    fn interact(&self, ray: &mut Ray, hit: &Hit, in_air: bool) {
        let surface = self.building.surfaces.of(hit.triangle);
        let point = ray.origin + ray.direction * hit.distance;
        let normal = against(&self.building.normals[hit.triangle as usize], &ray.direction);
        let draw = RandomDraws::new(self.key, ray.index, ray.bounces);
        ray.bounces += 1;
        // Inside a wall the ray can only continue to the other side.
        let inside_wall = ray.transmitted && !in_air;
        let interaction =
            if inside_wall { Interaction::Transmitted(1.0) } else { Interaction::draw(surface, draw.choice) };
        ray.transmitted = matches!(interaction, Interaction::Transmitted(_));
        interaction.weigh(surface, &mut ray.weights);
        let side = if ray.transmitted { -normal } else { normal };
        ray.origin = point + side * OFF_SURFACE_M;
        match interaction {
            Interaction::Transmitted(_) => ray.path = ray.path.and_then(MirrorPath::transmitted),
            Interaction::Scattered(_) => {
                ray.path = None;
                ray.direction = lambert(&normal, &draw);
            }
            Interaction::Mirrored(_) => {
                let plane = self.building.planes.of(hit.triangle);
                ray.path = ray.path.and_then(|path| path.mirrored(plane));
                ray.direction = self.mirrored(&ray.direction, plane, &normal);
            }
        }
    }

    // Rays mirror in the fitted plane if possible, so that bumps in scans do not deflect them.
    fn mirrored(
        &self,
        direction: &Vector3<f32>,
        plane: Option<PlaneId>,
        normal: &Vector3<f32>,
    ) -> Vector3<f32> {
        let by_plane = plane.map(|plane| self.building.planes.plane(plane).reflected(direction));
        let outwards = by_plane.filter(|reflected| reflected.dot(normal) > 0.0);
        let reflected = outwards.unwrap_or_else(|| direction - normal * (2.0 * direction.dot(normal)));
        // Rounding must not lengthen directions from bounce to bounce.
        reflected.normalize()
    }
}

/// Part of a leg inside a cell, metres from the leg's start.
struct CellRun {
    cell: u32,
    from_m: f32,
    to_m: f32,
}

impl Tally {
    fn add(&mut self, ray: &Ray, run: &CellRun, energy: f32) {
        if run.cell == NO_CELL {
            return;
        }
        let bin = slice_of(ray.length_m + 0.5 * (run.from_m + run.to_m));
        if bin >= self.bins {
            return;
        }
        let row = self.row(run.cell as usize);
        let first = (row * self.bins + bin) * CHANNELS;
        let amount = energy * (run.to_m - run.from_m);
        let flux = ray.direction * (amount * mean(&ray.weights));
        let (bands, along) = self.sums[first..first + CHANNELS].split_at_mut(SURFACE_BANDS);
        bands.iter_mut().zip(&ray.weights).for_each(|(sum, weight)| *sum += amount * weight);
        along.iter_mut().zip(flux.iter()).for_each(|(sum, part)| *sum += part);
    }

    fn row(&mut self, cell: usize) -> usize {
        if self.row_of[cell] == NO_CELL {
            let width = self.bins * CHANNELS;
            self.row_of[cell] = (self.sums.len() / width) as u32;
            self.sums.resize(self.sums.len() + width, 0.0);
        }
        self.row_of[cell] as usize
    }
}

/// A ray's continuation at a surface, with the probability.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Interaction {
    Transmitted(f32),
    Scattered(f32),
    Mirrored(f32),
}

impl Interaction {
    /// Selects by `choice` in [0, 1). Absorption does not affect the selection.
    fn draw(surface: &Surface, choice: f32) -> Self {
        let through = match mean(&surface.transmission) {
            none if none <= 0.0 => 0.0,
            _ if (0..SURFACE_BANDS).all(|band| surface.reflected(band) <= 0.0) => 1.0,
            some => some.clamp(MIN_TRANSMISSION_PROBABILITY, 1.0 - MIN_TRANSMISSION_PROBABILITY),
        };
        let scattered = (1.0 - through) * likelihood(&surface.scattering);
        let mirrored = 1.0 - through - scattered;
        if choice < through {
            Self::Transmitted(through)
        } else if choice < through + scattered || mirrored <= 0.0 {
            Self::Scattered(scattered)
        } else {
            Self::Mirrored(mirrored)
        }
    }

    /// Corrects the band weights: energy share divided by selection probability.
    fn weigh(self, surface: &Surface, weights: &mut [f32; SURFACE_BANDS]) {
        for (band, weight) in weights.iter_mut().enumerate() {
            let (returned, scattering) = (surface.reflected(band), surface.scattering[band]);
            *weight *= match self {
                Self::Transmitted(likelihood) => surface.transmission[band] / likelihood,
                Self::Scattered(likelihood) => returned * scattering / likelihood,
                Self::Mirrored(likelihood) => returned * (1.0 - scattering) / likelihood,
            };
        }
    }
}

/// The mean share, kept off 0 and 1 if some band is, so that band weights stay bounded.
fn likelihood(shares: &[f32; SURFACE_BANDS]) -> f32 {
    const LEAST: f32 = 0.1;
    let low = if shares.iter().all(|share| *share <= 0.0) { 0.0 } else { LEAST };
    let high = if shares.iter().all(|share| *share >= 1.0) { 1.0 } else { 1.0 - LEAST };
    mean(shares).clamp(low, high)
}

fn mean(values: &[f32; SURFACE_BANDS]) -> f32 {
    values.iter().sum::<f32>() / SURFACE_BANDS as f32
}

/// Three random numbers in [0, 1) per ray and surface.
struct RandomDraws {
    choice: f32,
    cos_squared: f32,
    turn: f32,
}

impl RandomDraws {
    fn new(key: u64, ray: u64, bounce: u64) -> Self {
        let word = Rng::word(key, ray << 20 | bounce);
        let unit = |shift: u32| (word >> shift & 0x1f_ffff) as f32 / (1 << 21) as f32;
        Self { choice: unit(0), cos_squared: unit(21), turn: unit(42) }
    }
}

/// A Lambertian direction around `normal`: the normal plus a random unit vector.
fn lambert(normal: &Vector3<f32>, draw: &RandomDraws) -> Vector3<f32> {
    let height = 1.0 - 2.0 * draw.cos_squared;
    let (sin, cos) = angle::sin_cos(TAU * draw.turn);
    let radius = (1.0 - height * height).max(0.0).sqrt();
    let direction = normal + Vector3::new(radius * cos, height, radius * sin);
    // Opposite to the normal the sum is zero.
    direction.try_normalize(1e-4).unwrap_or(*normal)
}

/// `normal`, turned towards the incoming ray.
fn against(normal: &Vector3<f32>, direction: &Vector3<f32>) -> Vector3<f32> {
    if normal.dot(direction) > 0.0 { -normal } else { *normal }
}

/// A uniformly random rotation (Shoemake 1992, "Uniform random rotations").
fn random_turn(key: u64) -> avln_geom::UnitQuaternion<f32> {
    let mut rng = Rng::new(key);
    let mut unit = || rng.unit() as f32;
    let (share, first, second) = (unit(), angle::sin_cos(TAU * unit()), angle::sin_cos(TAU * unit()));
    let (a, b) = ((1.0 - share).sqrt(), share.sqrt());
    let quaternion = [a * first.0, a * first.1, b * second.0, b * second.1].map(f64::from);
    angle::rotation(quaternion).unwrap_or_default()
}
