//! Discrete Fourier transforms with equal bits on every processor.

use avln_simd::{Width, Work, run_at};
use realfft::num_complex::Complex64;
use std::f64::consts::TAU;

/// Points in a wide stretch.
const WIDE: usize = 8;

/// Points in a narrow stretch: consecutive values after one stage.
const NARROW: usize = 4;

/// Complex numbers with separate parts.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Complexes {
    pub(crate) re: Vec<f32>,
    pub(crate) im: Vec<f32>,
}

/// A power-of-two Stockham transform for auto-vectorisation: radix 4 with a final radix 2, in order at both
/// ends.
///
/// Source: C. Van Loan, "Computational Frameworks for the Fast Fourier Transform" (1992), 1.7 and 2.4.
pub(crate) struct Transform {
    stages: Vec<Stage>,
    other: Complexes,
}

/// A radix-4 stage: per group the first three twiddle factor powers, real and imaginary parts.
struct Stage {
    turns: [Vec<f32>; 6],
}

impl Complexes {
    pub(crate) fn zero(points: usize) -> Self {
        Self { re: vec![0.0; points], im: vec![0.0; points] }
    }

    pub(crate) fn byte_count(&self) -> usize {
        size_of_val(self.re.as_slice()) + size_of_val(self.im.as_slice())
    }

    /// Adds `a * b` point by point; all have equal lengths.
    pub(crate) fn add_product(&mut self, a: &Self, b: &Self) {
        run_at(Width::Eight, Product { sum: self, a, b });
    }
}

impl Transform {
    /// Plans a transform with `points` points, a power of two.
    pub(crate) fn new(points: usize) -> Self {
        let counts = std::iter::successors(Some(points), |count| Some(count / 4));
        let stages = counts.take_while(|count| *count >= 4).map(Stage::new).collect();
        Self { stages, other: Complexes::zero(points) }
    }

    pub(crate) fn byte_count(&self) -> usize {
        let turns = self.stages.iter().flat_map(|stage| &stage.turns);
        turns.map(|turns| size_of_val(turns.as_slice())).sum::<usize>() + self.other.byte_count()
    }

    /// Replaces values by `sum over n of values[n] exp(-2 pi i k n / points)`.
    pub(crate) fn forward(&mut self, values: &mut Complexes) {
        run_at(Width::Eight, Forward { stages: &self.stages, values, other: &mut self.other });
    }

    /// Transforms with the opposite exponent sign; not divided by the number of points.
    pub(crate) fn backward(&mut self, values: &mut Complexes) {
        std::mem::swap(&mut values.re, &mut values.im);
        self.forward(values);
        std::mem::swap(&mut values.re, &mut values.im);
    }
}

impl Stage {
    fn new(points: usize) -> Self {
        let turn = |group: usize, power: usize| (power * group) as f64 * TAU / points as f64;
        let turns = |row: usize| {
            let part: fn(f64) -> f64 =
                if row.is_multiple_of(2) { libm::cos } else { |angle_rad| -libm::sin(angle_rad) };
            (0..points / 4).map(|group| part(turn(group, row / 2 + 1)) as f32).collect()
        };
        Self { turns: std::array::from_fn(turns) }
    }
}

struct Forward<'a> {
    stages: &'a [Stage],
    values: &'a mut Complexes,
    other: &'a mut Complexes,
}

impl Work for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { stages, values, other } = self;
        let points = values.re.len();
        let mut stride = 1;
        for stage in stages {
            match stride {
                1 if points >= 4 * WIDE => first_stage::<WIDE>(stage, values, other),
                1 => first_stage::<1>(stage, values, other),
                NARROW => later_stage::<NARROW>(stage, stride, values, other),
                _ => later_stage::<WIDE>(stage, stride, values, other),
            }
            std::mem::swap(values, other);
            stride *= 4;
        }
        if stride < points {
            last_by_two(&mut values.re);
            last_by_two(&mut values.im);
        }
    }
}

/// First stage: neighbouring groups together, with interleaved results.
#[inline(always)]
fn first_stage<const L: usize>(stage: &Stage, from: &Complexes, to: &mut Complexes) {
    let groups = from.re.len() / 4;
    for group in (0..groups).step_by(L) {
        let turns = each(|row| lanes::<L>(&stage.turns[row], group));
        let re = each(|part| lanes(&from.re, group + part * groups));
        let im = each(|part| lanes(&from.im, group + part * groups));
        let (re, im) = butterfly(re, im, &turns);
        interleave(&mut to.re[4 * group..4 * (group + L)], &re);
        interleave(&mut to.im[4 * group..4 * (group + L)], &im);
    }
}

