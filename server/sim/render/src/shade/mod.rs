//! Shading: colour, depth and instance of every pixel from its hit.

mod sample;

use crate::camera::CameraImage;
use crate::model::{ModelView, NO_TEXTURE};
use crate::raster::{Scratch, ShadingRecords};
use avln_scene::InstanceId;
use avln_simd::Work;
pub(crate) use sample::modulate;
use sample::{level_of, rounded, sample, sample_one};

const WHITE: u32 = u32::MAX;
/// Pixels that are worked on at a time.
const RUN: usize = 64;

/// Writes an image from the depth buffer.
pub(crate) struct Shader<'a> {
    pub(crate) view: ModelView<'a>,
    pub(crate) depth_max_m: f32,
    pub(crate) scratch: &'a Scratch,
    /// Output with lists of the right length.
    pub(crate) frame: &'a mut CameraImage,
}

/// Adjacent pixels of a row.
struct Run {
    /// Reciprocal depth, 1/metres; 0 for background.
    nearness: [f32; RUN],
    /// Shading records.
    swatch: [u32; RUN],
    /// Planar depth, metres; 0 for background.
    depth_m: [f32; RUN],
    /// Texture coordinates.
    u: [f32; RUN],
    v: [f32; RUN],
    /// Texture level, both words; see [`View::levels`].
    level: [[u32; RUN]; 2],
    /// The colour of material and corners, RGB.
    tint: [u32; RUN],
    instance: [u32; RUN],
    /// RGBA, of the texture first and of the surface in the end.
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

/// Colour inputs of a run.
struct ColourInputs {
    is_textured: bool,
    is_tinted: bool,
}

impl Shader<'_> {
    /// Computes texture coordinates, tints and instances of the pixels.
    #[inline(always)]
    fn place(&self, run: &mut Run, [column, row]: [usize; 2], count: usize) -> ColourInputs {
        let swatches = &self.scratch.swatches;
        let (first_x, y) = (column as i32, row as i32 as f32);
        let mut looks = ColourInputs { is_textured: false, is_tinted: false };
        for i in 0..count {
            let number = run.swatch[i] as usize;
            let ([ux, uy, u, vx, vy, v, texels, _], meta) =
                (&swatches.planes[number], &swatches.meta[number]);
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
                varying_tint(&swatches.tints[meta.tint as usize], [x, y, depth_m])
            };
            looks.is_textured |= meta.texture != NO_TEXTURE;
            looks.is_tinted |= run.tint[i] != WHITE;
        }
        looks
    }

    /// Writes pixels from number `first` on.
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

/// RGB at column, row and depth, from planes over depth.
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
            swatch: numbers,
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
    /// Multiplies colours by tints.
    #[inline(always)]
    fn tint_all(&mut self) {
        for (color, &tint) in self.color.iter_mut().zip(&self.tint) {
            *color = modulate(*color, tint);
        }
    }

    /// Takes `count` pixels of the screen.
    #[inline(always)]
    fn take(&mut self, from: &Scratch, first: usize, count: usize) {
        self.nearness[..count].copy_from_slice(&from.screen.nearness[first..first + count]);
        self.swatch[..count].copy_from_slice(&from.screen.swatch[first..first + count]);
        for i in 0..RUN {
            let is_seen = self.nearness[i] > 0.0;
            self.depth_m[i] = if is_seen { 1.0 / self.nearness[i] } else { 0.0 };
            self.swatch[i] = if is_seen { self.swatch[i] } else { ShadingRecords::NOTHING };
        }
    }
}

/// Returns true if a surface with holes is solid at a pixel, from the planes of its record, column, row and
/// reciprocal depth.
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
