//! Signals at two ears for a moving listener and alternating sources.

use crate::SAMPLE_RATE_HZ;
use crate::clip::Clip;
use crate::convolver::{Convolver, Filter, Input};
use crate::impulse::{ImpulseResponse, Listener};
use crate::source::{Heard, Source};

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

#[cfg(test)]
mod tests {
    use super::*;

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
}
