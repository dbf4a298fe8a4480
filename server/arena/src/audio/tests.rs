use super::*;
use crate::FailureKind;
use hound::{SampleFormat, WavSpec, WavWriter};
use std::f32::consts::TAU;
use tempfile::TempDir;

fn folder() -> TempDir {
    tempfile::tempdir().expect("a folder for temporary files")
}

/// A sound with two tones, 1.5 s, -1 to 1.
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

/// Returns the largest difference between two clips.
fn difference(a: &Clip, b: &Clip) -> f32 {
    assert_eq!(a.samples.len(), b.samples.len(), "{} and {}", a.name, b.name);
    a.samples.iter().zip(b.samples.iter()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn all_formats_decode_to_the_same_clip() {
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
    fs::write(place("f.flac"), flac_bytes(&tones(16_000), 16_000, 16)).expect("written");
    fs::write(place("g.flac"), flac_bytes(&tones(48_000), 48_000, 24)).expect("written");
    fs::write(place("notes.txt"), "not a recording").expect("written");
    let clips = read_recordings(folder.path()).expect("seven clips");
    let names: Vec<_> = clips.iter().map(|clip| clip.name.as_str()).collect();
    assert_eq!(names, ["a float", "b", "c", "d", "e", "f", "g"]);
    for clip in &clips[1..] {
        // The last and the first 50 ms sound together; a resampled recording ends in half a filter.
        let tolerance = if clip.name == "e" { 2e-3 } else { 2e-4 };
        let middle =
            |clip: &Clip| Clip { name: clip.name.clone(), samples: clip.samples[1000..22_000].into() };
        let found = difference(&middle(&clips[0]), &middle(clip));
        assert!(found < tolerance, "{}: {found}", clip.name);
    }
}

/// Returns the error for a folder with this file only.
fn refusal(name: &str, bytes: &[u8]) -> String {
    let folder = folder();
    fs::write(folder.path().join(name), bytes).expect("written");
    let refused = read_recordings(folder.path()).expect_err("no clip");
    assert_eq!(refused.kind(), FailureKind::Data);
    refused.to_string()
}

#[test]
fn invalid_recordings_are_refused_by_name() {
    let folder = folder();
    let path = folder.path().join("whole.wav");
    wav(&path, 16_000, 1, 16);
    let whole = fs::read(&path).expect("written");
    let flac = flac_bytes(&tones(16_000), 16_000, 16);
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
        ("short.flac", &flac_bytes(&tones(16_000)[..9000], 16_000, 16), "0.56 s long"),
    ];
    for (name, bytes, reason) in cases {
        let said = refusal(name, bytes);
        assert!(said.contains(name) && said.contains(reason) && said.len() > 40, "{name}: {said}");
    }
    let path = folder.path().join("surround.wav");
    wav(&path, 16_000, 6, 16);
    let said = read_recordings(folder.path()).expect_err("six channels").to_string();
    assert!(said.contains("surround.wav") && said.contains("6 channels"), "{said}");
}

#[test]
fn random_bytes_cause_no_panic() {
    let folder = folder();
    let path = folder.path().join("whole.wav");
    wav(&path, 8_000, 1, 16);
    let whole = fs::read(&path).expect("written");
    let flac = flac_bytes(&tones(8_000), 8_000, 16);
    let mut rng = avln_geom::Rng::new(5);
    for (name, bytes) in [("a.wav", whole), ("a.flac", flac)] {
        let target = folder.path().join(name);
        for _ in 0..150 {
            let mut broken = bytes.clone();
            (0..3).for_each(|_| broken[rng.below(60)] = rng.next_u64() as u8);
            fs::write(&target, &broken).expect("written");
            // Some are still sounds.
            let _ = read_recording(&target);
        }
    }
}

#[test]
fn folders_without_recordings_are_refused() {
    let folder = folder();
    let said = read_recordings(folder.path()).expect_err("nothing in it").to_string();
    assert!(said.contains("has 0 .wav and .flac files"), "{said}");
    let said = read_recordings(&folder.path().join("elsewhere")).expect_err("no such folder").to_string();
    assert!(said.contains("elsewhere") && said.contains("train"), "{said}");
}

#[test]
fn stored_banks_are_exact_and_checked() {
    let (source, data) = (folder(), folder());
    wav(&source.path().join("a.wav"), 44_100, 1, 16);
    fs::write(source.path().join("b.flac"), flac_bytes(&tones(16_000)[..20_000], 16_000, 16))
        .expect("written");
    let sounds = SoundFolder::at(&data.path().join("sounds"));
    let digest = sounds.import(source.path()).expect("two clips");
    assert_eq!(sounds.import(source.path()).expect("the same"), digest);
    let read = read_recordings(source.path()).expect("two clips");
    drop(source);
    let bank = sounds.bank(&digest).expect("kept");
    assert!(bank.clips().zip(&read).all(|(kept, read)| kept.samples == read.samples) && bank.len() == 2);
    let file = data.path().join("sounds").join(&digest).join("0001.wav");
    let mut bytes = fs::read(&file).expect("kept");
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    fs::write(&file, bytes).expect("written");
    let said = sounds.bank(&digest).expect_err("changed").to_string();
    assert!(said.contains(&digest) && said.contains("the files were changed"), "{said}");
    fs::remove_file(&file).expect("kept");
    assert!(sounds.bank(&digest).is_err() && sounds.bank("c0ffee").is_err());
}

// A writer of FLAC files (RFC 9639) without compression: mono, constant blocks, no prediction.

/// Samples per block.
const BLOCK: usize = 4096;

/// Encodes `samples`, -1 to 1, with 16 or 24 `bits`.
fn flac_bytes(samples: &[f32], rate_hz: u32, bits: u32) -> Vec<u8> {
    let mut file = b"fLaC".to_vec();
    // The only and last metadata block: stream info, 34 bytes.
    file.extend([0x80, 0, 0, 34]);
    let mut facts = Bits::default();
    facts.put(BLOCK as u64, 16);
    facts.put(BLOCK as u64, 16);
    facts.put(0, 48);
    facts.put(u64::from(rate_hz), 20);
    facts.put(0, 3);
    facts.put(u64::from(bits - 1), 5);
    facts.put(samples.len() as u64, 36);
    file.extend(facts.bytes);
    file.extend([0; 16]);
    for (number, block) in samples.chunks(BLOCK).enumerate() {
        file.extend(frame(number, block, bits));
    }
    file
}

fn frame(number: usize, samples: &[f32], bits: u32) -> Vec<u8> {
    let mut frame = Bits::default();
    frame.put(0xfff8, 16);
    // Block size in 16 bits at the end of the header; rate from the stream info.
    frame.put(0b0111_0000, 8);
    frame.put(0, 4);
    frame.put(if bits == 16 { 0b100 } else { 0b110 }, 3);
    frame.put(0, 1);
    assert!(number < 128, "a number of one byte");
    frame.put(number as u64, 8);
    frame.put(samples.len() as u64 - 1, 16);
    let header_check = checksum(&frame.bytes, 0x07, 8);
    frame.put(header_check, 8);
    // A subframe with plain samples.
    frame.put(0b0000_0010, 8);
    let full_scale = ((1_i64 << (bits - 1)) - 1) as f32;
    for sample in samples {
        frame.put((sample * full_scale) as i64 as u64, bits);
    }
    let check = checksum(&frame.bytes, 0x8005, 16);
    frame.put(check, 16);
    frame.bytes
}

/// Bits, the highest first.
#[derive(Default)]
struct Bits {
    bytes: Vec<u8>,
    filled: u32,
}

impl Bits {
    fn put(&mut self, value: u64, count: u32) {
        for bit in (0..count).rev() {
            if self.filled.is_multiple_of(8) {
                self.bytes.push(0);
            }
            let last = self.bytes.len() - 1;
            self.bytes[last] |= ((value >> bit & 1) as u8) << (7 - self.filled % 8);
            self.filled += 1;
        }
    }
}

/// Returns a cyclic redundancy check with `width` bits.
fn checksum(bytes: &[u8], polynomial: u64, width: u32) -> u64 {
    let top = 1 << (width - 1);
    bytes.iter().fold(0, |sum, &byte| {
        (0..8).fold(sum ^ (u64::from(byte) << (width - 8)), |sum: u64, _| {
            let shifted = sum << 1;
            (if sum & top != 0 { shifted ^ polynomial } else { shifted }) & (2 * top - 1)
        })
    })
}
