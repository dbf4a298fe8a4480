//! Loudness of a clip: the A-weighted level.

use crate::SAMPLE_RATE_HZ;
use realfft::num_complex::Complex32;

/// A-weighted root mean square of every clip. The unweighted mean over the synthesised clips is then 0.05.
pub(super) const LOUDNESS: f32 = 0.0468;

/// A-weighted mean square of a signal of `length` samples, from the half spectrum of a real transform.
pub(super) fn weighted_mean_square(spectrum: &[Complex32], length: usize) -> f64 {
    let bin_hz = f64::from(SAMPLE_RATE_HZ) / length as f64;
    let weighted =
        |(bin, value): (usize, &Complex32)| weight(bin as f64 * bin_hz) * f64::from(value.norm_sqr());
    // A bin also represents its mirror image; the weight at both ends is small.
    2.0 * spectrum.iter().enumerate().map(weighted).sum::<f64>() / (length as f64 * length as f64)
}

/// A-weighting of energy at `frequency_hz`: 1 at 1 kHz. IEC 61672-1, annex E.
fn weight(frequency_hz: f64) -> f64 {
    /// Corner frequencies, squared.
    const CORNERS: [f64; 4] = [20.6 * 20.6, 107.7 * 107.7, 737.9 * 737.9, 12_194.0 * 12_194.0];
    /// Value of the formula at 1 kHz.
    const AT_1_KHZ: f64 = 0.630_978;
    let squared = frequency_hz * frequency_hz;
    let [a, b, c, d] = CORNERS.map(|corner| squared + corner);
    let rise = CORNERS[3] * squared * squared / (a * d);
    rise * rise / (b * c) / AT_1_KHZ
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_those_of_the_standard() {
        // Table 3 of IEC 61672-1, decibels.
        for (frequency_hz, level_db) in
            [(125.0, -16.1), (500.0, -3.2), (1000.0, 0.0), (4000.0, 1.0), (8000.0, -1.1)]
        {
            let found_db = 10.0 * weight(frequency_hz).log10();
            assert!((found_db - level_db).abs() < 0.1, "{frequency_hz} Hz: {found_db} dB");
        }
    }
}
