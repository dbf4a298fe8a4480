//! Signals at two ears for a moving listener and alternating sources, by partitioned overlap-save convolution: all filters share
//! input spectra, all steps share filter spectra.

use crate::SAMPLE_RATE_HZ;
use crate::clip::Clip;
use crate::impulse::{ImpulseResponse, Listener};
use crate::source::{Heard, Source};
use crate::transform::{Complexes, Transform};
use std::collections::VecDeque;

/// Cross-fade between two impulse responses, samples: 50 ms.
const CROSSFADE_SAMPLES: usize = SAMPLE_RATE_HZ as usize / 20;

/// Fade when an emitter starts or stops, samples: 10 ms.
const SWITCH_SAMPLES: usize = SAMPLE_RATE_HZ as usize / 100;

/// Age after which only a diffuse tail remains, samples: 0.2 s.
const RINGING_SAMPLES: usize = SAMPLE_RATE_HZ as usize / 5;

/// A source that plays a clip.
///
/// The clip position follows simulated time even in silence: at sample `t` since the first [`Ears::hear`] it
/// is `(offset_samples + t) mod length`.
#[derive(Clone)]
pub struct Emitter {
    /// Position with precomputed paths.
    pub source: Source,
    /// Repeated clip.
    pub clip: Clip,
    /// Clip position at time 0, samples.
    pub offset_samples: usize,
}

/// Two ears during an episode, with the ringing sound.
pub struct Ears {
    channels: Vec<Channel>,
    samples_per_step: usize,
    heard_samples: usize,
    convolver: Convolver,
}

/// Signal path from an emitter to the ears.
struct Channel {
    emitter: Emitter,
    /// Emitted signal, as long as an impulse response.
    dry: Input,
    sounding: bool,
    previous: Option<Previous>,
}

struct Previous {
    listener: Listener,
    heard: Heard,
    filter: Filter,
}

impl Ears {
    /// Creates silent ears at time 0.
    pub fn new(emitters: Vec<Emitter>, samples_per_step: usize) -> Self {
        let convolver = Convolver::new(samples_per_step.max(1));
        let channel = |emitter: Emitter| {
            let dry = convolver.input(emitter.source.response_samples());
            Channel { emitter, dry, sounding: false, previous: None }
        };
        let channels = emitters.into_iter().map(channel).collect();
        Self { channels, samples_per_step, heard_samples: 0, convolver }
    }

    /// Computes or loads the paths of all sources, instead of when they first sound.
    pub fn prepare(&self) {
        self.channels.iter().for_each(|channel| channel.emitter.source.prepare());
    }

    /// Bytes in ringing sound and filters, without sources and clips.
    pub fn resident_bytes(&self) -> usize {
        let channel = |channel: &Channel| {
            channel.dry.byte_count() + channel.previous.as_ref().map_or(0, |p| p.filter.byte_count())
        };
        self.convolver.byte_count() + self.channels.iter().map(channel).sum::<usize>()
    }

    /// Upper bound for [`Ears::resident_bytes`].
    pub fn max_bytes(&self) -> usize {
        let channels = self.channels.iter().map(|channel| self.convolver.max_bytes(&channel.dry));
        self.convolver.byte_count() + channels.sum::<usize>()
    }

    /// Returns the next step: `2 × samples_per_step` samples at [`SAMPLE_RATE_HZ`], left ear first.
    ///
    /// `listener` is the pose during the whole step; a new pose cross-fades in during the first 50 ms. Only
    /// emitter `sounding` plays (none for `None` or an unknown index). It starts and stops within 10 ms;
    /// earlier sound rings out. A clip with unit pressure at 1 m has gain 1 in the free field.
    pub fn hear(&mut self, listener: &Listener, sounding: Option<usize>) -> Vec<f32> {
        let count = self.samples_per_step;
        let mut heard = vec![0.0; 2 * count];
        if count == 0 {
            return heard;
        }
        for (index, channel) in self.channels.iter_mut().enumerate() {
            channel.feed(self.heard_samples, count, sounding == Some(index), &mut self.convolver);
            if channel.dry.is_silent() {
                if let Some(previous) = channel.previous.take() {
                    self.convolver.recycle(previous.filter);
                }
                continue;
            }
            for (sum, ear) in
                heard.chunks_mut(count).zip(channel.render(listener, count, &mut self.convolver))
            {
                sum.iter_mut().zip(ear).for_each(|(sum, sample)| *sum += sample);
            }
        }
        self.heard_samples += count;
        heard
    }
}

