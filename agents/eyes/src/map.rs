use crate::weights::Layer;
use nalgebra::{DMatrixView, DMatrixViewMut};

/// Numbers for every pixel: rows of pixels of `channels` numbers each, with a border of one pixel of zeros around them, so that
/// a 3 × 3 convolution is three products of matrices whose rows overlap.
#[derive(Clone, Debug, Default)]
pub(crate) struct Map {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) channels: usize,
    values: Vec<f32>,
}

impl Map {
    pub(crate) fn new(width: usize, height: usize, channels: usize) -> Self {
        Self { width, height, channels, values: vec![0.0; (width + 2) * (height + 2) * channels] }
    }

    /// The numbers of the pixels `0..width` of a row.
    pub(crate) fn row(&self, row: usize) -> &[f32] {
        let start = self.start(row);
        &self.values[start..start + self.width * self.channels]
    }

    pub(crate) fn row_mut(&mut self, row: usize) -> &mut [f32] {
        let (start, length) = (self.start(row), self.width * self.channels);
        &mut self.values[start..start + length]
    }

    /// The numbers of a pixel.
    pub(crate) fn at(&self, column: usize, row: usize) -> &[f32] {
        let start = self.start(row) + column * self.channels;
        &self.values[start..start + self.channels]
    }

    fn start(&self, row: usize) -> usize {
        ((row + 1) * (self.width + 2) + 1) * self.channels
    }

    /// The rectified 3 × 3 convolution of `input`, which has the size of this map.
    pub(crate) fn convolve(&mut self, input: &Map, layer: &Layer) {
        let (inputs, outputs, line) = (input.channels, self.channels, self.width + 2);
        // From the first pixel to the last, the border between rows included.
        let pixels = self.height * line - 2;
        let start = self.start(0);
        for tap in 0..3 {
            let from = &input.values[tap * line * inputs..];
            product(from, inputs, layer.tap(tap), &mut self.values[start..], pixels, outputs, tap > 0);
        }
        self.rectify(&layer.bias);
    }

    /// The rectified 3 × 3 convolution of `input`, which is twice as wide and as high, at every second pixel.
    pub(crate) fn convolve_halving(&mut self, input: &Map, layer: &Layer) {
        let (inputs, outputs, line) = (input.channels, self.channels, input.width + 2);
        for row in 0..self.height {
            let start = self.start(row);
            for tap in 0..3 {
                let from = &input.values[(2 * row + tap) * line * inputs..];
                let to = &mut self.values[start..];
                product(from, 2 * inputs, layer.tap(tap), to, self.width, outputs, tap > 0);
            }
        }
        self.rectify(&layer.bias);
    }

    /// The 1 × 1 convolution of `input`, which has the size of this map; its border is not 0 afterwards.
    pub(crate) fn project(&mut self, input: &Map, layer: &Layer) {
        let pixels = (self.width + 2) * (self.height + 2);
        product(
            &input.values,
            input.channels,
            &layer.weights,
            &mut self.values,
            pixels,
            self.channels,
            false,
        );
        for pixel in self.values.chunks_exact_mut(self.channels) {
            pixel.iter_mut().zip(&layer.bias).for_each(|(value, bias)| *value += bias);
        }
    }

    /// Adds `coarse`, which is half as wide and as high, each of its pixels to four of this map.
    pub(crate) fn add_twice(&mut self, coarse: &Map) {
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

    /// Adds to every pixel a 1 × 1 convolution of the mean of all; `mean` and `sum` are scratch memory.
    pub(crate) fn add_whole(&mut self, layer: &Layer, mean: &mut Vec<f32>, sum: &mut Vec<f32>) {
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
        for (mean, weights) in mean.iter().zip(layer.weights.chunks_exact(channels)) {
            sum.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += mean * share * weight);
        }
        for row in 0..self.height {
            for pixel in self.row_mut(row).chunks_exact_mut(channels) {
                pixel.iter_mut().zip(&*sum).for_each(|(value, add)| *value += add);
            }
        }
    }

    /// Adds the bias, cuts off what is below 0, and clears the border.
    fn rectify(&mut self, bias: &[f32]) {
        let (channels, end) = (self.channels, self.width * self.channels);
        for row in 0..self.height {
            let start = self.start(row);
            for pixel in self.values[start..start + end].chunks_exact_mut(channels) {
                pixel.iter_mut().zip(bias).for_each(|(value, bias)| *value = (*value + bias).max(0.0));
            }
            self.values[start - channels..start].fill(0.0);
            self.values[start + end..start + end + channels].fill(0.0);
        }
    }
}

