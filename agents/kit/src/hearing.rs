//! Hearing: interaural delay and level, and the sounding order.

use avln_client::Audio;
use realfft::num_complex::Complex32;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use std::f32::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

/// Transform length: a step plus the same length in zeros, against wrap-around.
const POINTS: usize = 8192;
const MAX_ITD_S: f32 = 0.000_8;
const BAND_HZ: [f32; 2] = [150.0, 6000.0];
/// Lower levels are silence.
const SILENCE: f32 = 1e-5;
/// Interaural delay every 30 degrees from ahead, s: a rigid sphere, 8.75 cm radius, ears at 100 degrees.
const ITD_CURVE_S: [f32; 7] = [0.0, 341e-6, 616e-6, 691e-6, 572e-6, 289e-6, 0.0];
/// Assumed source depth below the ears, metres: sound comes from an object's middle.
const LOWER_M: f32 = 0.8;

/// Returns the interaural delay of a source at `bearing_rad`, seconds; both positive to the left.
pub fn itd_s(bearing_rad: f32) -> f32 {
    let position = (bearing_rad.abs().to_degrees() / 30.0).min(6.0);
    let before = (position as usize).min(5);
    let share = position - before as f32;
    let delay_s = ITD_CURVE_S[before] * (1.0 - share) + ITD_CURVE_S[before + 1] * share;
    delay_s.copysign(bearing_rad)
}

/// Returns the two bearings with an interaural delay, radians, in front and behind; positive to the left.
pub fn bearings_rad(itd_s: f32) -> [f32; 2] {
    const SIDE: usize = 3;
    let delay_s = itd_s.abs();
    let between = |low: usize, high: usize| {
        let share = (delay_s - ITD_CURVE_S[low]) / (ITD_CURVE_S[high] - ITD_CURVE_S[low]);
        (low as f32 + (high as f32 - low as f32) * share.clamp(0.0, 1.0)) * 30_f32.to_radians()
    };
    let front = (1..=SIDE).find(|&to| ITD_CURVE_S[to] >= delay_s).unwrap_or(SIDE);
    let back = (SIDE..ITD_CURVE_S.len() - 1).rev().find(|&to| ITD_CURVE_S[to] >= delay_s).unwrap_or(SIDE);
    [between(front - 1, front), between(back + 1, back)].map(|bearing_rad| bearing_rad.copysign(itd_s))
}

/// Returns the delay of a source below the ears, at a distance of `length_m` metres on the floor, in seconds: directions
/// on a cone around the interaural axis have equal delays.
pub fn sloped_itd_s(bearing_rad: f32, length_m: f32) -> f32 {
    let across = libm::sinf(bearing_rad) * length_m / libm::hypotf(length_m, LOWER_M);
    let aside_rad = libm::asinf(across.abs().min(1.0));
    let is_behind = bearing_rad.abs() > FRAC_PI_2;
    itd_s((if is_behind { PI - aside_rad } else { aside_rad }).copysign(bearing_rad))
}

/// A sound measurement over a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeardSound {
    /// Interaural delay, seconds; positive if the left ear heard first.
    pub itd_s: f32,
    /// Root mean square over both ears.
    pub level: f32,
}

