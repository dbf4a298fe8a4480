//! Shading: colour, depth and instance by pixel.

use crate::camera::CameraImage;
use crate::model::{BLOCK, LEVEL_BITS, Level, ModelView, NO_TEXTURE};
use crate::raster::{Scratch, ShadingRecords};
use avln_scene::InstanceId;
use avln_simd::Work;

const WHITE: u32 = u32::MAX;
/// Pixels per run.
const RUN: usize = 64;

/// Conversion from the depth buffer to an image.
pub(crate) struct Shader<'a> {
    pub(crate) view: ModelView<'a>,
    pub(crate) depth_max_m: f32,
    pub(crate) scratch: &'a Scratch,
    /// Output, with lists of full length.
    pub(crate) frame: &'a mut CameraImage,
}

/// Adjacent pixels in a row.
struct Run {
    /// Reciprocal depth, 1/metres; 0 for background.
    nearness: [f32; RUN],
    record: [u32; RUN],
    /// Planar depth, metres; 0 for background.
    depth_m: [f32; RUN],
    u: [f32; RUN],
    v: [f32; RUN],
    /// Texture level, both words; see [`ModelView::levels`].
    level: [[u32; RUN]; 2],
    /// RGB.
    tint: [u32; RUN],
    instance: [u32; RUN],
    /// RGBA: the texture, in the end the surface.
    color: [u32; RUN],
}

impl Work for Shader<'_> {
    type Output = ();

    #[inline(always)]
    fn run(mut self) {
        let screen = &self.scratch.screen;
        let (width, height) = (screen.width, screen.height);
        let mut run = Run::default();
        for row in 0..height {
            for column in (0..width).step_by(RUN) {
                let count = RUN.min(width - column);
                run.take(self.scratch, row * screen.stride + column, count);
                let looks = self.place(&mut run, [column, row], count);
                if looks.is_textured {
                    sample(self.view.texels, &mut run, count);
                } else {
                    run.color = [WHITE; RUN];
                }
                if looks.is_tinted {
                    run.tint_all();
                }
                self.write(&run, row * width + column, count);
            }
        }
    }
}

/// Required colour inputs of a run.
struct ColourInputs {
    is_textured: bool,
    is_tinted: bool,
}

impl Shader<'_> {
    /// Computes texture coordinates, tints and instances.
    #[inline(always)]
    fn place(&self, run: &mut Run, [column, row]: [usize; 2], count: usize) -> ColourInputs {
        let records = &self.scratch.records;
        let (first_x, y) = (column as i32, row as i32 as f32);
        let mut looks = ColourInputs { is_textured: false, is_tinted: false };
        for i in 0..count {
            let number = run.record[i] as usize;
            let ([ux, uy, u, vx, vy, v, texels, _], meta) = (&records.planes[number], &records.meta[number]);
            let (x, depth_m) = ((first_x + i as i32) as f32, run.depth_m[i]);
            run.u[i] = (ux * x + (uy * y + u)) * depth_m;
            run.v[i] = (vx * x + (vy * y + v)) * depth_m;
            let level = level_of(texels * (depth_m * depth_m * depth_m), meta.texture);
            let level = &self.view.levels[level as usize];
            (run.level[0][i], run.level[1][i]) = (level[0], level[1]);
            run.instance[i] = meta.instance;
            run.tint[i] = if meta.is_even() {
                meta.tint
            } else {
                varying_tint(&records.tints[meta.tint as usize], [x, y, depth_m])
            };
            looks.is_textured |= meta.texture != NO_TEXTURE;
            looks.is_tinted |= run.tint[i] != WHITE;
        }
        looks
    }

    /// Writes pixels from index `first`.
    #[inline(always)]
    fn write(&mut self, run: &Run, first: usize, count: usize) {
        let pixels = first..first + count;
        for (out, &depth_m) in self.frame.depth[pixels.clone()].iter_mut().zip(&run.depth_m) {
            *out = if depth_m <= self.depth_max_m { depth_m } else { 0.0 };
        }
        for (out, &instance) in self.frame.instances[pixels.clone()].iter_mut().zip(&run.instance) {
            *out = InstanceId(instance);
        }
        let backdrop = self.view.whole[0];
        let rgb = &mut self.frame.rgb.as_chunks_mut::<3>().0[pixels];
        for ((out, &color), &nearness) in rgb.iter_mut().zip(&run.color).zip(&run.nearness) {
            let [red, green, blue, _] = if nearness > 0.0 { color } else { backdrop }.to_le_bytes();
            *out = [red, green, blue];
        }
    }
}