/// `to (+)= from × weights`: `pixels` rows that begin `step` apart in `from`, of as many numbers as `weights` has rows; `weights`
/// has `outputs` columns.
fn product(
    from: &[f32],
    step: usize,
    weights: &[f32],
    to: &mut [f32],
    pixels: usize,
    outputs: usize,
    adds: bool,
) {
    let inner = weights.len() / outputs;
    if pixels < FEWEST_ROWS {
        return plain_product(from, step, weights, to, pixels, outputs, adds);
    }
    let from = DMatrixView::from_slice_with_strides(from, pixels, inner, step, 1);
    let weights = DMatrixView::from_slice_with_strides(weights, inner, outputs, outputs, 1);
    let mut to = DMatrixViewMut::from_slice_with_strides_mut(to, pixels, outputs, outputs, 1);
    to.gemm(1.0, &from, &weights, if adds { 1.0 } else { 0.0 });
}

/// Matrices of fewer rows are not nalgebra's: its way with small ones takes rows for contiguous columns.
const FEWEST_ROWS: usize = 8;

/// [`product`] as its definition has it.
fn plain_product(
    from: &[f32],
    step: usize,
    weights: &[f32],
    to: &mut [f32],
    pixels: usize,
    outputs: usize,
    adds: bool,
) {
    let inner = weights.len() / outputs;
    for (pixel, to) in to.chunks_exact_mut(outputs).take(pixels).enumerate() {
        if !adds {
            to.fill(0.0);
        }
        for (value, weights) in from[pixel * step..][..inner].iter().zip(weights.chunks_exact(outputs)) {
            to.iter_mut().zip(weights).for_each(|(to, weight)| *to += value * weight);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers that look random, -0.5 to 0.5.
    fn noise(count: usize, seed: u32) -> Vec<f32> {
        let mut state = seed;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32 - 0.5
        };
        (0..count).map(|_| next()).collect()
    }

    fn filled(width: usize, height: usize, channels: usize) -> Map {
        let mut map = Map::new(width, height, channels);
        for row in 0..height {
            map.row_mut(row).copy_from_slice(&noise(width * channels, row as u32));
        }
        map
    }

    /// The convolution as its definition has it.
    fn plain(input: &Map, layer: &Layer, outputs: usize, step: usize, [column, row]: [usize; 2]) -> Vec<f32> {
        let mut sums = layer.bias.clone();
        for (tap, weights) in layer.weights.chunks_exact(input.channels * outputs).enumerate() {
            let (x, y) = ((step * column + tap % 3).wrapping_sub(1), (step * row + tap / 3).wrapping_sub(1));
            if x < input.width && y < input.height {
                for (value, weights) in input.at(x, y).iter().zip(weights.chunks_exact(outputs)) {
                    sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += value * weight);
                }
            }
        }
        sums.into_iter().map(|sum| sum.max(0.0)).collect()
    }

    fn check(step: usize, width: usize) {
        let (inputs, outputs) = (7, 9);
        let layer = Layer { weights: noise(9 * inputs * outputs, 3), bias: noise(outputs, 4) };
        let input = filled(width, 16, inputs);
        let mut output = Map::new(width / step, 16 / step, outputs);
        // What was there before does not matter.
        output.values.fill(7.0);
        output.values[..(width / step + 3) * outputs].fill(0.0);
        for _ in 0..2 {
            if step == 1 { output.convolve(&input, &layer) } else { output.convolve_halving(&input, &layer) }
        }
        for (column, row) in
            [(0, 0), (1, 2), (width / step - 1, 0), (0, 16 / step - 1), (width / step - 1, 16 / step - 1)]
        {
            let wanted = plain(&input, &layer, outputs, step, [column, row]);
            let close = output.at(column, row).iter().zip(&wanted).all(|(a, b)| (a - b).abs() < 1e-5);
            assert!(close, "{column} {row}: {:?} {wanted:?}", output.at(column, row));
        }
    }

    #[test]
    fn convolutions_are_what_they_are_by_definition() {
        for width in [4, 12, 32] {
            check(1, width);
            check(2, width);
        }
    }

    #[test]
    fn coarse_maps_are_added_to_fine_ones() {
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
    fn the_mean_of_all_is_added_to_every_pixel() {
        let mut map = Map::new(2, 1, 2);
        map.row_mut(0).copy_from_slice(&[1.0, 2.0, 3.0, 6.0]);
        let layer = Layer { weights: vec![1.0, 10.0, 0.5, 0.0], bias: vec![0.25, 0.0] };
        map.add_whole(&layer, &mut Vec::new(), &mut Vec::new());
        // Means 2 and 4: 2 + 2 + 0.25 and 20.
        assert_eq!(map.row(0), [5.25, 22.0, 7.25, 26.0]);
    }
}