/// A meter of interaural delay and level: generalised cross-correlation with phase transform (Knapp and Carter 1976).
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
    /// Measures a step; `None` in silence.
    pub fn hear(&mut self, audio: &Audio) -> Option<HeardSound> {
        let level = level(audio);
        if !(level > SILENCE && level.is_finite()) || audio.sample_rate_hz == 0 {
            return None;
        }
        self.transform(&audio.left, 0)?;
        self.transform(&audio.right, 1)?;
        self.correlate(audio.sample_rate_hz as f32)?;
        let lag = self.peak((MAX_ITD_S * audio.sample_rate_hz as f32).ceil() as usize);
        Some(HeardSound { itd_s: lag / audio.sample_rate_hz as f32, level })
    }

    fn transform(&mut self, samples: &[f32], ear: usize) -> Option<()> {
        self.time.fill(0.0);
        let count = samples.len().min(POINTS / 2);
        self.time[..count].copy_from_slice(&samples[..count]);
        self.forward.process(&mut self.time, &mut self.spectra[ear]).ok()
    }

    /// Computes the correlation into `time`: index `lag` for a right ear `lag` samples late, 1 for full agreement.
    fn correlate(&mut self, rate_hz: f32) -> Option<()> {
        let band = BAND_HZ.map(|hz| ((hz / rate_hz * POINTS as f32) as usize).clamp(1, POINTS / 2 - 1));
        let [left, right] = &mut self.spectra;
        // The phase transform weights all bins equally: without a floor, silent bins would add noise.
        let floor = 1e-4 * left.iter().zip(&*right).map(|(l, r)| norm(l * r)).fold(0.0, f32::max);
        let mut weight = 0.0;
        for (bin, (l, r)) in left.iter_mut().zip(&*right).enumerate() {
            let cross = l.conj() * r;
            let magnitude = norm(cross) + floor;
            let inside = (band[0]..=band[1]).contains(&bin) && magnitude > 0.0;
            *l = if inside { cross / magnitude } else { Complex32::default() };
            weight += 2.0 * norm(*l);
        }
        self.inverse.process(left, &mut self.time).ok()?;
        self.time.iter_mut().for_each(|value| *value /= weight.max(1e-9));
        Some(())
    }

    /// Returns the lag of the highest peak within ±`reach` samples, refined by a parabola.
    fn peak(&self, reach: usize) -> f32 {
        let at = |lag: i32| self.time[lag.rem_euclid(POINTS as i32) as usize];
        let reach = reach as i32;
        let best = (-reach..=reach).max_by(|a, b| at(*a).total_cmp(&at(*b))).unwrap_or(0);
        let (before, top, after) = (at(best - 1), at(best), at(best + 1));
        // A sample lasts 62 µs at 16 kHz, more than 5 degrees straight ahead: the parabola resolves fractions.
        let curve = before - 2.0 * top + after;
        let shift = if curve < -1e-9 { (0.5 * (before - after) / curve).clamp(-0.5, 0.5) } else { 0.0 };
        best as f32 + shift
    }
}

fn norm(value: Complex32) -> f32 {
    // Complex::norm would call the platform's hypot (docs/decisions/0019).
    libm::hypotf(value.re, value.im)
}

fn level(audio: &Audio) -> f32 {
    let energy: f32 = audio.left.iter().chain(&audio.right).map(|sample| sample * sample).sum();
    (energy / (audio.left.len() + audio.right.len()).max(1) as f32).sqrt()
}

/// A model for the sounding order: unfinished targets sound in turn, numbered by their first sound.
#[derive(Clone, Debug)]
pub struct SoundSchedule {
    silent: Vec<bool>,
    window_steps: u32,
    current: usize,
    steps_left: u32,
    deferred: u32,
    /// A found source that sounds until its turn ends.
    ending: Option<usize>,
}

impl SoundSchedule {
    /// Creates a schedule with `count` open sources and windows of `window_steps`.
    pub fn new(count: usize, window_steps: u32) -> Self {
        let window_steps = window_steps.max(1);
        let silent = vec![false; count];
        Self { silent, window_steps, current: 0, steps_left: window_steps, deferred: 0, ending: None }
    }

    /// Skips an observation whose source is not known yet; the next call to [`Self::advance`] catches up.
    pub fn defer(&mut self) {
        self.deferred += 1;
    }

    /// Returns the source of the next observation; `None` if all were found.
    pub fn advance(&mut self) -> Option<usize> {
        // Deferred observations follow the present state: a source found meanwhile no longer has a turn.
        for _ in 0..std::mem::take(&mut self.deferred) {
            self.step();
        }
        self.step()
    }

    /// Follows the first `steps` skipped observations, before a source is marked as found.
    pub fn catch_up(&mut self, steps: u32) {
        for _ in 0..steps.min(self.deferred) {
            self.deferred -= 1;
            self.step();
        }
    }

    fn step(&mut self) -> Option<usize> {
        if self.steps_left == 0
            && let Some(ended) = self.ending.take()
        {
            self.silence(ended);
        }
        if self.steps_left == 0 || *self.silent.get(self.current)? {
            self.current = self.after(self.current)?;
            self.steps_left = self.window_steps;
        }
        self.steps_left -= 1;
        Some(self.current)
    }

    fn after(&self, current: usize) -> Option<usize> {
        let count = self.silent.len();
        (1..=count).map(|ahead| (current + ahead) % count).find(|&next| !self.silent[next])
    }

    /// Marks a source as found.
    pub fn silence(&mut self, source: usize) {
        if let Some(silent) = self.silent.get_mut(source) {
            *silent = true;
        }
    }

    /// Marks a source as found that sounds until its present turn ends.
    pub fn silence_after_turn(&mut self, source: usize) {
        if source == self.current && self.steps_left > 0 {
            self.ending = Some(source);
        } else {
            self.silence(source);
        }
    }

    /// Returns true if the source was found or does not exist.
    pub fn is_silent(&self, source: usize) -> bool {
        self.ending == Some(source) || self.silent.get(source).copied().unwrap_or(true)
    }

