//! Helpers of the fuzz targets.

use avln_dataset::{
    SceneLine, SceneSource,
    format::{File, digest_of, read_scene},
};
use avln_proto::wire::{Encoding, audio, depth, rgb};
use std::{fs, path::Path};

/// Calls `read` with a temporary file with these bytes.
pub fn with_file(name: &str, bytes: &[u8], read: impl FnOnce(&Path)) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join(name);
    fs::write(&path, bytes).expect("a temporary file");
    read(&path);
}

/// Returns a run log's lines with valid hashes, as an attacker without the key can write them.
pub fn chained(bytes: &[u8]) -> Vec<u8> {
    let (mut head, mut text) = (String::new(), String::new());
    for line in String::from_utf8_lossy(bytes).lines() {
        let json = line.split_once(' ').map_or(line, |(_, json)| json);
        head = digest_of(format!("{head}\n{json}").as_bytes())[..32].to_owned();
        text += &format!("{head} {json}\n");
    }
    text.into_bytes()
}

/// Reads both files of a scene, separated by an empty line; `@` in the second one stands for the digest of the first.
pub fn read_parts(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let Some((missions, sealed)) = text.split_once("\n\n") else { return };
    let public = digest_of(missions.as_bytes());
    let sealed = sealed.replace('@', &public);
    let line = SceneLine {
        name: "a".to_owned(),
        source: SceneSource::File { path: "a.glb".into() },
        digest: String::new(),
        facts: None,
        missions: missions.lines().count().saturating_sub(1),
        public,
        sealed: digest_of(sealed.as_bytes()),
    };
    let missions = File { name: "missions", bytes: missions.as_bytes() };
    let sealed = File { name: "sealed", bytes: sealed.as_bytes() };
    let _ = read_scene(&line, missions, sealed);
}

/// Decodes pictures and sound in every encoding.
pub fn decode(kind: u8, bytes: &[u8]) {
    let size = wire_size(kind);
    for encoding in (0..32).filter_map(|number| Encoding::try_from(number).ok()) {
        let _ = audio::decode(encoding, usize::from(kind), bytes);
        let _ = depth::decode(encoding, depth::Layout { size, unit_m: 0.001 }, bytes);
        let _ = rgb::decode(encoding, size, bytes.to_vec().into());
    }
}

fn wire_size(kind: u8) -> avln_proto::wire::Size {
    avln_proto::wire::Size { width: u32::from(kind % 16) + 1, height: u32::from(kind / 16) + 1 }
}