/// Later stage: `stride` neighbours share their twiddle factors.
#[inline(always)]
fn later_stage<const L: usize>(stage: &Stage, stride: usize, from: &Complexes, to: &mut Complexes) {
    let quarter = from.re.len() / 4;
    for group in 0..quarter / stride {
        let turns = each(|row| [stage.turns[row][group]; L]);
        for place in (0..stride).step_by(L) {
            let source = group * stride + place;
            let re = each(|part| lanes(&from.re, source + part * quarter));
            let im = each(|part| lanes(&from.im, source + part * quarter));
            let (re, im) = butterfly(re, im, &turns);
            for part in 0..4 {
                let target = (4 * group + part) * stride + place;
                to.re[target..target + L].copy_from_slice(&re[part]);
                to.im[target..target + L].copy_from_slice(&im[part]);
            }
        }
    }
}

/// Final radix-2 stage if the length is no power of four: sums in the first half, differences in the second.
#[inline(always)]
fn last_by_two(values: &mut [f32]) {
    let (low, high) = values.split_at_mut(values.len() / 2);
    for (a, b) in low.iter_mut().zip(high) {
        (*a, *b) = (*a + *b, *a - *b);
    }
}

/// Transforms [`L`] groups with four values each; all except the first are rotated.
#[inline(always)]
fn butterfly<const L: usize>(
    re: [[f32; L]; 4],
    im: [[f32; L]; 4],
    turns: &[[f32; L]; 6],
) -> ([[f32; L]; 4], [[f32; L]; 4]) {
    let (mut to_re, mut to_im) = ([[0.0; L]; 4], [[0.0; L]; 4]);
    for i in 0..L {
        let (even_re, even_im) = (re[0][i] + re[2][i], im[0][i] + im[2][i]);
        let (odd_re, odd_im) = (re[1][i] + re[3][i], im[1][i] + im[3][i]);
        let (down_re, down_im) = (re[0][i] - re[2][i], im[0][i] - im[2][i]);
        let (side_re, side_im) = (im[1][i] - im[3][i], re[3][i] - re[1][i]);
        let sums = [
            (down_re + side_re, down_im + side_im),
            (even_re - odd_re, even_im - odd_im),
            (down_re - side_re, down_im - side_im),
        ];
        (to_re[0][i], to_im[0][i]) = (even_re + odd_re, even_im + odd_im);
        for power in 0..3 {
            let ((a, b), c, d) = (sums[power], turns[2 * power][i], turns[2 * power + 1][i]);
            (to_re[power + 1][i], to_im[power + 1][i]) = (a * c - b * d, a * d + b * c);
        }
    }
    (to_re, to_im)
}

#[inline(always)]
fn interleave<const L: usize>(to: &mut [f32], parts: &[[f32; L]; 4]) {
    for (i, four) in to.as_chunks_mut::<4>().0.iter_mut().enumerate() {
        *four = [parts[0][i], parts[1][i], parts[2][i], parts[3][i]];
    }
}

#[inline(always)]
fn lanes<const L: usize>(values: &[f32], first: usize) -> [f32; L] {
    let mut lanes = [0.0; L];
    lanes.copy_from_slice(&values[first..first + L]);
    lanes
}

#[inline(always)]
fn each<const L: usize, const N: usize>(find: impl Fn(usize) -> [f32; L]) -> [[f32; L]; N] {
    let mut found = [[0.0; L]; N];
    for (place, lanes) in found.iter_mut().enumerate() {
        *lanes = find(place);
    }
    found
}

struct Product<'a> {
    sum: &'a mut Complexes,
    a: &'a Complexes,
    b: &'a Complexes,
}

impl Work for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { sum, a, b } = self;
        let sums = sum.re.iter_mut().zip(&mut sum.im);
        let factors = a.re.iter().zip(&a.im).zip(b.re.iter().zip(&b.im));
        for ((re, im), ((a_re, a_im), (b_re, b_im))) in sums.zip(factors) {
            *re += a_re * b_re - a_im * b_im;
            *im += a_re * b_im + a_im * b_re;
        }
    }
}

/// A power-of-two transform in double precision.
pub(crate) struct Fourier {
    /// `exp(-2 pi i k / points)` for the first half.
    turns: Vec<Complex64>,
}

impl Fourier {
    /// Plans a transform with `points` points, a power of two.
    pub(crate) fn new(points: usize) -> Self {
        let step_rad = TAU / points as f64;
        Self { turns: (0..points / 2).map(|k| unit_phasor(k as f64 * step_rad).conj()).collect() }
    }

