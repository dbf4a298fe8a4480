//! Shading records: texture coordinates, tint and instance by visible triangle.

use super::batch::{Batch, Plane, Planes, planes};
use super::{Raster, Scratch};
use crate::lanes::{Floats, LANES, Numbers};
use crate::model::{CLUSTER, HOLED, LEVEL_BITS, ModelView, NO_TEXTURE};
use crate::shade;
use std::array::from_fn;

/// Flag of constant tints (RGB); other tints index [`ShadingRecords::tints`].
const TINT_IS_EVEN: u32 = 0xff00_0000;

/// Records in drawing order; the first is the background.
#[derive(Default)]
pub(crate) struct ShadingRecords {
    /// Planes of u and v over depth (x, y, constant), full-size texels per pixel at one metre (scales with
    /// depth cubed), and 0.
    pub(crate) planes: Vec<[f32; 8]>,
    pub(crate) meta: Vec<Meta>,
    /// Planes of red, green and blue, 0 to 255, over depth.
    pub(crate) tints: Vec<[f32; 9]>,
    /// Visible triangles of the current cluster without a record, in drawing order.
    kept: Vec<u8>,
}

/// A triangle's constant shading data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Meta {
    /// See [`ModelView::materials`].
    pub(crate) texture: u32,
    /// Constant colour, or an index into [`ShadingRecords::tints`].
    pub(crate) tint: u32,
    pub(crate) instance: u32,
}

/// u and v as bits, and RGB.
type Corner = [u32; 3];

impl Meta {
    pub(crate) const NONE: Self = Self { texture: NO_TEXTURE, tint: u32::MAX, instance: 0 };

    /// Returns the data for corner colours; varying tints are numbered later.
    #[inline(always)]
    fn new(view: &ModelView, surface: u32, [a, b, c]: [u32; 3]) -> Self {
        let [material, instance] = view.surfaces[surface as usize];
        let [base, texture, ..] = view.materials[material as usize];
        let tint = if a == b && b == c { shade::modulate(a, base) | TINT_IS_EVEN } else { 0 };
        Self { texture, tint, instance }
    }

    #[inline(always)]
    pub(crate) fn is_even(&self) -> bool {
        self.tint & TINT_IS_EVEN != 0
    }

    /// Returns the full-size texel count.
    #[inline(always)]
    fn texels(&self, view: &ModelView) -> f32 {
        let [_, size] = view.levels[(self.texture >> LEVEL_BITS) as usize];
        (size & 0xffff) as i32 as f32 * (size >> 16) as i32 as f32
    }
}

/// Returns the material's RGB, 0 to 1.
fn base_color(view: &ModelView, surface: u32) -> [f32; 3] {
    let [material, _] = view.surfaces[surface as usize];
    let [r, g, b, _] = view.materials[material as usize][0].to_le_bytes();
    [r, g, b].map(|value| f32::from(value) / 255.0)
}

/// Returns the corners and surface of triangle `at`.
#[inline(always)]
pub(super) fn corners(view: &ModelView, cluster: usize, at: usize) -> ([Corner; 3], u32) {
    let [_, first_corner, first, _] = view.clusters[cluster];
    let [corners, surface] = view.triangles[first as usize + at];
    let [a, b, c, _] = corners.to_le_bytes();
    (from_fn(|corner| view.corners[first_corner as usize + usize::from([a, b, c][corner])]), surface)
}

/// Rounds to an integer; returns large values unchanged.
#[inline(always)]
fn nearest_whole(value: f32) -> f32 {
    // Floats of this size have no binary places, so adding it rounds.
    const ROUNDER: f32 = 12_582_912.0;
    (value + ROUNDER) - ROUNDER
}

/// Corner attributes of eight triangles; unused lanes are undefined.
#[derive(Default)]
struct CornerAttributes {
    u: [Floats; 3],
    v: [Floats; 3],
    rgb: [Numbers; 3],
    surface: Numbers,
}

impl CornerAttributes {
    /// Loads triangles `numbers` of a batch.
    #[inline(always)]
    fn new(view: &ModelView, cluster: usize, numbers: &[u8]) -> Self {
        let mut looks = Self::default();
        for at in numbers.iter().map(|&at| usize::from(at)) {
            let (corners, surface) = corners(view, cluster, at);
            let lane = at % LANES;
            for (corner, [u, v, rgb]) in corners.into_iter().enumerate() {
                looks.u[corner].0[lane] = f32::from_bits(u);
                looks.v[corner].0[lane] = f32::from_bits(v);
                looks.rgb[corner].0[lane] = rgb;
            }
            looks.surface.0[lane] = surface;
        }
        looks
    }
}

// Textures repeat, so an integer shift towards 0 is free and gains precision.
#[inline(always)]
fn near_zero([a, b, c]: [Floats; 3]) -> [Floats; 3] {
    let whole = Floats(from_fn(|lane| nearest_whole(a.0[lane])));
    [a - whole, b - whole, c - whole]
}

impl ShadingRecords {
    pub(super) fn clear(&mut self) {
        self.planes.clear();
        self.meta.clear();
        self.tints.clear();
        self.kept.clear();
        self.planes.push([0.0; 8]);
        self.meta.push(Meta::NONE);
    }

    /// Background record.
    pub(crate) const NOTHING: u32 = 0;

    #[inline(always)]
    pub(super) fn next(&self) -> u32 {
        (self.planes.len() + self.kept.len()) as u32
    }