impl Channel {
    /// Appends a clip step, or silence, to the dry signal.
    fn feed(&mut self, start: usize, count: usize, sounding: bool, convolver: &mut Convolver) {
        let was_sounding = std::mem::replace(&mut self.sounding, sounding);
        if !sounding && !was_sounding && self.dry.is_silent() {
            return;
        }
        let clip = &self.emitter.clip.samples;
        let sample = |offset: usize| {
            let gain = switch_gain(offset, was_sounding, sounding);
            let place = self.emitter.offset_samples.wrapping_add(start + offset);
            if gain == 0.0 || clip.is_empty() { 0.0 } else { gain * clip[place % clip.len()] }
        };
        let block: Vec<f32> = (0..count).map(sample).collect();
        convolver.feed(&mut self.dry, &block);
    }

    fn render(&mut self, listener: &Listener, count: usize, convolver: &mut Convolver) -> [Vec<f32>; 2] {
        let only_rings = self.dry.silent >= count + RINGING_SAMPLES;
        let (mut now, before) = match self.previous.take() {
            // Then only a diffuse tail remains, with the previous response regardless of head motion.
            Some(before) if only_rings || before.listener == *listener => (before, None),
            before => self.turn(listener, before, convolver),
        };
        let mut ears = convolver.output(&self.dry, &mut now.filter);
        if let Some(mut filter) = before {
            let old = convolver.output(&self.dry, &mut filter);
            convolver.recycle(filter);
            for (new, old) in ears.iter_mut().zip(&old) {
                crossfade(&old[..CROSSFADE_SAMPLES.min(count)], new);
            }
        }
        self.previous = Some(now);
        ears
    }

    /// Returns the state for a new pose, and the previous filter.
    fn turn(
        &self,
        listener: &Listener,
        before: Option<Previous>,
        convolver: &Convolver,
    ) -> (Previous, Option<Filter>) {
        let source = &self.emitter.source;
        let (heard, old) = match before {
            Some(before) if before.listener.position == listener.position => {
                (before.heard, Some(before.filter))
            }
            before => (source.heard_at(&listener.position), before.map(|before| before.filter)),
        };
        let ImpulseResponse { left, right } = source.response(listener, &heard);
        (Previous { listener: *listener, heard, filter: convolver.filter([left, right]) }, old)
    }
}

/// Gain on the dry signal `offset` samples into a step.
fn switch_gain(offset: usize, was_sounding: bool, sounding: bool) -> f32 {
    let share = ((offset as f32 + 0.5) / SWITCH_SAMPLES as f32).min(1.0);
    match (was_sounding, sounding) {
        (true, true) => 1.0,
        (false, true) => share,
        (true, false) => 1.0 - share,
        (false, false) => 0.0,
    }
}

/// Fades linearly from `old` to `new` over the length of `old`.
fn crossfade(old: &[f32], new: &mut [f32]) {
    let length = old.len() as f32;
    for (offset, (new, old)) in new.iter_mut().zip(old).enumerate() {
        let share = (offset as f32 + 0.5) / length;
        *new = old + (*new - old) * share;
    }
}

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
    fn switches_fade_within_ten_milliseconds() {
        assert_eq!(SWITCH_SAMPLES, 160);
        assert_eq!(switch_gain(0, false, true) + switch_gain(0, true, false), 1.0);
        assert!((switch_gain(79, false, true) - 0.496_875).abs() < 1e-6);
        assert_eq!((switch_gain(160, false, true), switch_gain(160, true, false)), (1.0, 0.0));
        assert_eq!((switch_gain(0, true, true), switch_gain(0, false, false)), (1.0, 0.0));
    }

    #[test]
    fn ears_are_send() {
        fn movable<T: Send + 'static>() {}
        movable::<Ears>();
    }

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
