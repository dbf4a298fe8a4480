//! Interaural delay.

use crate::SAMPLE_RATE_HZ;
use std::f64::consts::TAU;

/// Compared frequencies, hertz.
const LOW_HZ: f64 = 100.0;
const HIGH_HZ: f64 = 1500.0;
const STEP_HZ: f64 = 10.0;

/// Longest delay, and the search steps, microseconds.
const MOST_US: f64 = 1000.0;
const COARSE_US: f64 = 10.0;
const FINE_US: f64 = 0.1;

/// Cross spectrum of two ears at a frequency: left times conjugate right.
struct Common {
    turn_us: f64,
    re: f64,
    im: f64,
}

/// Lead of the left ear, seconds; `None` without common content.
pub(super) fn lead_s(left: &[f32], right: &[f32]) -> Option<f64> {
    let count = ((HIGH_HZ - LOW_HZ) / STEP_HZ) as usize;
    let products: Vec<Common> =
        (0..=count).map(|index| common(left, right, LOW_HZ + STEP_HZ * index as f64)).collect();
    if products.iter().all(|common| common.re == 0.0 && common.im == 0.0) {
        return None;
    }
    let coarse_us = best(&products, 0.0, MOST_US, COARSE_US);
    Some(best(&products, coarse_us, COARSE_US, FINE_US) * 1e-6)
}

fn common(left: &[f32], right: &[f32], frequency_hz: f64) -> Common {
    let turn = TAU * frequency_hz / f64::from(SAMPLE_RATE_HZ);
    let ((left_re, left_im), (right_re, right_im)) = (bin(left, turn), bin(right, turn));
    Common {
        turn_us: TAU * frequency_hz * 1e-6,
        re: left_re * right_re + left_im * right_im,
        im: left_im * right_re - left_re * right_im,
    }
}

/// Fourier sum of `ear` at `turn` radians per sample.
fn bin(ear: &[f32], turn: f64) -> (f64, f64) {
    let heard = ear.iter().enumerate().filter(|(_, tap)| **tap != 0.0);
    heard.fold((0.0, 0.0), |(re, im), (n, tap)| {
        let (tap, phase) = (f64::from(*tap), turn * n as f64);
        (re + tap * libm::cos(phase), im - tap * libm::sin(phase))
    })
}

/// The lead around `middle_us` with the highest correlation.
fn best(products: &[Common], middle_us: f64, reach_us: f64, step_us: f64) -> f64 {
    let alike = |lead_us: f64| -> f64 {
        let turned = |common: &Common| {
            let phase = common.turn_us * lead_us;
            common.re * libm::cos(phase) + common.im * libm::sin(phase)
        };
        products.iter().map(turned).sum()
    };
    let steps = libm::round(reach_us / step_us) as i32;
    let leads = (-steps..=steps).map(|step| middle_us + f64::from(step) * step_us);
    leads.map(|lead| (alike(lead), lead)).max_by(|a, b| a.0.total_cmp(&b.0)).map_or(0.0, |(_, lead)| lead)
}
