//! Convolution by overlap-save with filters in equal parts: what is known of the input serves every filter, and what is
//! known of a filter serves every step.

use realfft::num_complex::Complex32;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use std::collections::VecDeque;
use std::sync::Arc;

/// The spectrum of one window.
type Spectrum = Vec<Complex32>;

/// Fast convolution of real signals, a block of samples at a time.
pub(crate) struct Convolver {
    block: usize,
    window: usize,
    forward: Arc<dyn RealToComplex<f32>>,
    inverse: Arc<dyn ComplexToReal<f32>>,
    scratch: Vec<Complex32>,
}

/// The recent past of a signal.
pub(crate) struct Input {
    /// The newest window, newest sample last.
    recent: Vec<f32>,
    /// Spectra of the window now and of those one, two … blocks ago; `None` for silence.
    past: VecDeque<Option<Spectrum>>,
    /// How many of them are kept.
    most: usize,
    /// Silent samples at the end.
    quiet: usize,
}

/// A filter, and the spectra of those of its parts that were needed so far.
pub(crate) struct Filter {
    taps: Vec<f32>,
    parts: Vec<Option<Spectrum>>,
}

impl Input {
    /// Silent samples at the end.
    pub(crate) fn quiet_samples(&self) -> usize {
        self.quiet
    }

    /// Whether all that is remembered is silence.
    pub(crate) fn is_silent(&self) -> bool {
        self.past.iter().all(Option::is_none)
    }
}

impl Convolver {
    /// For blocks of `block` samples, at least 1.
    pub(crate) fn new(block: usize) -> Self {
        let window = (2 * block).next_power_of_two();
        let mut planner = RealFftPlanner::<f32>::new();
        let (forward, inverse) = (planner.plan_fft_forward(window), planner.plan_fft_inverse(window));
        let scratch = vec![Complex32::default(); forward.get_scratch_len().max(inverse.get_scratch_len())];
        Self { block, window, forward, inverse, scratch }
    }

    /// Silence, to be convolved with filters of up to `longest` taps.
    pub(crate) fn input(&self, longest: usize) -> Input {
        let most = longest.div_ceil(self.block).max(1);
        Input { recent: vec![0.0; self.window], past: VecDeque::with_capacity(most + 1), most, quiet: 0 }
    }

    pub(crate) fn filter(&self, taps: Vec<f32>) -> Filter {
        let parts = taps.len().div_ceil(self.block);
        Filter { taps, parts: vec![None; parts] }
    }

    /// Appends a block to an input.
    pub(crate) fn feed(&mut self, input: &mut Input, block: &[f32]) {
        input.recent.copy_within(block.len().., 0);
        let now = input.recent.len() - block.len();
        input.recent[now..].copy_from_slice(block);
        let quiet = block.iter().rev().take_while(|sample| **sample == 0.0).count();
        input.quiet = if quiet == block.len() { input.quiet + quiet } else { quiet };
        let is_silent = input.recent.iter().all(|sample| *sample == 0.0);
        input.past.push_front((!is_silent).then(|| self.spectrum(&mut input.recent.clone())));
        input.past.truncate(input.most);
    }

    /// The newest block of an input through a filter. Exactly zero where the filter reaches no sound any more.
    pub(crate) fn output(&mut self, input: &Input, filter: &mut Filter) -> Vec<f32> {
        let mut sum = vec![Complex32::default(); self.window / 2 + 1];
        let mut is_silent = true;
        for (index, past) in input.past.iter().enumerate().take(filter.parts.len()) {
            let Some(past) = past else { continue };
            is_silent = false;
            let part = self.part(filter, index);
            sum.iter_mut().zip(past).zip(part).for_each(|((sum, past), part)| *sum += past * part);
        }
        let mut output = if is_silent { vec![0.0; self.block] } else { self.signal(&mut sum) };
        let rung_out = (self.block + filter.taps.len()).saturating_sub(input.quiet + 1);
        output.iter_mut().skip(rung_out).for_each(|sample| *sample = 0.0);
        output
    }

    /// The spectrum of a part of a filter, worked out on first use.
    fn part<'a>(&mut self, filter: &'a mut Filter, index: usize) -> &'a Spectrum {
        let Filter { taps, parts } = filter;
        parts[index].get_or_insert_with(|| {
            let taps = taps.chunks(self.block).nth(index).unwrap_or_default();
            let mut padded = vec![0.0; self.window];
            let scale = 1.0 / self.window as f32;
            padded.iter_mut().zip(taps).for_each(|(sample, tap)| *sample = tap * scale);
            self.spectrum(&mut padded)
        })
    }

    /// The spectrum of a window, which serves as scratch. Lengths are those of the plan, so that no call fails.
    fn spectrum(&mut self, time: &mut [f32]) -> Spectrum {
        let mut spectrum = self.forward.make_output_vec();
        let scratch = &mut self.scratch[..self.forward.get_scratch_len()];
        let done = self.forward.process_with_scratch(time, &mut spectrum, scratch);
        debug_assert!(done.is_ok());
        spectrum
    }

    /// The last block of the window that has this spectrum.
    fn signal(&mut self, spectrum: &mut [Complex32]) -> Vec<f32> {
        let mut time = self.inverse.make_output_vec();
        // The first and last bin of a real signal are real; products of such bins are, up to rounding.
        spectrum[0].im = 0.0;
        if let Some(last) = spectrum.last_mut() {
            last.im = 0.0;
        }
        let scratch = &mut self.scratch[..self.inverse.get_scratch_len()];
        let done = self.inverse.process_with_scratch(spectrum, &mut time, scratch);
        debug_assert!(done.is_ok());
        time.split_off(self.window - self.block)
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
            let (signal, filter) = (noise(6 * block), noise(taps));
            let mut convolver = Convolver::new(block);
            let mut input = convolver.input(taps);
            let mut parts = convolver.filter(filter.clone());
            for (index, now) in signal.chunks(block).enumerate() {
                convolver.feed(&mut input, now);
                let fast = convolver.output(&input, &mut parts);
                for (offset, value) in fast.iter().enumerate() {
                    let now = index * block + offset;
                    let plain: f32 = (0..taps.min(now + 1)).map(|tap| filter[tap] * signal[now - tap]).sum();
                    assert!((plain - value).abs() < 1e-5, "{block}, {taps}: {plain} and {value}");
                }
            }
        }
    }

    #[test]
    fn silence_out_of_reach_of_the_input_is_exact() {
        let mut convolver = Convolver::new(100);
        let (mut input, mut filter) = (convolver.input(250), convolver.filter(vec![1.0; 250]));
        let mut click = vec![0.0; 100];
        click[99] = 1.0;
        convolver.feed(&mut input, &click);
        for sounding in [100, 100, 49, 0, 0] {
            convolver.feed(&mut input, &[0.0; 100]);
            let output = convolver.output(&input, &mut filter);
            assert!(output[..sounding].iter().all(|sample| (sample - 1.0).abs() < 1e-6));
            assert!(output[sounding..].iter().all(|sample| *sample == 0.0));
        }
        assert!(input.is_silent());
    }
}