/// Returns RGB from planes over depth.
#[inline(always)]
fn varying_tint(planes: &[f32; 9], [column, row, depth_m]: [f32; 3]) -> u32 {
    let channel = |first: usize| {
        let value = (planes[first] * column + (planes[first + 1] * row + planes[first + 2])) * depth_m;
        rounded(if value > 0.0 { if value < 255.0 { value } else { 255.0 } } else { 0.0 })
    };
    channel(0) | channel(3) << 8 | channel(6) << 16
}

impl Default for Run {
    fn default() -> Self {
        let zeros = [0.0; RUN];
        let numbers = [0; RUN];
        Self {
            nearness: zeros,
            record: numbers,
            depth_m: zeros,
            u: zeros,
            v: zeros,
            level: [numbers; 2],
            tint: numbers,
            instance: numbers,
            color: numbers,
        }
    }
}

impl Run {
    #[inline(always)]
    fn tint_all(&mut self) {
        for (color, &tint) in self.color.iter_mut().zip(&self.tint) {
            *color = modulate(*color, tint);
        }
    }

    /// Loads `count` screen pixels.
    #[inline(always)]
    fn take(&mut self, from: &Scratch, first: usize, count: usize) {
        self.nearness[..count].copy_from_slice(&from.screen.nearness[first..first + count]);
        self.record[..count].copy_from_slice(&from.screen.record[first..first + count]);
        for i in 0..RUN {
            let is_seen = self.nearness[i] > 0.0;
            self.depth_m[i] = if is_seen { 1.0 / self.nearness[i] } else { 0.0 };
            self.record[i] = if is_seen { self.record[i] } else { ShadingRecords::NOTHING };
        }
    }
}

/// Returns true if a surface with holes is solid at a pixel (column, row, reciprocal depth).
#[inline(always)]
pub(crate) fn is_solid(
    view: &ModelView,
    surface: u32,
    planes: &[f32; 8],
    [column, row]: [f32; 2],
    nearness: f32,
) -> bool {
    let [base, texture, cutoff, _] = view.materials[view.surfaces[surface as usize][0] as usize];
    let depth_m = 1.0 / nearness;
    let value = |at: usize| (planes[at] * column + (planes[at + 1] * row + planes[at + 2])) * depth_m;
    let level = level_of(planes[6] * (depth_m * depth_m * depth_m), texture);
    let alpha = sample_one(view.texels, [value(0), value(3)], view.levels[level as usize]) >> 24;
    alpha * (base >> 24) >= cutoff * 255
}

const SIDE: u32 = BLOCK as u32;
const AREA: u32 = SIDE * SIDE;

/// Returns the texture level with texels about as large as a pixel, for `footprint` full-size texels per
/// pixel: half of log2(`footprint`), rounded and clamped.
#[inline(always)]
fn level_of(footprint: f32, texture: u32) -> u32 {
    // A float's exponent is log2 rounded down; values below 1 and NaN are clamped.
    let log2 = (footprint.to_bits() >> 23) as i32 - 127;
    let level = (log2 + 1) >> 1;
    let last = (texture & ((1 << LEVEL_BITS) - 1)) as i32 - 1;
    let level = if level < last { level } else { last };
    (texture >> LEVEL_BITS) + (if level > 0 { level } else { 0 }) as u32
}