    /// Adds a record; `tint` computes the colour planes if needed.
    #[inline(always)]
    fn add(&mut self, [u, v]: [Plane; 2], texels: f32, mut meta: Meta, tint: impl FnOnce() -> [Plane; 3]) {
        self.planes.push([u.x, u.y, u.constant, v.x, v.y, v.constant, texels, 0.0]);
        if !meta.is_even() {
            meta.tint = self.tints.len() as u32;
            let [r, g, b] = tint();
            self.tints.push([r.x, r.y, r.constant, g.x, g.y, g.constant, b.x, b.y, b.constant]);
        }
        self.meta.push(meta);
    }
}

impl Raster<'_> {
    /// Draws the waiting triangles; the visible ones await a record.
    #[inline(always)]
    pub(super) fn draw_waiting(&mut self, cluster: usize) {
        let [_, _, first, _] = self.view.clusters[cluster];
        for next in 0..self.scratch.waiting.len() {
            let Scratch { screen, records, waiting, batches, .. } = &mut *self.scratch;
            let (at, pixels) = waiting[next];
            let [corners, surface] = self.view.triangles[first as usize + usize::from(at)];
            let setup = batches[usize::from(at) / LANES].setup(usize::from(at) % LANES, pixels);
            let number = records.next();
            if corners & HOLED != 0 {
                // Holes depend on the texture, which needs a record.
                records.kept.push(at);
                self.make_records(cluster);
                self.fill_holed(&setup, surface, number);
            } else if screen.fill(&setup, number) {
                records.kept.push(at);
            }
        }
        self.scratch.waiting.clear();
    }

    /// Makes records for the visible triangles.
    #[inline(always)]
    pub(super) fn make_records(&mut self, cluster: usize) {
        let kept = std::mem::take(&mut self.scratch.records.kept);
        for kept in kept.chunk_by(|one, next| usize::from(*one) / LANES == usize::from(*next) / LANES) {
            self.make_records_of_batch(cluster, usize::from(kept[0]) / LANES, kept);
        }
        self.scratch.records.kept = kept;
        self.scratch.records.kept.clear();
    }

    #[inline(always)]
    fn make_records_of_batch(&mut self, cluster: usize, which: usize, kept: &[u8]) {
        let view = self.view;
        let looks = CornerAttributes::new(&view, cluster, kept);
        let Scratch { records, batches, .. } = &mut *self.scratch;
        let batch = &batches[which];
        let [u, v] = [near_zero(looks.u), near_zero(looks.v)];
        let (u_plane, v_plane) = (batch.over_depth(u), batch.over_depth(v));
        let [na, nb, nc] = batch.nearness;
        let double_area = ((u[1] - u[0]) * (v[2] - v[0]) - (u[2] - u[0]) * (v[1] - v[0])).abs();
        let shares = double_area * (batch.inverse.abs() * na * nb * nc);
        let mut tints = None;
        for lane in kept.iter().map(|&lane| usize::from(lane) % LANES) {
            let surface = looks.surface.0[lane];
            let [a, b, c] = &looks.rgb;
            let meta = Meta::new(&view, surface, [a.0[lane], b.0[lane], c.0[lane]]);
            let texels = shares.0[lane] * meta.texels(&view);
            let tint = || {
                let planes: &[Planes; 3] = tints.get_or_insert_with(|| batch.tints(&looks.rgb));
                let base = base_color(&view, surface);
                from_fn(|channel| planes[channel].lane(lane).times(base[channel]))
            };
            records.add([u_plane.lane(lane), v_plane.lane(lane)], texels, meta, tint);
        }
    }

    /// Makes the record of a triangle across the near plane: `plane` computes planes over depth from corner
    /// values, `per_area` scales screen areas.
    pub(super) fn make_crossing_record(
        &mut self,
        cluster: usize,
        at: usize,
        plane: impl Fn([f32; 3]) -> Plane,
        per_area: f32,
    ) {
        let view = self.view;
        let (corners, surface) = corners(&view, cluster, at);
        let meta = Meta::new(&view, surface, corners.map(|[.., rgb]| rgb));
        let uv = [0, 1].map(|value: usize| {
            let whole = nearest_whole(f32::from_bits(corners[0][value]));
            corners.map(|corner| f32::from_bits(corner[value]) - whole)
        });
        let [[ua, ub, uc], [va, vb, vc]] = uv;
        let double_area = ((ub - ua) * (vc - va) - (uc - ua) * (vb - va)).abs();
        let base = base_color(&view, surface);
        let tint = || {
            from_fn(|channel| {
                plane(corners.map(|[.., rgb]| f32::from(rgb.to_le_bytes()[channel]) * base[channel]))
            })
        };
        let texels = double_area * meta.texels(&view) * per_area;
        self.scratch.records.add(uv.map(&plane), texels, meta, tint);
    }
}

impl Batch {
    /// Returns the planes over depth through corner values.
    #[inline(always)]
    fn over_depth(&self, [a, b, c]: [Floats; 3]) -> Planes {
        let [na, nb, nc] = self.nearness;
        planes(&self.corners, self.inverse, [a * na, b * nb, c * nc])
    }

    /// Returns the planes of red, green and blue over depth.
    #[inline(always)]
    fn tints(&self, rgb: &[Numbers; 3]) -> [Planes; 3] {
        from_fn(|channel| {
            let of_corner = |corner: usize| {
                Floats(from_fn(|lane| (rgb[corner].0[lane] >> (8 * channel) & 0xff) as i32 as f32))
            };
            self.over_depth([of_corner(0), of_corner(1), of_corner(2)])
        })
    }
}

const _: () = assert!(CLUSTER <= 256, "triangles of a cluster are numbered by bytes");
