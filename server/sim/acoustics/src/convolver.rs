//! Partitioned overlap-save convolution. All filters share input spectra; all steps share filter spectra.

use crate::transform::{Complexes, Transform};
use std::collections::VecDeque;

/// Fast convolution of real signals with filter pairs, block by block.
pub(crate) struct Convolver {
    block: usize,
    window: usize,
    transform: Transform,
    sum: Complexes,
    spare: Vec<Complexes>,
}

/// A signal's recent past.
pub(crate) struct Input {
    /// Newest window, newest sample last.
    recent: Vec<f32>,
    /// Window spectra, newest first, a block apart; `None` for silence.
    past: VecDeque<Option<Complexes>>,
    /// Limit on `past`.
    max_spectra: usize,
    pub(crate) silent: usize,
}

/// A filter pair for two ears, with all part spectra used before.
pub(crate) struct Filter {
    taps: [Vec<f32>; 2],
    parts: Vec<Option<Complexes>>,
}

impl Input {
    pub(crate) fn is_silent(&self) -> bool {
        self.past.iter().all(Option::is_none)
    }

    pub(crate) fn byte_count(&self) -> usize {
        size_of_val(self.recent.as_slice()) + bytes_of(self.past.iter().flatten())
    }
}

impl Filter {
    pub(crate) fn byte_count(&self) -> usize {
        self.taps.iter().map(|taps| size_of_val(taps.as_slice())).sum::<usize>()
            + bytes_of(self.parts.iter().flatten())
    }
}

fn bytes_of<'a>(spectra: impl Iterator<Item = &'a Complexes>) -> usize {
    spectra.map(Complexes::byte_count).sum()
}

impl Convolver {
    /// Plans blocks with `block` samples, at least 1.
    pub(crate) fn new(block: usize) -> Self {
        let window = (2 * block).next_power_of_two();
        let transform = Transform::new(window);
        Self { block, window, transform, sum: Complexes::zero(window), spare: Vec::new() }
    }

    pub(crate) fn byte_count(&self) -> usize {
        self.transform.byte_count() + self.sum.byte_count() + bytes_of(self.spare.iter())
    }

    /// Upper bound in bytes for an input and the two filters in a cross-fade.
    pub(crate) fn max_bytes(&self, input: &Input) -> usize {
        let (spectrum, taps) = (self.sum.byte_count(), 2 * input.max_spectra * self.block * size_of::<f32>());
        size_of_val(input.recent.as_slice()) + 3 * input.max_spectra * spectrum + 2 * taps
    }

    /// Returns a silent input for filters with up to `longest` taps.
    pub(crate) fn input(&self, longest: usize) -> Input {
        let max_spectra = longest.div_ceil(self.block).max(1);
        let past = VecDeque::with_capacity(max_spectra + 1);
        Input { recent: vec![0.0; self.window], past, max_spectra, silent: 0 }
    }

    pub(crate) fn filter(&self, taps: [Vec<f32>; 2]) -> Filter {
        let longest = taps.iter().map(Vec::len).max().unwrap_or(0);
        Filter { taps, parts: vec![None; longest.div_ceil(self.block)] }
    }

    pub(crate) fn recycle(&mut self, filter: Filter) {
        self.spare.extend(filter.parts.into_iter().flatten());
    }

    pub(crate) fn feed(&mut self, input: &mut Input, block: &[f32]) {
        input.recent.copy_within(block.len().., 0);
        let now = input.recent.len() - block.len();
        input.recent[now..].copy_from_slice(block);
        let silent = block.iter().rev().take_while(|sample| **sample == 0.0).count();
        input.silent = if silent == block.len() { input.silent + silent } else { silent };
        let is_silent = input.recent.iter().all(|sample| *sample == 0.0);
        input.past.push_front((!is_silent).then(|| self.spectrum([&input.recent, &[]])));
        self.spare.extend(input.past.drain(input.max_spectra.min(input.past.len())..).flatten());
    }

