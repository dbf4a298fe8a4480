//! Feature maps, and convolutions on them.

use crate::{ConvLayer, PANEL};
use avln_simd::{Width, Work, run_at};

/// A feature map: pixels with `channels` numbers, row by row, and a zero border for 3 × 3 convolutions.
#[derive(Clone, Debug, Default)]
pub(crate) struct FeatureMap {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) channels: usize,
    values: Vec<f32>,
}

impl FeatureMap {
    pub(crate) fn new(width: usize, height: usize, channels: usize) -> Self {
        Self { width, height, channels, values: vec![0.0; (width + 2) * (height + 2) * channels] }
    }

    /// Returns a row without the border.
    pub(crate) fn row(&self, row: usize) -> &[f32] {
        let start = self.start(row);
        &self.values[start..start + self.width * self.channels]
    }

    pub(crate) fn row_mut(&mut self, row: usize) -> &mut [f32] {
        let (start, length) = (self.start(row), self.width * self.channels);
        &mut self.values[start..start + length]
    }

    pub(crate) fn at(&self, column: usize, row: usize) -> &[f32] {
        let start = self.start(row) + column * self.channels;
        &self.values[start..start + self.channels]
    }

    fn start(&self, row: usize) -> usize {
        ((row + 1) * (self.width + 2) + 1) * self.channels
    }

    /// Computes the rectified 3 × 3 convolution; `input` has equal or (stride 2) double size.
    pub(crate) fn convolve(&mut self, input: &FeatureMap, layer: &ConvLayer) {
        let step = input.width / self.width;
        let line = (input.width + 2) * input.channels;
        let start = |row: usize| step * row * line;
        let taps = |row: usize| std::array::from_fn::<usize, 3, _>(|tap| start(row) + tap * line);
        self.fill(layer, &input.values, [step * input.channels, 3 * input.channels], taps, 0.0);
    }

    /// Computes the 1 × 1 convolution; `input` has equal size.
    pub(crate) fn project(&mut self, input: &FeatureMap, layer: &ConvLayer) {
        let sizes = [input.channels, input.channels];
        self.fill(layer, &input.values, sizes, |row| [input.start(row)], f32::NEG_INFINITY);
    }

    fn fill<const TAPS: usize>(
        &mut self,
        layer: &ConvLayer,
        from: &[f32],
        [step, length]: [usize; 2],
        taps: impl Fn(usize) -> [usize; TAPS],
        least: f32,
    ) {
        run_at(Width::Sixteen, Convolution { map: self, layer, from, step, length, taps, least });
    }

    /// Adds `coarse`, upsampled by 2.
    pub(crate) fn add_twice(&mut self, coarse: &FeatureMap) {
        for row in 0..self.height {
            let from = coarse.row(row / 2).chunks_exact(coarse.channels);
            let length = self.channels;
            for (two, add) in self.row_mut(row).chunks_exact_mut(2 * length).zip(from) {
                let (left, right) = two.split_at_mut(length);
                for ((left, right), add) in left.iter_mut().zip(right).zip(add) {
                    *left += add;
                    *right += add;
                }
            }
        }
    }

    /// Adds a 1 × 1 convolution over the global mean to all pixels; `mean` and `sum` are scratch buffers.
    pub(crate) fn add_whole(&mut self, layer: &ConvLayer, mean: &mut Vec<f32>, sum: &mut Vec<f32>) {
        let channels = self.channels;
        mean.clear();
        mean.resize(channels, 0.0);
        for row in 0..self.height {
            for pixel in self.row(row).chunks_exact(channels) {
                mean.iter_mut().zip(pixel).for_each(|(mean, value)| *mean += value);
            }
        }
        let share = 1.0 / (self.width * self.height) as f32;
        sum.clone_from(&layer.bias);
        for (panel, sums) in layer.panels.chunks_exact(channels).zip(sum.chunks_mut(PANEL)) {
            for (mean, weights) in mean.iter().zip(panel) {
                sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += mean * share * weight);
            }
        }
        for row in 0..self.height {
            for pixel in self.row_mut(row).chunks_exact_mut(channels) {
                pixel.iter_mut().zip(&*sum).for_each(|(value, add)| *value += add);
            }
        }
    }
}

/// A convolution into `map`, clipped below at `least`: `length` numbers per tap, pixels `step` apart.
struct Convolution<'a, T> {
    map: &'a mut FeatureMap,
    layer: &'a ConvLayer,
    from: &'a [f32],
    step: usize,
    length: usize,
    taps: T,
    least: f32,
}

