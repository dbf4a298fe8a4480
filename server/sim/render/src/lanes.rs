//! Vectors of eight numbers, as plain arrays that compilers turn into vector instructions.

use std::array::from_fn;
use std::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Sub};

pub(crate) const LANES: usize = 8;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(align(32))]
pub(crate) struct Floats(pub(crate) [f32; LANES]);

#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(align(32))]
pub(crate) struct Numbers(pub(crate) [u32; LANES]);

/// Eight truths: all bits are set or clear.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(align(32))]
pub(crate) struct Truths(pub(crate) [u32; LANES]);

impl Floats {
    /// Returns `value` in all lanes.
    #[inline(always)]
    pub(crate) fn of(value: f32) -> Self {
        Self([value; LANES])
    }

    #[inline(always)]
    pub(crate) fn abs(self) -> Self {
        Self(from_fn(|i| self.0[i].abs()))
    }

    // For a NaN lane the result is `other`, as with the vector instruction.
    #[inline(always)]
    pub(crate) fn least(self, other: Self) -> Self {
        self.zipped(other, |a, b| if a < b { a } else { b })
    }

    #[inline(always)]
    pub(crate) fn most(self, other: Self) -> Self {
        self.zipped(other, |a, b| if a > b { a } else { b })
    }

    /// Returns the smallest and the largest lane.
    #[inline(always)]
    pub(crate) fn range(self) -> (f32, f32) {
        (self.halved(Self::least), self.halved(Self::most))
    }

    #[inline(always)]
    fn halved(self, combined: impl Fn(Self, Self) -> Self) -> f32 {
        let four = combined(self, Self(from_fn(|i| self.0[i ^ 4])));
        let two = combined(four, Self(from_fn(|i| four.0[i ^ 2])));
        combined(two, Self(from_fn(|i| two.0[i ^ 1]))).0[0]
    }

    #[inline(always)]
    pub(crate) fn above(self, other: Self) -> Truths {
        Truths(from_fn(|i| if self.0[i] > other.0[i] { u32::MAX } else { 0 }))
    }

    #[inline(always)]
    pub(crate) fn equals(self, other: Self) -> Truths {
        Truths(from_fn(|i| if self.0[i] == other.0[i] { u32::MAX } else { 0 }))
    }

    /// Rounds up to integers; values must be between 0 and 2^22.
    #[inline(always)]
    pub(crate) fn rounded_up(self) -> Numbers {
        let whole = self.rounded();
        Numbers(from_fn(|i| whole.0[i] + u32::from((whole.0[i] as i32 as f32) < self.0[i])))
    }

    /// Rounds down to integers; values must be between 0 and 2^22.
    #[inline(always)]
    pub(crate) fn rounded_down(self) -> Numbers {
        let whole = self.rounded();
        Numbers(from_fn(|i| whole.0[i] - u32::from((whole.0[i] as i32 as f32) > self.0[i])))
    }

    #[inline(always)]
    fn rounded(self) -> Numbers {
        // From 2^23 on floats are whole and end with the number's bits. A checked cast would not vectorise.
        const WHOLE: f32 = 8_388_608.0;
        Numbers(from_fn(|i| (self.0[i] + WHOLE).to_bits() & 0x007f_ffff))
    }

    #[inline(always)]
    fn zipped(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(from_fn(|i| f(self.0[i], other.0[i])))
    }
}

impl Truths {
    /// `yes` in true lanes, `no` in false lanes.
    #[inline(always)]
    pub(crate) fn choose(self, yes: Floats, no: Floats) -> Floats {
        Floats(from_fn(|i| {
            f32::from_bits((self.0[i] & yes.0[i].to_bits()) | (!self.0[i] & no.0[i].to_bits()))
        }))
    }

    /// `value` in true lanes, +0 in false lanes.
    #[inline(always)]
    pub(crate) fn keep(self, value: Floats) -> Floats {
        Floats(from_fn(|i| f32::from_bits(self.0[i] & value.0[i].to_bits())))
    }

    #[inline(always)]
    pub(crate) fn keep_numbers(self, value: Numbers) -> Numbers {
        Numbers(from_fn(|i| self.0[i] & value.0[i]))
    }

    #[inline(always)]
    pub(crate) fn choose_number(self, yes: u32, no: &[u32; LANES]) -> [u32; LANES] {
        from_fn(|i| (self.0[i] & yes) | (!self.0[i] & no[i]))
    }

    #[inline(always)]
    pub(crate) fn any(self) -> bool {
        self.0.iter().fold(0, |all, truth| all | truth) != 0
    }
}

impl BitAnd for Truths {
    type Output = Self;

    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Self(from_fn(|i| self.0[i] & other.0[i]))
    }
}

impl BitOr for Truths {
    type Output = Self;

    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        Self(from_fn(|i| self.0[i] | other.0[i]))
    }
}

impl Add for Floats {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zipped(other, |a, b| a + b)
    }
}

impl Sub for Floats {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zipped(other, |a, b| a - b)
    }
}

impl Mul for Floats {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zipped(other, |a, b| a * b)
    }
}

impl Div for Floats {
    type Output = Self;

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.zipped(other, |a, b| a / b)
    }
}

impl Neg for Floats {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self(from_fn(|i| -self.0[i]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_behave_like_scalars() {
        let a = Floats([1.0, -2.0, 0.5, f32::NAN, 4.0, -0.0, 7.0, 8.0]);
        let b = Floats([2.0, -3.0, 0.5, 1.0, f32::INFINITY, 0.0, -7.0, 3.0]);
        assert_eq!((a + b).0[0], 3.0);
        assert_eq!((a * b).0[1], 6.0);
        assert_eq!((a - b).0[7], 5.0);
        assert_eq!((a / b).0[2], 1.0);
        assert_eq!((-a).abs().0[1], 2.0);
        assert_eq!(a.least(b).0[3], 1.0);
        assert_eq!(a.most(b).0[3], 1.0);
        let above = a.above(b);
        assert_eq!(above.0.map(|truth| truth != 0), [false, true, false, false, false, false, true, true]);
        assert_eq!(
            a.equals(b).0.map(|truth| truth != 0),
            [false, false, true, false, false, true, false, false]
        );
        assert_eq!(above.choose(a, b).0[6..], [7.0, 8.0]);
        assert_eq!(above.keep(a).0[..2], [0.0, -2.0]);
        assert_eq!(above.choose_number(9, &[1; LANES]), [1, 9, 1, 1, 1, 1, 9, 9]);
        let steps = Floats([0.0, 0.2, 0.5, 1.5, 2.0, 2.7, 4096.9, 3.5]);
        assert_eq!(steps.rounded_up().0, [0, 1, 1, 2, 2, 3, 4097, 4]);
        assert_eq!(steps.rounded_down().0, [0, 0, 0, 1, 2, 2, 4096, 3]);
        assert_eq!(Floats([3.0, 1.0, 4.0, -1.5, 9.0, 2.0, 6.0, 5.0]).range(), (-1.5, 9.0));
        assert!(above.any() && !(above & a.equals(b)).any() && (above | a.equals(b)).any());
    }
}
