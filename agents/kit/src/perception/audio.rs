use avln_client::Audio;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex, num_complex::Complex32};
use std::{
    f32::consts::{FRAC_PI_2, PI},
    sync::Arc,
};

/// Points of the transform: a step of sound and as much silence, so that nothing wraps around.
const POINTS: usize = 8192;
/// Largest delay between the ears that is looked at, seconds.
const MAX_ITD_S: f32 = 0.000_8;
/// Band that carries the delay, hertz.
const BAND_HZ: [f32; 2] = [150.0, 6000.0];
/// Below this level there is nothing to hear.
const SILENCE: f32 = 1e-5;
/// Delay between the ears every 30 degrees from straight ahead to straight behind, seconds: a rigid sphere of
/// 8.75 cm with ears at 100 degrees.
const ITD_CURVE_S: [f32; 7] = [0.0, 341e-6, 616e-6, 691e-6, 572e-6, 289e-6, 0.0];
/// How much lower than the ears sources are taken to be, metres: they sit in the middle of things.
const LOWER_M: f32 = 0.8;

/// Delay between the ears for a source at `bearing_rad` (positive to the left), seconds; positive where the left ear
/// hears first.
pub fn itd_s(bearing_rad: f32) -> f32 {
    let position = (bearing_rad.abs().to_degrees() / 30.0).min(6.0);
    let before = (position as usize).min(5);
    let share = position - before as f32;
    let delay_s = ITD_CURVE_S[before] * (1.0 - share) + ITD_CURVE_S[before + 1] * share;
    delay_s.copysign(bearing_rad)
}

/// The same for a source that sound comes from over `length_m` of floor, whose slope brings it nearer to the middle: what lies
/// on one cone around the axis of the ears is heard with the same delay.
pub fn sloped_itd_s(bearing_rad: f32, length_m: f32) -> f32 {
    let across = bearing_rad.sin() * length_m / length_m.hypot(LOWER_M);
    let aside_rad = across.abs().min(1.0).asin();
    let is_behind = bearing_rad.abs() > FRAC_PI_2;
    itd_s((if is_behind { PI - aside_rad } else { aside_rad }).copysign(bearing_rad))
}

/// What was heard in one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Heard {
    /// Delay between the ears, seconds; positive where the left ear heard first.
    pub itd_s: f32,
    /// Root mean square of the sound pressure over both ears.
    pub level: f32,
}

/// Measures delay and level of binaural sound by generalised cross-correlation with phase transform (Knapp and Carter
/// 1976).
pub struct Ear {
    forward: Arc<dyn RealToComplex<f32>>,
    inverse: Arc<dyn ComplexToReal<f32>>,
    time: Vec<f32>,
    spectra: [Vec<Complex32>; 2],
}

impl Default for Ear {
    fn default() -> Self {
        let mut planner = RealFftPlanner::new();
        let (forward, inverse) = (planner.plan_fft_forward(POINTS), planner.plan_fft_inverse(POINTS));
        let spectra = [forward.make_output_vec(), forward.make_output_vec()];
        Self { forward, inverse, time: vec![0.0; POINTS], spectra }
    }
}

impl Ear {
    /// What a step sounded like; `None` in silence.
    pub fn hear(&mut self, audio: &Audio) -> Option<Heard> {
        let level = level(audio);
        if !(level > SILENCE && level.is_finite()) || audio.sample_rate_hz == 0 {
            return None;
        }
        self.transform(&audio.left, 0)?;
        self.transform(&audio.right, 1)?;
        self.correlate(audio.sample_rate_hz as f32)?;
        let lag = self.peak((MAX_ITD_S * audio.sample_rate_hz as f32).ceil() as usize);
        Some(Heard { itd_s: lag / audio.sample_rate_hz as f32, level })
    }

    fn transform(&mut self, samples: &[f32], ear: usize) -> Option<()> {
        self.time.fill(0.0);
        let count = samples.len().min(POINTS / 2);
        self.time[..count].copy_from_slice(&samples[..count]);
        self.forward.process(&mut self.time, &mut self.spectra[ear]).ok()
    }

    /// Leaves the correlation in `time`: index `lag` where the right ear is `lag` samples late, 1 when all agrees.
    fn correlate(&mut self, rate_hz: f32) -> Option<()> {
        let band = BAND_HZ.map(|hz| ((hz / rate_hz * POINTS as f32) as usize).clamp(1, POINTS / 2 - 1));
        let [left, right] = &mut self.spectra;
        let floor = 1e-4 * left.iter().zip(&*right).map(|(l, r)| (l * r).norm()).fold(0.0, f32::max);
        let mut weight = 0.0;
        for (bin, (l, r)) in left.iter_mut().zip(&*right).enumerate() {
            let cross = l.conj() * r;
            let norm = cross.norm() + floor;
            let inside = (band[0]..=band[1]).contains(&bin) && norm > 0.0;
            *l = if inside { cross / norm } else { Complex32::default() };
            weight += 2.0 * l.norm();
        }
        self.inverse.process(left, &mut self.time).ok()?;
        self.time.iter_mut().for_each(|value| *value /= weight.max(1e-9));
        Some(())
    }

