//! Time slices of increasing width: 5 ms up to 80 ms, 10 ms up to 240 ms, 20 ms up to 560 ms, and so on.

use crate::SPEED_OF_SOUND_M_S;

/// The shortest slice, seconds.
const FIRST_S: f32 = 0.005;

/// Slices per width.
const OF_A_WIDTH: u32 = 16;

/// Returns the slice of a wave with path length `length_m` (0 to 1e6).
pub(super) fn bin_of(length_m: f32) -> usize {
    let slot = (length_m * (1.0 / (SPEED_OF_SOUND_M_S * FIRST_S))) as u32 + OF_A_WIDTH;
    let doubling = (slot / OF_A_WIDTH).ilog2();
    (doubling * OF_A_WIDTH + (slot >> doubling) - OF_A_WIDTH) as usize
}

/// Width of the slice for a path length `length_m`, relative to the first slice, as a power of two.
pub(super) fn doublings(length_m: f32) -> u32 {
    bin_of(length_m) as u32 / OF_A_WIDTH
}

/// Start of slice `bin`, seconds.
pub(super) fn start_s(bin: usize) -> f32 {
    let (doubling, place) = (bin as u32 / OF_A_WIDTH, bin as u32 % OF_A_WIDTH);
    (((OF_A_WIDTH + place) << doubling) - OF_A_WIDTH) as f32 * FIRST_S
}

/// Number of slices that start before `duration_s`.
pub(super) fn count(duration_s: f32) -> usize {
    (0..).take_while(|bin| start_s(*bin) < duration_s).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_follow_each_other_and_hold_what_begins_in_them() {
        assert_eq!((start_s(0), start_s(1)), (0.0, 0.005));
        assert!((start_s(16) - 0.08).abs() < 1e-6 && (start_s(32) - 0.24).abs() < 1e-6);
        for bin in 0..100 {
            let (start, end) = (start_s(bin), start_s(bin + 1));
            assert!(end > start);
            assert_eq!(bin_of((0.99 * start + 0.01 * end) * SPEED_OF_SOUND_M_S), bin);
            assert_eq!(bin_of((0.01 * start + 0.99 * end) * SPEED_OF_SOUND_M_S), bin);
        }
        for (time_s, times_wider) in [(0.0, 1), (0.079, 1), (0.081, 2), (0.239, 2), (0.241, 4), (0.57, 8)] {
            assert_eq!(1 << doublings(time_s * SPEED_OF_SOUND_M_S), times_wider, "{time_s} s");
        }
        assert_eq!(count(0.0), 0);
        assert_eq!(count(0.08), 16);
        assert_eq!(count(1.0), 59);
    }
}