/// Looks `count` pixels up, bilinearly.
#[inline(always)]
fn sample(texels: &[u32], run: &mut Run, count: usize) {
    let mut at = [[0; RUN]; 4];
    let mut weight = [[0; RUN]; 2];
    for i in 0..RUN {
        let found = Neighbours::new([run.u[i], run.v[i]], [run.level[0][i], run.level[1][i]]);
        at[0][i] = found.at[0];
        at[1][i] = found.at[1];
        at[2][i] = found.at[2];
        at[3][i] = found.at[3];
        weight[0][i] = found.across;
        weight[1][i] = found.down;
    }
    let mut texel = [[0; RUN]; 4];
    for i in 0..count {
        for corner in 0..4 {
            texel[corner][i] = texels.get(at[corner][i] as usize).copied().unwrap_or(WHITE);
        }
    }
    for i in 0..RUN {
        let above = mix(texel[0][i], texel[1][i], weight[0][i]);
        let below = mix(texel[2][i], texel[3][i], weight[0][i]);
        run.color[i] = mix(above, below, weight[1][i]);
    }
}

fn sample_one(texels: &[u32], uv: [f32; 2], level: Level) -> u32 {
    let Neighbours { at, across, down } = Neighbours::new(uv, level);
    let [a, b, c, d] = at.map(|at| texels.get(at as usize).copied().unwrap_or(WHITE));
    mix(mix(a, b, across), mix(c, d, across), down)
}

/// Four texels around a position; weights of the right and lower ones, 0 to 255 of 256.
struct Neighbours {
    /// Upper left, upper right, lower left, lower right.
    at: [u32; 4],
    across: u32,
    down: u32,
}

impl Neighbours {
    #[inline(always)]
    fn new([u, v]: [f32; 2], [first, size]: Level) -> Self {
        let (width, height) = (size & 0xffff, size >> 16);
        let blocks = width.div_ceil(SIDE);
        let (left, right, across) = along(u, width);
        let (upper, lower, down) = along(v, height);
        // Background pixels are processed too, with arbitrary values.
        let in_row = |x: u32| (x / SIDE).wrapping_mul(AREA).wrapping_add(x % SIDE);
        let in_column = |y: u32| {
            let block = (y / SIDE).wrapping_mul(blocks).wrapping_mul(AREA);
            first.wrapping_add(block).wrapping_add(y % SIDE * SIDE)
        };
        let (left, right, upper, lower) = (in_row(left), in_row(right), in_column(upper), in_column(lower));
        let sum = |row: u32, column: u32| row.wrapping_add(column);
        Self { at: [sum(upper, left), sum(upper, right), sum(lower, left), sum(lower, right)], across, down }
    }
}

/// Returns the two texels around a repeating coordinate, and the second's weight, 0 to 255.
#[inline(always)]
fn along(coordinate: f32, count: u32) -> (u32, u32, u32) {
    // Texel centres are half a texel (128 of 256 steps) after their start.
    let steps = rounded(fraction(coordinate) * (count as i32 as f32 * 256.0)) + 128;
    let second = steps >> 8;
    let second = if second < count { second } else { 0 };
    let first = (if second == 0 { count } else { second }).wrapping_sub(1);
    (first, second, steps & 255)
}

/// Fractional part, 0 to 1; 0 for NaN.
#[inline(always)]
fn fraction(value: f32) -> f32 {
    // Floats of this size have no binary places, so adding it rounds.
    const ROUNDER: f32 = 12_582_912.0;
    let nearest = (value + ROUNDER) - ROUNDER;
    let floor = nearest - if nearest > value { 1.0 } else { 0.0 };
    let within = value - floor;
    let within = if within > 0.0 { within } else { 0.0 };
    if within < 1.0 { within } else { 1.0 }
}

/// Rounds a value between 0 and 2^23; cheaper than a checked cast.
#[inline(always)]
fn rounded(value: f32) -> u32 {
    // From 2^23 on floats are whole and end with the number's bits.
    const WHOLE: f32 = 8_388_608.0;
    (value + WHOLE).to_bits() & 0x007f_ffff
}

const EVEN: u32 = 0x00ff_00ff;
const HALVES: u32 = 0x0080_0080;

/// Mixes two colours of four bytes: `weight` of 256 parts of the second.
#[inline(always)]
fn mix(a: u32, b: u32, weight: u32) -> u32 {
    let rest = 256 - weight;
    let even = (a & EVEN) * rest + (b & EVEN) * weight + HALVES;
    let odd = (a >> 8 & EVEN) * rest + (b >> 8 & EVEN) * weight + HALVES;
    (even >> 8 & EVEN) | (odd & !EVEN)
}