/// Pixels per iteration: with AVX2 their sums, a panel's weights, a value and a product fill the sixteen registers.
const TILE: usize = 6;

impl<T: Fn(usize) -> [usize; TAPS], const TAPS: usize> Work for Convolution<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(mut self) {
        for panel in 0..self.map.channels.div_ceil(PANEL) {
            self.rows(panel);
        }
    }
}

/// A panel's weights by tap and input, and the bias.
struct PanelWeights<'a> {
    taps: &'a [[f32; PANEL]],
    length: usize,
    bias: [f32; PANEL],
}

impl<'a, T: Fn(usize) -> [usize; TAPS], const TAPS: usize> Convolution<'a, T> {
    #[inline(always)]
    fn weights(&self, panel: usize) -> PanelWeights<'a> {
        let first = panel * PANEL;
        let kept = PANEL.min(self.map.channels - first);
        let mut bias = [0.0; PANEL];
        bias[..kept].copy_from_slice(&self.layer.bias[first..first + kept]);
        let count = TAPS * self.length;
        PanelWeights { taps: &self.layer.panels[panel * count..][..count], length: self.length, bias }
    }

    /// Fills a panel's channels in all rows, tile by tile.
    #[inline(always)]
    fn rows(&mut self, panel: usize) {
        let weights = self.weights(panel);
        for row in 0..self.map.height {
            let taps = (self.taps)(row);
            for column in (0..self.map.width).step_by(TILE) {
                // The last tile repeats the last pixel.
                let pixel = |next: usize| (column + next).min(self.map.width - 1) * self.step;
                let pixels = [pixel(0), pixel(1), pixel(2), pixel(3), pixel(4), pixel(5)];
                self.keep(row, column, panel, &weights.sums(self.from, &taps, pixels));
            }
        }
    }

    /// Stores a tile's sums, as far as pixels and outputs exist.
    #[inline(always)]
    fn keep(&mut self, row: usize, column: usize, panel: usize, sums: &[[f32; PANEL]; TILE]) {
        let (channels, least) = (self.map.channels, self.least);
        let to = &mut self.map.row_mut(row)[column * channels..];
        for (to, sums) in to.chunks_exact_mut(channels).zip(sums) {
            to[panel * PANEL..].iter_mut().zip(sums).for_each(|(to, sum)| *to = sum.max(least));
        }
    }
}

impl PanelWeights<'_> {
    /// Sums values times weights over the stretches at `taps`, for the pixels at these offsets.
    #[inline(always)]
    fn sums(&self, from: &[f32], taps: &[usize], pixels: [usize; TILE]) -> [[f32; PANEL]; TILE] {
        // Variables instead of an array, and zipped slices: the sums stay in registers, and the loop checks no
        // bounds. The order of summation is fixed, whatever the vector width: calibration compares bits
        // (docs/decisions/0019).
        let [mut a, mut b, mut c, mut d, mut e, mut f] = [self.bias; TILE];
        for (tap, weights) in taps.iter().zip(self.taps.chunks_exact(self.length)) {
            let stretch = |pixel: usize| &from[tap + pixels[pixel]..][..weights.len()];
            let (at_a, at_b, at_c) = (stretch(0), stretch(1), stretch(2));
            let (at_d, at_e, at_f) = (stretch(3), stretch(4), stretch(5));
            let left = weights.iter().zip(at_a).zip(at_b).zip(at_c);
            for ((((weights, at_a), at_b), at_c), ((at_d, at_e), at_f)) in
                left.zip(at_d.iter().zip(at_e).zip(at_f))
            {
                add(&mut a, *at_a, weights);
                add(&mut b, *at_b, weights);
                add(&mut c, *at_c, weights);
                add(&mut d, *at_d, weights);
                add(&mut e, *at_e, weights);
                add(&mut f, *at_f, weights);
            }
        }
        [a, b, c, d, e, f]
    }
}