    /// Replaces values by `sum over n of values[n] exp(-2 pi i k n / points)`.
    pub(crate) fn forward(&self, values: &mut [Complex64]) {
        let points = values.len();
        reverse_bits(values);
        let mut half = 1;
        while half < points {
            let stride = points / (2 * half);
            for pair in values.chunks_exact_mut(2 * half) {
                let (low, high) = pair.split_at_mut(half);
                for ((a, b), turn) in low.iter_mut().zip(high).zip(self.turns.iter().step_by(stride)) {
                    let turned = *b * turn;
                    (*a, *b) = (*a + turned, *a - turned);
                }
            }
            half *= 2;
        }
    }

    /// Transforms with the opposite exponent sign; not divided by the number of points.
    pub(crate) fn backward(&self, values: &mut [Complex64]) {
        values.iter_mut().for_each(|value| *value = value.conj());
        self.forward(values);
        values.iter_mut().for_each(|value| *value = value.conj());
    }
}

fn reverse_bits(values: &mut [Complex64]) {
    let bits = values.len().trailing_zeros();
    for index in 0..values.len() {
        let other = index.reverse_bits().checked_shr(usize::BITS - bits).unwrap_or(0);
        if index < other {
            values.swap(index, other);
        }
    }
}

/// `exp(j angle)` with equal bits on every processor.
pub(crate) fn unit_phasor(angle_rad: f64) -> Complex64 {
    Complex64::new(libm::cos(angle_rad), libm::sin(angle_rad))
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_geom::Rng;

    fn noise(points: usize) -> Complexes {
        let mut rng = Rng::new(points as u64);
        let mut noise = || (0..points).map(|_| rng.range(-1.0, 1.0)).collect();
        Complexes { re: noise(), im: noise() }
    }

    #[test]
    fn transform_equals_the_plain_sum() {
        for points in [1, 2, 4, 8, 16, 32, 64, 128, 512, 2048] {
            let (values, mut there) = (noise(points), noise(points));
            let mut transform = Transform::new(points);
            transform.forward(&mut there);
            let tolerance = 1e-6 * (points as f64).sqrt() * 4.0;
            for k in (0..points).step_by(points.div_ceil(50)) {
                let (mut re, mut im) = (0.0, 0.0);
                for n in 0..points {
                    let angle_rad = TAU * (k * n % points) as f64 / points as f64;
                    let (cos, sin) = (libm::cos(angle_rad), -libm::sin(angle_rad));
                    let (a, b) = (f64::from(values.re[n]), f64::from(values.im[n]));
                    (re, im) = (re + a * cos - b * sin, im + a * sin + b * cos);
                }
                let off = (re - f64::from(there.re[k])).abs().max((im - f64::from(there.im[k])).abs());
                assert!(off < tolerance, "{points} points, number {k}: off by {off}");
            }
            transform.backward(&mut there);
            let back = there.re.iter().chain(&there.im).zip(values.re.iter().chain(&values.im));
            for (back, value) in back {
                assert!((back / points as f32 - value).abs() < 1e-6, "{points} points: {back} and {value}");
            }
        }
    }

    #[test]
    fn fourier_equals_the_plain_sum() {
        let mut rng = Rng::new(9);
        for points in [1, 2, 8, 32] {
            let values: Vec<_> = (0..points).map(|_| Complex64::new(rng.unit(), rng.unit())).collect();
            let (mut there, fourier) = (values.clone(), Fourier::new(points));
            fourier.forward(&mut there);
            for (k, value) in there.iter().enumerate() {
                let term = |(n, v): (usize, &Complex64)| {
                    let turn = TAU * (k * n) as f64 / points as f64;
                    v * Complex64::new(libm::cos(turn), -libm::sin(turn))
                };
                let plain: Complex64 = values.iter().enumerate().map(term).sum();
                assert!((plain - value).norm() < 1e-12, "{points}: {plain} and {value}");
            }
            fourier.backward(&mut there);
            let back = there.iter().zip(&values).map(|(a, b)| (a / points as f64 - b).norm());
            assert!(back.fold(0.0, f64::max) < 1e-12);
        }
    }

    #[test]
    fn vector_width_does_not_change_bits() {
        for points in [8, 1024, 8192] {
            let (mut wide, mut portable) = (noise(points), noise(points));
            let mut transform = Transform::new(points);
            transform.forward(&mut wide);
            wide.add_product(&noise(points), &wide.clone());
            let Transform { stages, other } = &mut transform;
            run_at(Width::Portable, Forward { stages, values: &mut portable, other });
            let (a, b) = (&noise(points), &portable.clone());
            run_at(Width::Portable, Product { sum: &mut portable, a, b });
            assert_eq!(wide, portable);
        }
    }
}