/// Returns the rounded RGB product; 255 is one.
#[inline(always)]
pub(crate) fn modulate(a: u32, b: u32) -> u32 {
    let channel = |shift: u32| {
        let product = (a >> shift & 255) * (b >> shift & 255) + 128;
        // Blinn, "Three wrongs make a right" (1995): the product over 255, rounded.
        (product + (product >> 8)) >> 8
    };
    channel(0) | channel(8) << 8 | channel(16) << 16
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Red channel of a single-level texture.
    fn red_at(values: &[u32], [width, height]: [u32; 2], u: f32, v: f32) -> u32 {
        let blocks = width.div_ceil(SIDE);
        let mut texels = vec![0; (blocks * height.div_ceil(SIDE) * AREA) as usize];
        for (at, &value) in values.iter().enumerate() {
            let (x, y) = (at % width as usize, at / width as usize);
            let block = y / BLOCK * blocks as usize + x / BLOCK;
            texels[block * BLOCK * BLOCK + y % BLOCK * BLOCK + x % BLOCK] = value;
        }
        let level = [0, width | height << 16];
        let mut run =
            Run { u: [u; RUN], v: [v; RUN], level: level.map(|value| [value; RUN]), ..Run::default() };
        sample(&texels, &mut run, RUN);
        assert_eq!(run.color[RUN - 1], sample_one(&texels, [u, v], level));
        run.color[0]
    }

    #[test]
    fn texel_centres_are_exact_and_borders_are_means() {
        let at = |u, v| red_at(&[0, 100, 200, 40], [2, 2], u, v);
        assert_eq!([at(0.25, 0.25), at(0.75, 0.25), at(0.25, 0.75), at(0.75, 0.75)], [0, 100, 200, 40]);
        assert_eq!([at(0.5, 0.25), at(0.25, 0.5), at(0.5, 0.5)], [50, 100, 85]);
        assert_eq!(at(0.0, 0.25), 50, "the first texel's neighbour to the left is the last one");
    }

    #[test]
    fn textures_repeat_in_all_directions() {
        let at = |u, v| red_at(&[10, 20, 30, 40, 50, 60, 70, 80, 90, 15, 25, 35], [6, 2], u, v);
        for (u, v) in [(0.2, 0.3), (0.9, 0.1), (0.5, 0.75)] {
            for (du, dv) in [(1.0, 0.0), (-1.0, 2.0), (-7.0, -3.0), (100.0, 5.0)] {
                assert!(at(u + du, v + dv).abs_diff(at(u, v)) <= 1);
            }
        }
        for odd in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, -1e-30, 1e7] {
            at(odd, odd);
        }
    }

    #[test]
    fn levels_follow_the_footprint() {
        let level = |footprint, levels: u32| level_of(footprint, 7 << LEVEL_BITS | levels);
        assert_eq!([1.0, 4.0, 64.0, 1e9].map(|footprint| level(footprint, 9)), [7, 8, 10, 15]);
        assert_eq!([0.0, 0.1, f32::NAN].map(|footprint| level(footprint, 9)), [7, 7, 15]);
        assert_eq!(level(f32::INFINITY, 1), 7);
    }

    #[test]
    fn fractions_rounding_and_mixing_are_exact() {
        for (value, expected) in
            [(0.25, 0.25), (-0.25, 0.75), (7.5, 0.5), (-3.0, 0.0), (8.0, 0.0), (-2.5, 0.5)]
        {
            assert_eq!(fraction(value), expected, "{value}");
        }
        for (value, expected) in [(0.0, 0), (0.4, 0), (0.6, 1), (254.7, 255), (4_194_304.0, 4_194_304)] {
            assert_eq!(rounded(value), expected, "{value}");
        }
        assert_eq!(mix(0xff00_8001, 0xff00_8001, 77), 0xff00_8001);
        assert_eq!(mix(0x00ff_0000, 0xff00_ff64, 128), 0x8080_8032);
        for (a, b) in (0..=255).flat_map(|a| [0, 1, 77, 254, 255].map(|b| (a, b))) {
            let expected = (f64::from(a * b) / 255.0).round() as u32;
            assert_eq!(modulate(a << 8, b << 8), expected << 8);
        }
    }
}
