//! Episode sound: levels by step, and WAV files for the replay page.

use super::{ByteSize, MaybeRenderQueue, RenderedSound, SoundRequest};
use crate::{
    error::{RequestError, Result},
    request::{PathOnly, RequestContext},
};
use avln_episode::Sensors;
use avln_store::EpisodeView;
use axum::{
    Extension,
    body::Bytes,
    http::{HeaderMap, HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};
use hound::{SampleFormat, WavSpec, WavWriter};
use std::io::Cursor;

// Step limit per file: half a minute, 3.8 MB. A file stays in memory during the download, which must end within the connection
// lifetime.
pub(crate) const WINDOW_STEPS: u32 = 120;
// Sound pressure at 0 dB, pascals. A sample value 1 counts as 1 Pa, which puts the clips at 67 dB(A) at 1 m.
const REFERENCE_PA: f64 = 20e-6;
const WAV: WavSpec = WavSpec {
    channels: Sensors::AUDIO_CHANNELS as u16,
    sample_rate: Sensors::SAMPLE_RATE_HZ,
    bits_per_sample: 32,
    sample_format: SampleFormat::Float,
};

#[derive(Debug, PartialEq)]
pub(crate) struct EpisodeSound {
    sound: RenderedSound,
    levels: Vec<StepLevels>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct StepLevels {
    /// RMS pressure at the left and right ear, pascals.
    pub(crate) rms: [f64; 2],
}

impl StepLevels {
    fn new(ears: [&[f32]; 2]) -> Self {
        let rms = |samples: &[f32]| {
            let squares: f64 = samples.iter().map(|sample| f64::from(*sample).powi(2)).sum();
            (squares / samples.len().max(1) as f64).sqrt()
        };
        Self { rms: ears.map(rms) }
    }

    /// Returns the level at each ear, decibels; `None` for inaudible sound.
    pub(crate) fn ears_db(&self) -> [Option<f64>; 2] {
        self.rms.map(level_db)
    }

    pub(crate) fn both_db(&self) -> Option<f64> {
        let [left, right] = self.rms;
        level_db(((left * left + right * right) / 2.0).sqrt())
    }
}

/// Converts RMS pressure to decibels; `None` below the hearing threshold.
fn level_db(rms: f64) -> Option<f64> {
    Some(20.0 * (rms / REFERENCE_PA).log10()).filter(|level| *level >= 0.0)
}

impl EpisodeSound {
    /// Computes the levels; `None` for unequal ears or incomplete steps.
    pub(super) fn new(sound: RenderedSound) -> Option<Self> {
        let RenderedSound { samples_per_step, left, right } = &sound;
        if *samples_per_step == 0 || left.len() != right.len() || left.len() % samples_per_step != 0 {
            return None;
        }
        let steps = left.chunks(*samples_per_step).zip(right.chunks(*samples_per_step));
        let levels = steps.map(|(left, right)| StepLevels::new([left, right])).collect();
        Some(Self { sound, levels })
    }

    /// Returns the levels by step; index 0 is before the first action.
    pub(crate) fn levels(&self) -> &[StepLevels] {
        &self.levels
    }

    /// Returns the steps `first` to `last` as a WAV file with the exact samples; `None` if the episode is shorter.
    pub(super) fn wav(&self, first: usize, last: usize) -> Option<Vec<u8>> {
        let RenderedSound { samples_per_step, left, right } = &self.sound;
        let count = last.checked_sub(first)?.checked_add(1)?.checked_mul(*samples_per_step)?;
        let start = first.checked_mul(*samples_per_step)?;
        let end = start.checked_add(count)?;
        let left = left.get(start..end)?;
        let right = right.get(start..end)?;
        let mut wav = Cursor::new(Vec::new());
        let mut writer = WavWriter::new(&mut wav, WAV).ok()?;
        for sample in left.iter().zip(right).flat_map(|(left, right)| [*left, *right]) {
            writer.write_sample(sample).ok()?;
        }
        writer.finalize().ok()?;
        Some(wav.into_inner())
    }
}

impl ByteSize for EpisodeSound {
    fn bytes(&self) -> usize {
        size_of_val(self.sound.left.as_slice())
            + size_of_val(self.sound.right.as_slice())
            + size_of_val(self.levels.as_slice())
    }
}

/// Returns the steps in the same file as `step`, for an episode that ends at `last`.
pub(crate) fn window_of(step: u32, last: u32) -> [u32; 2] {
    let first = step - step % WINDOW_STEPS;
    [first, last.min(first + WINDOW_STEPS - 1)]
}

/// Returns the sound request; `None` if the viewer may not hear the episode.
pub(super) fn request_for(view: &EpisodeView) -> Option<SoundRequest> {
    view.replay.as_ref().filter(|replay| replay.hears)?;
    Some(SoundRequest { phase: view.run.phase.clone(), run: view.run.run.clone(), ordinal: view.ordinal })
}

/// Serves the sound file `FIRST-LAST.wav`.
pub(crate) async fn sound(
    context: RequestContext,
    PathOnly((run, ordinal, file)): PathOnly<(String, String, String)>,
    Extension(queue): Extension<MaybeRenderQueue>,
    headers: HeaderMap,
) -> Result<Response> {
    let view = context.episode(&run, &ordinal).await?;
    let unknown = || RequestError::unknown("sound", format!("{file} of episode {ordinal} of run {run}"));
    let queue = queue.ok_or_else(unknown)?;
    let [first, last] = steps_of(&file).ok_or_else(unknown)?;
    request_for(&view).ok_or_else(unknown)?;
    if last.saturating_sub(first) >= WINDOW_STEPS {
        return Err(RequestError::Invalid(format!(
            "steps {first} to {last} of episode {ordinal} exceed the limit of {WINDOW_STEPS} steps in one file"
        )));
    }
    let sound = queue.sound(&view).await?.ok_or_else(unknown)?;
    let wav = sound.wav(first as usize, last as usize).ok_or_else(unknown)?;
    Ok(ranged("audio/wav", wav, &headers))
}

fn steps_of(file: &str) -> Option<[u32; 2]> {
    let (first, last) = file.strip_suffix(".wav")?.split_once('-')?;
    Some([first.parse().ok()?, last.parse().ok()?])
}

/// Returns a response with `bytes`, or with the byte range that the client requested.
fn ranged(kind: &'static str, bytes: Vec<u8>, requested: &HeaderMap) -> Response {
    let bytes = Bytes::from(bytes);
    let headers = [(header::CONTENT_TYPE, kind), (header::ACCEPT_RANGES, "bytes")];
    let Some((first, last)) = byte_range(requested, bytes.len()) else {
        return (headers, bytes).into_response();
    };
    let range = format!("bytes {first}-{last}/{}", bytes.len());
    let mut response = (StatusCode::PARTIAL_CONTENT, headers, bytes.slice(first..=last)).into_response();
    // A part has no ETag, so a cached copy could not be revalidated.
    response.headers_mut().insert(header::CACHE_CONTROL, HeaderValue::from_static("private, no-store"));
    if let Ok(range) = HeaderValue::from_str(&range) {
        response.headers_mut().insert(header::CONTENT_RANGE, range);
    }
    response
}

/// Returns the first and last requested byte. `None` means the whole file, which is also a valid response to multiple ranges.
fn byte_range(requested: &HeaderMap, length: usize) -> Option<(usize, usize)> {
    // Our tags are weak, and a weak tag never matches `If-Range`.
    if requested.contains_key(header::IF_RANGE) {
        return None;
    }
    let range = requested.get(header::RANGE)?.to_str().ok()?.strip_prefix("bytes=")?;
    let end = length.checked_sub(1)?;
    let (first, last) = match range.split_once('-')? {
        ("", count) => (length.checked_sub(count.parse().ok()?)?, end),
        (first, "") => (first.parse().ok()?, end),
        (first, last) => (first.parse().ok()?, last.parse::<usize>().ok()?.min(end)),
    };
    (first <= last && last < length).then_some((first, last))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sound() -> EpisodeSound {
        let sound = RenderedSound {
            samples_per_step: 2,
            left: vec![0.5, -0.5, 0.02, 0.02, 0.0, 0.0],
            right: vec![0.0, 0.0, 0.002, -0.002, 1e-7, 0.0],
        };
        EpisodeSound::new(sound).expect("whole steps")
    }

    #[test]
    fn levels_follow_sound_pressure() {
        let rounded =
            |levels: &StepLevels| levels.ears_db().map(|level| level.map(|level| level.round() as i32));
        let levels: Vec<_> = sound().levels().iter().map(rounded).collect();
        assert_eq!(levels, [[Some(88), None], [Some(60), Some(40)], [None, None]]);
        let both = sound().levels()[1].both_db().expect("audible");
        assert!((both - 57.03).abs() < 0.01, "{both}");
        assert_eq!(sound().levels()[2].both_db(), None);
    }

    #[test]
    fn wav_files_hold_the_exact_samples() {
        let wav = sound().wav(1, 2).expect("both steps");
        let mut reader = hound::WavReader::new(&wav[..]).expect("a WAV file");
        assert_eq!((reader.spec(), reader.spec().sample_rate, reader.duration()), (WAV, 16_000, 4));
        let samples: Vec<f32> = reader.samples().map(|sample| sample.expect("a sample")).collect();
        assert_eq!(samples, [0.02, 0.002, 0.02, -0.002, 0.0, 1e-7, 0.0, 0.0]);
        assert_eq!((sound().wav(2, 3), sound().wav(2, 1), sound().wav(0, usize::MAX)), (None, None, None));
    }

    #[test]
    fn ears_of_different_length_are_rejected() {
        let sound = RenderedSound { samples_per_step: 2, left: vec![0.0; 4], right: vec![0.0; 4] };
        assert!(EpisodeSound::new(sound.clone()).is_some());
        assert_eq!(EpisodeSound::new(RenderedSound { right: vec![0.0; 2], ..sound.clone() }), None);
        assert_eq!(EpisodeSound::new(RenderedSound { samples_per_step: 3, ..sound.clone() }), None);
        assert_eq!(EpisodeSound::new(RenderedSound { samples_per_step: 0, ..sound }), None);
    }

    #[test]
    fn file_names_are_parsed() {
        assert_eq!(steps_of("0-119.wav"), Some([0, 119]));
        for wrong in ["0-119", "0.wav", "-1-5.wav", "a-b.wav", "0-4294967296.wav", "..-..wav"] {
            assert_eq!(steps_of(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn windows_cover_every_step() {
        assert_eq!(
            [0, 119, 120, 250].map(|step| window_of(step, 250)),
            [[0, 119], [0, 119], [120, 239], [240, 250]]
        );
        assert_eq!(window_of(0, 0), [0, 0]);
    }

    fn range_of(range: &'static str) -> Option<(usize, usize)> {
        byte_range(&HeaderMap::from_iter([(header::RANGE, HeaderValue::from_static(range))]), 10)
    }

    #[test]
    fn single_ranges_are_served() {
        assert_eq!(range_of("bytes=0-"), Some((0, 9)));
        assert_eq!(range_of("bytes=2-3"), Some((2, 3)));
        assert_eq!(range_of("bytes=2-99"), Some((2, 9)));
        assert_eq!(range_of("bytes=-4"), Some((6, 9)));
        for all in [
            "bytes=10-",
            "bytes=-11",
            "bytes=-0",
            "bytes=3-2",
            "bytes=0-1,3-4",
            "bytes=x-",
            "steps=0-1",
            "bytes=",
        ] {
            assert_eq!(range_of(all), None, "{all}");
        }
        let both = [(header::RANGE, "bytes=0-1"), (header::IF_RANGE, "W/\"a\"")];
        let both = both.map(|(name, value)| (name, HeaderValue::from_static(value)));
        assert_eq!(byte_range(&HeaderMap::from_iter(both), 10), None);
        assert_eq!(
            byte_range(&HeaderMap::from_iter([(header::RANGE, HeaderValue::from_static("bytes=0-"))]), 0),
            None
        );
    }
}