    /// Lag in samples of the highest peak within ±`reach`, refined by a parabola.
    fn peak(&self, reach: usize) -> f32 {
        let at = |lag: i32| self.time[lag.rem_euclid(POINTS as i32) as usize];
        let reach = reach as i32;
        let best = (-reach..=reach).max_by(|a, b| at(*a).total_cmp(&at(*b))).unwrap_or(0);
        let (before, top, after) = (at(best - 1), at(best), at(best + 1));
        let curve = before - 2.0 * top + after;
        let shift = if curve < -1e-9 { (0.5 * (before - after) / curve).clamp(-0.5, 0.5) } else { 0.0 };
        best as f32 + shift
    }
}

fn level(audio: &Audio) -> f32 {
    let energy: f32 = audio.left.iter().chain(&audio.right).map(|sample| sample * sample).sum();
    (energy / (audio.left.len() + audio.right.len()).max(1) as f32).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Noise that reaches the right ear `delay` samples after the left.
    fn noise(delay: usize, gain: f32) -> Audio {
        let mut state = 7_u32;
        let samples: Vec<f32> = (0..4100)
            .map(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                gain * ((state >> 8) as f32 / (1 << 23) as f32 - 1.0)
            })
            .collect();
        Audio {
            sample_rate_hz: 16_000,
            left: samples[50..4050].to_vec(),
            right: samples[50 - delay..4050 - delay].to_vec(),
        }
    }

    #[test]
    fn a_delay_gives_the_bearing_within_ten_degrees() {
        let mut ear = Ear::default();
        for (delay, expected_deg) in [(0, 0.0), (5, 28.0), (8, 48.0)] {
            let heard = ear.hear(&noise(delay, 0.1)).unwrap();
            let error_s = |deg: &f32| (itd_s(deg.to_radians()) - heard.itd_s).abs();
            let bearings = (0..90).map(|deg| deg as f32);
            let nearest = bearings.min_by(|a, b| error_s(a).total_cmp(&error_s(b))).unwrap();
            assert!((nearest - expected_deg).abs() < 10.0, "{delay}: {nearest} for {expected_deg}");
        }
    }

    #[test]
    fn the_right_ear_first_is_negative_and_the_level_is_measured() {
        let Audio { sample_rate_hz, left, right } = noise(6, 0.3);
        let heard = Ear::default().hear(&Audio { sample_rate_hz, left: right, right: left }).unwrap();
        assert!((heard.itd_s + 6.0 / 16_000.0).abs() < 5e-6);
        // Uniform noise of ±0.3 has an RMS of 0.3 / √3.
        assert!((heard.level - 0.173).abs() < 0.01);
    }

    #[test]
    fn silence_is_not_heard() {
        let silent = Audio { sample_rate_hz: 16_000, left: vec![0.0; 4000], right: vec![0.0; 4000] };
        assert_eq!(Ear::default().hear(&silent), None);
        assert_eq!(Ear::default().hear(&Audio::default()), None);
    }

    #[test]
    fn what_is_near_and_low_is_heard_nearer_to_the_middle() {
        // 0.8 m away and 0.8 m below: sin 90° / √2 is the sine of 45°, halfway between 341 and 616 µs.
        let aside = sloped_itd_s(FRAC_PI_2, 0.8);
        assert!((aside - 478.5e-6).abs() < 1e-6, "{aside}");
        assert!((sloped_itd_s(-0.5, 100.0) - itd_s(-0.5)).abs() < 1e-6);
        assert!((sloped_itd_s(PI - 0.5, 100.0) - itd_s(PI - 0.5)).abs() < 1e-6);
        assert!(sloped_itd_s(2.5, 0.3) < sloped_itd_s(2.5, 3.0) && sloped_itd_s(0.0, 1.0) == 0.0);
    }

    #[test]
    fn the_curve_is_odd_and_tells_front_from_back() {
        assert_eq!(itd_s(0.0), 0.0);
        assert!((itd_s(-1.0) + itd_s(1.0)).abs() < 1e-9);
        assert!((itd_s(60_f32.to_radians()) - 616e-6).abs() < 1e-9);
        assert!(itd_s(30_f32.to_radians()) > itd_s(150_f32.to_radians()));
    }
}