#[inline(always)]
fn add(sums: &mut [f32; PANEL], value: f32, weights: &[f32; PANEL]) {
    sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += value * weight);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pseudo-random numbers, -0.5 to 0.5.
    fn noise(count: usize, seed: u32) -> Vec<f32> {
        let mut state = seed;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32 - 0.5
        };
        (0..count).map(|_| next()).collect()
    }

    fn filled(width: usize, height: usize, channels: usize) -> FeatureMap {
        let mut map = FeatureMap::new(width, height, channels);
        for row in 0..height {
            map.row_mut(row).copy_from_slice(&noise(width * channels, row as u32));
        }
        map
    }

    /// Reference convolution.
    fn plain(
        input: &FeatureMap,
        (weights, bias): (&[f32], &[f32]),
        step: usize,
        [column, row]: [usize; 2],
    ) -> Vec<f32> {
        let (mut sums, outputs) = (bias.to_vec(), bias.len());
        for (tap, weights) in weights.chunks_exact(input.channels * outputs).enumerate() {
            let (x, y) = ((step * column + tap % 3).wrapping_sub(1), (step * row + tap / 3).wrapping_sub(1));
            if x < input.width && y < input.height {
                for (value, weights) in input.at(x, y).iter().zip(weights.chunks_exact(outputs)) {
                    sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += value * weight);
                }
            }
        }
        sums.into_iter().map(|sum| sum.max(0.0)).collect()
    }

    /// Compares all bits with the reference, which sums in the same order.
    fn check(step: usize, width: usize) {
        let (inputs, outputs) = (7, 33);
        let (weights, bias) = (noise(9 * inputs * outputs, 3), noise(outputs, 4));
        let layer = ConvLayer::new(&weights, bias.clone());
        let input = filled(width, 16, inputs);
        let mut output = FeatureMap::new(width / step, 16 / step, outputs);
        // Previous content must not matter.
        output.values.fill(7.0);
        for _ in 0..2 {
            output.convolve(&input, &layer);
        }
        let bits = |values: &[f32]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        for (column, row) in (0..width / step).flat_map(|column| (0..16 / step).map(move |row| (column, row)))
        {
            let wanted = plain(&input, (&weights, &bias), step, [column, row]);
            assert_eq!(bits(output.at(column, row)), bits(&wanted), "{column} {row}");
        }
        // The next layer reads the border as zeros.
        let inside = (width / step) * (16 / step) * outputs;
        let kept = output.values.iter().filter(|value| **value == 7.0).count();
        assert_eq!(kept, output.values.len() - inside);
    }

    #[test]
    fn convolutions_match_the_definition() {
        // Rows of whole tiles, of a part of a tile, and of both.
        for width in [4, 12, 30, 32] {
            check(1, width);
            check(2, width);
        }
    }

    #[test]
    fn all_simd_widths_give_equal_bits() {
        let (inputs, outputs) = (7, 33);
        let layer = ConvLayer::new(&noise(9 * inputs * outputs, 3), noise(outputs, 4));
        let input = filled(30, 16, inputs);
        let convolved = |width: Width| {
            let mut map = FeatureMap::new(30, 16, outputs);
            let line = 32 * inputs;
            let taps = |row: usize| std::array::from_fn::<usize, 3, _>(|tap| (row + tap) * line);
            let (step, length) = (inputs, 3 * inputs);
            run_at(
                width,
                Convolution {
                    map: &mut map,
                    layer: &layer,
                    from: &input.values,
                    step,
                    length,
                    taps,
                    least: 0.0,
                },
            );
            map.values
        };
        let portable = convolved(Width::Portable);
        for wide in [Width::Eight, Width::Sixteen] {
            let equal = portable.iter().zip(convolved(wide)).all(|(a, b)| a.to_bits() == b.to_bits());
            assert!(equal, "{wide:?}");
        }
        assert!(portable.iter().any(|value| *value > 0.0));
    }

    #[test]
    fn coarse_maps_are_upsampled_and_added() {
        let (coarse, mut fine) = (filled(3, 2, 2), filled(6, 4, 2));
        let before = fine.clone();
        fine.add_twice(&coarse);
        for (column, row) in [(0, 0), (5, 3), (2, 1)] {
            for channel in 0..2 {
                let wanted = before.at(column, row)[channel] + coarse.at(column / 2, row / 2)[channel];
                assert_eq!(fine.at(column, row)[channel], wanted);
            }
        }
    }

    #[test]
    fn global_mean_is_added_to_each_pixel() {
        let mut map = FeatureMap::new(2, 1, 2);
        map.row_mut(0).copy_from_slice(&[1.0, 2.0, 3.0, 6.0]);
        let layer = ConvLayer::new(&[1.0, 10.0, 0.5, 0.0], vec![0.25, 0.0]);
        map.add_whole(&layer, &mut Vec::new(), &mut Vec::new());
        // Means 2 and 4: 2 + 2 + 0.25 and 20.
        assert_eq!(map.row(0), [5.25, 22.0, 7.25, 26.0]);
    }
}
