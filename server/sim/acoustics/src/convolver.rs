//! Convolution by overlap-save: the newest samples of an input through a filter that may change every call.

use realfft::num_complex::Complex32;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Fast convolution of real signals.
#[derive(Default)]
pub(crate) struct Convolver {
    plans: BTreeMap<usize, Plan>,
}

struct Plan {
    forward: Arc<dyn RealToComplex<f32>>,
    inverse: Arc<dyn ComplexToReal<f32>>,
    scratch: Vec<Complex32>,
}

impl Plan {
    fn new(length: usize) -> Self {
        let mut planner = RealFftPlanner::<f32>::new();
        let (forward, inverse) = (planner.plan_fft_forward(length), planner.plan_fft_inverse(length));
        let scratch = vec![Complex32::default(); forward.get_scratch_len().max(inverse.get_scratch_len())];
        Self { forward, inverse, scratch }
    }

    /// The spectrum of `time`, which serves as scratch. Lengths are those of the plan, so that no call fails.
    fn spectrum(&mut self, time: &mut [f32]) -> Vec<Complex32> {
        let mut spectrum = self.forward.make_output_vec();
        let scratch = &mut self.scratch[..self.forward.get_scratch_len()];
        let done = self.forward.process_with_scratch(time, &mut spectrum, scratch);
        debug_assert!(done.is_ok());
        spectrum
    }

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
        time
    }
}

impl Convolver {
    /// For each filter the last `count` samples of `input` convolved with it. `input` is taken to be silent
    /// before its first sample. Samples that no filter reaches are exactly zero.
    pub(crate) fn latest<const N: usize>(
        &mut self,
        input: &[f32],
        filters: [&[f32]; N],
        count: usize,
    ) -> [Vec<f32>; N] {
        let longest = filters.iter().map(|filter| filter.len()).max().unwrap_or(0);
        let reach = (count + longest).saturating_sub(1).min(input.len());
        let recent = &input[input.len() - reach..];
        if longest == 0 || recent.iter().all(|sample| *sample == 0.0) {
            return std::array::from_fn(|_| vec![0.0; count]);
        }
        let length = (count + longest - 1).next_power_of_two();
        let plan = self.plans.entry(length).or_insert_with(|| Plan::new(length));
        let mut padded = vec![0.0; length];
        padded[length - reach..].copy_from_slice(recent);
        let input = plan.spectrum(&mut padded);
        filters.map(|filter| {
            let mut padded = vec![0.0; length];
            padded[..filter.len()].copy_from_slice(filter);
            let mut product = plan.spectrum(&mut padded);
            let scale = 1.0 / length as f32;
            product.iter_mut().zip(&input).for_each(|(bin, other)| *bin *= other * scale);
            plan.signal(&mut product).split_off(length - count)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_geom::Rng;

    #[test]
    fn the_latest_samples_equal_the_plain_sum() {
        let mut rng = Rng::new(11);
        let mut noise = |count: usize| -> Vec<f32> { (0..count).map(|_| rng.range(-1.0, 1.0)).collect() };
        for (inputs, taps, count) in [(50, 7, 20), (10, 30, 10), (300, 1, 128), (64, 100, 40)] {
            let (input, filter) = (noise(inputs), noise(taps));
            let [fast] = Convolver::default().latest(&input, [&filter], count);
            for (offset, value) in fast.iter().enumerate() {
                let now = inputs - count + offset;
                let plain: f32 = (0..taps.min(now + 1)).map(|tap| filter[tap] * input[now - tap]).sum();
                assert!((plain - value).abs() < 1e-5, "{plain} and {value}");
            }
        }
    }

    #[test]
    fn silence_out_of_reach_of_the_input_is_exact() {
        let mut input = vec![0.0; 200];
        input[9] = 1.0;
        let [reached] = Convolver::default().latest(&input, [&[1.0; 100]], 100);
        assert!(reached[0..9].iter().all(|sample| (sample - 1.0).abs() < 1e-6));
        let [silent] = Convolver::default().latest(&input, [&[1.0; 91]], 100);
        assert!(silent.iter().all(|sample| *sample == 0.0));
    }
}
