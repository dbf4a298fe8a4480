use super::*;
use hound::{SampleFormat, WavSpec, WavWriter};
use std::f32::consts::TAU;
use tempfile::TempDir;

mod flac;

fn folder() -> TempDir {
    tempfile::tempdir().expect("a folder for temporary files")
}

/// A second and a half of two tones, -1 to 1.
fn tones(rate_hz: u32) -> Vec<f32> {
    let turn = |frequency_hz: f32, n: usize| TAU * (frequency_hz * n as f32 / rate_hz as f32).fract();
    let sample = |n: usize| 0.3 * turn(440.0, n).sin() + 0.3 * turn(2500.0, n).sin();
    (0..rate_hz as usize * 3 / 2).map(sample).collect()
}

/// Mono, or two equal channels.
fn wav(path: &Path, rate_hz: u32, channels: u16, bits: u16) {
    let sample_format = if bits == 32 { SampleFormat::Float } else { SampleFormat::Int };
    let spec = WavSpec { channels, sample_rate: rate_hz, bits_per_sample: bits, sample_format };
    let mut writer = WavWriter::create(path, spec).expect("a file");
    for sample in tones(rate_hz) {
        for _ in 0..channels {
            match bits {
                32 => writer.write_sample(sample).expect("written"),
                bits => writer
                    .write_sample((sample * ((1_i64 << (bits - 1)) - 1) as f32) as i32)
                    .expect("written"),
            }
        }
    }
    writer.finalize().expect("written");
}

/// The largest difference of two clips of the same length.
fn difference(a: &Clip, b: &Clip) -> f32 {
    assert_eq!(a.samples.len(), b.samples.len(), "{} and {}", a.name, b.name);
    a.samples.iter().zip(b.samples.iter()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn the_same_sound_in_any_file_is_the_same_clip() {
    let folder = folder();
    let place = |name: &str| folder.path().join(name);
    wav(&place("a float.wav"), 16_000, 1, 32);
    for (name, rate_hz, channels, bits) in [
        ("b.WAV", 16_000, 2, 16),
        ("c.wav", 44_100, 1, 24),
        ("d.wav", 48_000, 2, 16),
        ("e.wav", 22_050, 1, 8),
    ] {
        wav(&place(name), rate_hz, channels, bits);
    }
    fs::write(place("f.flac"), flac::encoded(&tones(16_000), 16_000, 16)).expect("written");
    fs::write(place("g.flac"), flac::encoded(&tones(48_000), 48_000, 24)).expect("written");
    fs::write(place("notes.txt"), "not a recording").expect("written");
    let clips = read_folder(folder.path()).expect("seven clips");
    let names: Vec<_> = clips.iter().map(|clip| clip.name.as_str()).collect();
    assert_eq!(names, ["a float", "b", "c", "d", "e", "f", "g"]);
    for clip in &clips[1..] {
        // The last and the first 50 ms sound together; a resampled recording ends in half of a filter.
        let tolerance = if clip.name == "e" { 2e-3 } else { 2e-4 };
        let middle =
            |clip: &Clip| Clip { name: clip.name.clone(), samples: clip.samples[1000..22_000].into() };
        let found = difference(&middle(&clips[0]), &middle(clip));
        assert!(found < tolerance, "{}: {found}", clip.name);
    }
}

/// Error for a folder with this file only.
fn refusal(name: &str, bytes: &[u8]) -> String {
    let folder = folder();
    fs::write(folder.path().join(name), bytes).expect("written");
    let refused = read_folder(folder.path()).expect_err("no clip");
    assert_eq!(refused.kind(), FailureKind::Data);
    refused.to_string()
}

#[test]
fn files_that_cannot_be_clips_are_refused_by_name() {
    let folder = folder();
    let path = folder.path().join("whole.wav");
    wav(&path, 16_000, 1, 16);
    let whole = fs::read(&path).expect("written");
    let flac = flac::encoded(&tones(16_000), 16_000, 16);
    let mut silent = whole.clone();
    silent[44..].fill(0);
    let mut damaged = flac.clone();
    let middle = damaged.len() / 2;
    damaged[middle] ^= 0x55;
    let cases: [(&str, &[u8], &str); 8] = [
        ("empty.wav", &[], ""),
        ("empty.flac", &[], ""),
        ("text.wav", b"this is no sound at all, and long enough for a header of any kind", ""),
        ("cut.wav", &whole[..whole.len() / 2], ""),
        ("cut.flac", &flac[..flac.len() / 2], ""),
        ("damaged.flac", &damaged, ""),
        ("silent.wav", &silent, "it is silent"),
        ("short.flac", &flac::encoded(&tones(16_000)[..9000], 16_000, 16), "0.56 s long"),
    ];
    for (name, bytes, reason) in cases {
        let said = refusal(name, bytes);
        assert!(said.contains(name) && said.contains(reason) && said.len() > 40, "{name}: {said}");
    }
    let path = folder.path().join("surround.wav");
    wav(&path, 16_000, 6, 16);
    let said = read_folder(folder.path()).expect_err("six channels").to_string();
    assert!(said.contains("surround.wav") && said.contains("6 channels"), "{said}");
}

#[test]
fn no_bytes_make_reading_panic() {
    let folder = folder();
    let path = folder.path().join("whole.wav");
    wav(&path, 8_000, 1, 16);
    let whole = fs::read(&path).expect("written");
    let flac = flac::encoded(&tones(8_000), 8_000, 16);
    let mut rng = avln_geom::Rng::new(5);
    for (name, bytes) in [("a.wav", whole), ("a.flac", flac)] {
        let target = folder.path().join(name);
        for _ in 0..150 {
            let mut broken = bytes.clone();
            (0..3).for_each(|_| broken[rng.below(60)] = rng.next_u64() as u8);
            fs::write(&target, &broken).expect("written");
            // Some of them are still sounds.
            let _ = read(&target);
        }
    }
}

#[test]
fn folders_without_recordings_are_refused() {
    let folder = folder();
    let said = read_folder(folder.path()).expect_err("nothing in it").to_string();
    assert!(said.contains("holds 0 .wav and .flac files"), "{said}");
    let said = read_folder(&folder.path().join("elsewhere")).expect_err("no such folder").to_string();
    assert!(said.contains("elsewhere") && said.contains("train"), "{said}");
}

#[test]
fn a_bank_is_kept_as_it_is_played_and_checked_when_it_is_read() {
    let (source, data) = (folder(), folder());
    wav(&source.path().join("a.wav"), 44_100, 1, 16);
    fs::write(source.path().join("b.flac"), flac::encoded(&tones(16_000)[..20_000], 16_000, 16))
        .expect("written");
    let sounds = SoundFolder::at(&data.path().join("sounds"));
    let digest = sounds.adopt(source.path()).expect("two clips");
    assert_eq!(sounds.adopt(source.path()).expect("the same"), digest);
    let read = read_folder(source.path()).expect("two clips");
    drop(source);
    let bank = sounds.bank(&digest).expect("kept");
    assert!(bank.clips().zip(&read).all(|(kept, read)| kept.samples == read.samples) && bank.len() == 2);
    let file = data.path().join("sounds").join(&digest).join("0001.wav");
    let mut bytes = fs::read(&file).expect("kept");
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    fs::write(&file, bytes).expect("written");
    let said = sounds.bank(&digest).expect_err("changed").to_string();
    assert!(said.contains(&digest) && said.contains("somebody has changed them"), "{said}");
    fs::remove_file(&file).expect("kept");
    assert!(sounds.bank(&digest).is_err() && sounds.bank("c0ffee").is_err());
}
