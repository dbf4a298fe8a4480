use super::{Heard, shelf::Kept};
use avln_episode::Sensors;

/// Sound pressure of 0 dB. The unit of samples counts as a pascal: what is made equally loud then has 67 dB(A) a metre away.
const REFERENCE: f64 = 20e-6;
/// Bytes of a file before its samples.
const HEAD_BYTES: usize = 58;
const CHANNELS: usize = Sensors::AUDIO_CHANNELS as usize;
const SAMPLE_BYTES: usize = size_of::<f32>();

/// What both ears heard in an episode, with its level by step.
#[derive(Debug, PartialEq)]
pub(crate) struct Sound {
    heard: Heard,
    levels: Vec<Levels>,
}

/// How loud a step was at each ear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Levels {
    /// Root mean square of the pressure, left and right.
    pub(crate) rms: [f64; 2],
}

impl Levels {
    fn of(ears: [&[f32]; 2]) -> Self {
        let rms = |samples: &[f32]| {
            let squares: f64 = samples.iter().map(|sample| f64::from(*sample).powi(2)).sum();
            (squares / samples.len().max(1) as f64).sqrt()
        };
        Self { rms: ears.map(rms) }
    }

    /// Level at each ear, decibels; `None` for what nobody hears.
    pub(crate) fn ears_db(&self) -> [Option<f64>; 2] {
        self.rms.map(level_db)
    }

    /// Level of both ears together, decibels.
    pub(crate) fn both_db(&self) -> Option<f64> {
        let [left, right] = self.rms;
        level_db(((left * left + right * right) / 2.0).sqrt())
    }
}

/// Level of a root mean square; `None` below the threshold of hearing.
fn level_db(rms: f64) -> Option<f64> {
    Some(20.0 * (rms / REFERENCE).log10()).filter(|level| *level >= 0.0)
}

impl Sound {
    /// `None` where the ears did not hear the same whole steps.
    pub(super) fn of(heard: Heard) -> Option<Self> {
        let Heard { samples_per_step, left, right } = &heard;
        if *samples_per_step == 0 || left.len() != right.len() || left.len() % samples_per_step != 0 {
            return None;
        }
        let steps = left.chunks(*samples_per_step).zip(right.chunks(*samples_per_step));
        let levels = steps.map(|(left, right)| Levels::of([left, right])).collect();
        Some(Self { heard, levels })
    }

    /// Levels by step; the first is before the first action.
    pub(crate) fn levels(&self) -> &[Levels] {
        &self.levels
    }

    /// The steps from `first` to `last` as a WAV file of 32-bit floats, bit for bit what was sent; `None` where there are no such
    /// steps.
    pub(super) fn wav(&self, first: usize, last: usize) -> Option<Vec<u8>> {
        let Heard { samples_per_step, left, right } = &self.heard;
        let count = last.checked_sub(first)?.checked_add(1)?.checked_mul(*samples_per_step)?;
        let from = first.checked_mul(*samples_per_step)?;
        let (left, right) = (part(left, from, count)?, part(right, from, count)?);
        let mut wav = head(left.len())?;
        for (left, right) in left.iter().zip(right) {
            wav.extend(left.to_le_bytes());
            wav.extend(right.to_le_bytes());
        }
        Some(wav)
    }
}

/// So many samples from one on; `None` where there are fewer.
fn part(samples: &[f32], from: usize, count: usize) -> Option<&[f32]> {
    samples.get(from..)?.get(..count)
}

impl Kept for Sound {
    fn bytes(&self) -> usize {
        size_of_val(self.heard.left.as_slice())
            + size_of_val(self.heard.right.as_slice())
            + size_of_val(self.levels.as_slice())
    }
}

/// What stands before so many samples of each channel: RIFF, the format 3 (floats), how many there are.
fn head(samples: usize) -> Option<Vec<u8>> {
    let frame_bytes = CHANNELS * SAMPLE_BYTES;
    let data_bytes = samples.checked_mul(frame_bytes)?;
    let number = |value: usize| u32::try_from(value).ok().map(u32::to_le_bytes);
    let mut wav = Vec::with_capacity(HEAD_BYTES + data_bytes);
    wav.extend(b"RIFF");
    wav.extend(number(HEAD_BYTES - 8 + data_bytes)?);
    wav.extend(b"WAVEfmt ");
    wav.extend(18_u32.to_le_bytes());
    wav.extend([3_u16, CHANNELS as u16].map(u16::to_le_bytes).concat());
    wav.extend(Sensors::SAMPLE_RATE_HZ.to_le_bytes());
    wav.extend(number(Sensors::SAMPLE_RATE_HZ as usize * frame_bytes)?);
    wav.extend([frame_bytes as u16, 8 * SAMPLE_BYTES as u16, 0].map(u16::to_le_bytes).concat());
    wav.extend(b"fact");
    wav.extend(4_u32.to_le_bytes());
    wav.extend(number(samples)?);
    wav.extend(b"data");
    wav.extend(number(data_bytes)?);
    Some(wav)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sound() -> Sound {
        let heard = Heard {
            samples_per_step: 2,
            left: vec![0.5, -0.5, 0.02, 0.02, 0.0, 0.0],
            right: vec![0.0, 0.0, 0.002, -0.002, 1e-7, 0.0],
        };
        Sound::of(heard).expect("whole steps")
    }

    #[test]
    fn levels_are_those_of_sound_pressure() {
        let rounded = |levels: &Levels| levels.ears_db().map(|level| level.map(|level| level.round() as i32));
        let levels: Vec<_> = sound().levels().iter().map(rounded).collect();
        assert_eq!(levels, [[Some(88), None], [Some(60), Some(40)], [None, None]]);
        let both = sound().levels()[1].both_db().expect("it is heard");
        assert!((both - 57.03).abs() < 0.01, "{both}");
        assert_eq!(sound().levels()[2].both_db(), None);
    }

    #[test]
    fn a_file_holds_the_samples_of_its_steps_bit_for_bit() {
        let wav = sound().wav(1, 2).expect("both steps");
        assert_eq!(wav.len(), HEAD_BYTES + 2 * 2 * 8);
        assert!(wav.starts_with(b"RIFF") && wav[8..16] == *b"WAVEfmt " && wav[50..54] == *b"data");
        let word = |at: usize| u32::from_le_bytes([wav[at], wav[at + 1], wav[at + 2], wav[at + 3]]);
        assert_eq!([word(4) as usize, word(54) as usize], [wav.len() - 8, wav.len() - HEAD_BYTES]);
        assert_eq!([word(24), word(28), word(46)], [16_000, 128_000, 4], "rate, bytes a second, samples");
        let samples: Vec<f32> =
            (HEAD_BYTES..wav.len()).step_by(4).map(|at| f32::from_bits(word(at))).collect();
        assert_eq!(samples, [0.02, 0.002, 0.02, -0.002, 0.0, 1e-7, 0.0, 0.0]);
        assert_eq!((sound().wav(2, 3), sound().wav(2, 1), sound().wav(0, usize::MAX)), (None, None, None));
    }

    #[test]
    fn ears_that_did_not_hear_the_same_steps_heard_nothing() {
        let heard = Heard { samples_per_step: 2, left: vec![0.0; 4], right: vec![0.0; 4] };
        assert!(Sound::of(heard.clone()).is_some());
        assert_eq!(Sound::of(Heard { right: vec![0.0; 2], ..heard.clone() }), None);
        assert_eq!(Sound::of(Heard { samples_per_step: 3, ..heard.clone() }), None);
        assert_eq!(Sound::of(Heard { samples_per_step: 0, ..heard }), None);
    }
}