    /// Returns the newest block through both filters; exactly zero if the filters reach no sound.
    pub(crate) fn output(&mut self, input: &Input, filter: &mut Filter) -> [Vec<f32>; 2] {
        self.sum.re.fill(0.0);
        self.sum.im.fill(0.0);
        let mut is_silent = true;
        for (index, past) in input.past.iter().enumerate().take(filter.parts.len()) {
            let Some(past) = past else { continue };
            is_silent = false;
            let Filter { taps, parts } = filter;
            let part = parts[index].get_or_insert_with(|| self.part(taps, index));
            self.sum.add_product(past, part);
        }
        if is_silent {
            return [vec![0.0; self.block], vec![0.0; self.block]];
        }
        self.transform.backward(&mut self.sum);
        let from = self.window - self.block;
        let mut ears = [&self.sum.re, &self.sum.im].map(|ear| ear[from..].to_vec());
        for (ear, taps) in ears.iter_mut().zip(&filter.taps) {
            let reach = if taps.is_empty() { 0 } else { self.block + taps.len() - 1 };
            ear.iter_mut().skip(reach.saturating_sub(input.silent)).for_each(|sample| *sample = 0.0);
        }
        ears
    }

    fn part(&mut self, taps: &[Vec<f32>; 2], index: usize) -> Complexes {
        let scale = 1.0 / self.window as f32;
        let part = |taps: &Vec<f32>| -> Vec<f32> {
            let taps = taps.chunks(self.block).nth(index).unwrap_or_default();
            taps.iter().map(|tap| tap * scale).collect()
        };
        let [left, right] = taps.each_ref().map(part);
        // Both ears share a transform, as the real and imaginary part.
        self.spectrum([&left, &right])
    }

    /// Spectrum of a window that starts with the given real and imaginary values; the rest is zero.
    fn spectrum(&mut self, [re, im]: [&[f32]; 2]) -> Complexes {
        let mut values = self.spare.pop().unwrap_or_else(|| Complexes::zero(self.window));
        for (part, given) in [(&mut values.re, re), (&mut values.im, im)] {
            part[..given.len()].copy_from_slice(given);
            part[given.len()..].fill(0.0);
        }
        self.transform.forward(&mut values);
        values
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_geom::Rng;

    #[test]
    fn blocks_equal_the_plain_sum() {
        let mut rng = Rng::new(11);
        let mut noise = |count: usize| -> Vec<f32> { (0..count).map(|_| rng.range(-1.0, 1.0)).collect() };
        for (block, taps) in [(20, 7), (10, 30), (128, 1), (40, 100), (7, 50), (16, 16), (1, 5)] {
            let (signal, filters) = (noise(6 * block), [noise(taps), noise(taps / 2)]);
            let mut convolver = Convolver::new(block);
            let mut input = convolver.input(taps);
            let mut parts = convolver.filter(filters.clone());
            for (index, now) in signal.chunks(block).enumerate() {
                convolver.feed(&mut input, now);
                let fast = convolver.output(&input, &mut parts);
                for (ear, filter) in fast.iter().zip(&filters) {
                    for (offset, value) in ear.iter().enumerate() {
                        let now = index * block + offset;
                        let heard = filter.iter().enumerate().take(now + 1);
                        let plain: f32 = heard.map(|(tap, factor)| factor * signal[now - tap]).sum();
                        assert!((plain - value).abs() < 1e-5, "{block}, {taps}: {plain} and {value}");
                    }
                }
            }
        }
    }

    #[test]
    fn output_beyond_the_filter_is_exactly_zero() {
        let mut convolver = Convolver::new(100);
        let (mut input, mut filter) = (convolver.input(250), convolver.filter([vec![1.0; 250], vec![]]));
        let mut click = vec![0.0; 100];
        click[99] = 1.0;
        convolver.feed(&mut input, &click);
        for sounding in [100, 100, 49, 0, 0] {
            convolver.feed(&mut input, &[0.0; 100]);
            let [output, deaf] = convolver.output(&input, &mut filter);
            assert_eq!(deaf, [0.0; 100]);
            assert!(output[..sounding].iter().all(|sample| (sample - 1.0).abs() < 1e-6));
            assert!(output[sounding..].iter().all(|sample| *sample == 0.0));
        }
        assert!(input.is_silent());
    }
}