    /// Returns the current source.
    pub fn current(&self) -> usize {
        self.current
    }

    /// Returns the remaining observations of the current window.
    pub fn steps_left(&self) -> u32 {
        self.steps_left
    }

    /// Returns the observations until the next turn of the current source, if it is not found.
    pub fn return_steps(&self) -> u32 {
        let others = (0..self.silent.len()).filter(|&other| other != self.current && !self.is_silent(other));
        self.steps_left + self.window_steps * others.count() as u32
    }

    /// Returns true in the first observation of a window.
    pub fn is_first(&self) -> bool {
        self.steps_left + 1 == self.window_steps
    }

    /// Returns the steps until `source` sounds: 0 if it is current.
    pub fn wait_steps(&self, source: usize) -> u32 {
        let count = self.silent.len();
        let mut wait = 0;
        for ahead in 0..count {
            let place = (self.current + ahead) % count;
            if place == source {
                return wait;
            }
            wait += match (ahead, self.silent[place]) {
                (0, _) => self.steps_left,
                (_, false) => self.window_steps,
                (_, true) => 0,
            };
        }
        wait
    }
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
    fn delays_give_bearings_within_ten_degrees() {
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
    fn right_ear_first_is_negative() {
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
    fn slope_moves_near_sources_to_the_middle() {
        // 0.8 m away and 0.8 m below: sin 90° / √2 is the sine of 45°, halfway between 341 and 616 µs.
        let aside = sloped_itd_s(FRAC_PI_2, 0.8);
        assert!((aside - 478.5e-6).abs() < 1e-6, "{aside}");
        assert!((sloped_itd_s(-0.5, 100.0) - itd_s(-0.5)).abs() < 1e-6);
        assert!((sloped_itd_s(PI - 0.5, 100.0) - itd_s(PI - 0.5)).abs() < 1e-6);
        assert!(sloped_itd_s(2.5, 0.3) < sloped_itd_s(2.5, 3.0) && sloped_itd_s(0.0, 1.0) == 0.0);
    }

    #[test]
    fn delay_curve_is_odd_and_front_back_asymmetric() {
        assert_eq!(itd_s(0.0), 0.0);
        assert!((itd_s(-1.0) + itd_s(1.0)).abs() < 1e-9);
        assert!((itd_s(60_f32.to_radians()) - 616e-6).abs() < 1e-9);
        assert!(itd_s(30_f32.to_radians()) > itd_s(150_f32.to_radians()));
    }

    #[test]
    fn bearings_invert_the_delay() {
        for bearing_deg in [-170.0_f32, -120.0, -75.0, -30.0, 0.0, 10.0, 60.0, 89.0, 100.0, 150.0, 180.0] {
            let bearing_rad = bearing_deg.to_radians();
            let both = bearings_rad(itd_s(bearing_rad));
            let is_back = bearing_deg.abs() > 90.0;
            let found_rad = both[usize::from(is_back)];
            assert!((found_rad.abs() - bearing_rad.abs()).abs() < 0.01, "{bearing_deg}: {both:?}");
            assert!(bearing_deg.abs() > 179.0 || found_rad * bearing_rad >= 0.0, "{bearing_deg}: {both:?}");
        }
        assert!(bearings_rad(0.001).iter().all(|rad| (rad - FRAC_PI_2).abs() < 1e-5));
    }

    #[test]
    fn found_sources_lose_their_turn() {
        let mut turns = SoundSchedule::new(3, 2);
        let heard: Vec<_> = (0..7).filter_map(|_| turns.advance()).collect();
        assert_eq!(heard, [0, 0, 1, 1, 2, 2, 0]);
        assert_eq!((turns.wait_steps(0), turns.wait_steps(1), turns.wait_steps(2)), (0, 1, 3));
        turns.silence(0);
        assert!(turns.is_silent(0) && !turns.is_silent(1));
        let heard: Vec<_> = (0..5).filter_map(|_| turns.advance()).collect();
        assert_eq!(heard, [1, 1, 2, 2, 1]);
        turns.silence(1);
        turns.silence(2);
        assert_eq!(turns.advance(), None);
    }

    #[test]
    fn deferred_observations_catch_up() {
        let mut turns = SoundSchedule::new(2, 3);
        assert_eq!((turns.advance(), turns.steps_left()), (Some(0), 2));
        turns.defer();
        turns.silence(0);
        assert_eq!((turns.advance(), turns.steps_left()), (Some(1), 1));
    }

    #[test]
    fn without_sources_nothing_sounds() {
        assert_eq!(SoundSchedule::new(0, 25).advance(), None);
    }
}
