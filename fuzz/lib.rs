//! Helpers of the fuzz targets.

use avln_dataset::{
    SceneLine, SceneSource,
    format::{File, digest_of, read_scene},
};
use avln_proto::wire::{Encoding, Size, audio, depth, rgb};
use serde_json::{Value, json};
use std::{
    fs,
    panic::{set_hook, take_hook},
    path::Path,
};

/// Calls `read` with a temporary file with these bytes.
pub fn with_file(name: &str, bytes: &[u8], read: impl FnOnce(&Path)) {
    with_files(&[(name, bytes)], |folder| read(&folder.join(name)));
}

/// Calls `read` with a temporary folder with these files.
pub fn with_files(files: &[(&str, &[u8])], read: impl FnOnce(&Path)) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, bytes) in files {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().expect("a folder")).expect("a temporary folder");
        fs::write(&path, bytes).expect("a temporary file");
    }
    read(folder.path());
}

/// Permits panics in libraries, for a reader that catches them: libFuzzer also ends the program at a caught panic.
pub fn permit_panics_in_libraries() {
    let end = take_hook();
    set_hook(Box::new(move |panic| {
        let is_in_library = panic.location().is_some_and(|place| place.file().contains("/registry/src/"));
        if !is_in_library {
            end(panic);
        }
    }));
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
    let size = Size { width: u32::from(kind % 16) + 1, height: u32::from(kind / 16) + 1 };
    for encoding in (0..32).filter_map(|number| Encoding::try_from(number).ok()) {
        let _ = audio::decode(encoding, usize::from(kind), bytes);
        let _ = depth::decode(encoding, depth::Layout { size, unit_m: 0.001 }, bytes);
        let _ = rgb::decode(encoding, size, bytes.to_vec().into());
    }
}

/// Returns a binary glTF file with a triangle and this texture.
pub fn textured(picture: &[u8]) -> Vec<u8> {
    const TRIANGLE: [f32; 9] = [0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, -2.0];
    let contents = [&bytes_of(&TRIANGLE)[..], picture].concat();
    let document = json!({
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "material": 0 }] }],
        "materials": [{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }],
        "textures": [{ "source": 0 }],
        "images": [{ "bufferView": 1 }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3" }],
        "bufferViews": [
            { "buffer": 0, "byteLength": 36 },
            { "buffer": 0, "byteOffset": 36, "byteLength": picture.len() },
        ],
        "buffers": [{ "byteLength": contents.len() }],
    });
    binary_gltf(&document, &contents)
}

/// Returns a binary glTF file with a primitive that Draco has packed in these bytes.
pub fn packed(mesh: &[u8]) -> Vec<u8> {
    let attributes = json!({ "POSITION": 0, "TEXCOORD_0": 1, "COLOR_0": 2 });
    let extension = json!({ "bufferView": 0, "attributes": attributes });
    let document = json!({
        "extensionsRequired": ["KHR_draco_mesh_compression"],
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{
            "attributes": attributes,
            "extensions": { "KHR_draco_mesh_compression": extension },
        }] }],
        "accessors": [
            { "componentType": 5126, "count": 16, "type": "VEC3" },
            { "componentType": 5126, "count": 16, "type": "VEC2" },
            { "componentType": 5121, "count": 16, "type": "VEC4", "normalized": true },
        ],
        "bufferViews": [{ "buffer": 0, "byteLength": mesh.len() }],
        "buffers": [{ "byteLength": mesh.len() }],
    });
    binary_gltf(&document, mesh)
}

fn bytes_of(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

fn binary_gltf(document: &Value, contents: &[u8]) -> Vec<u8> {
    let chunk = |kind: &[u8; 4], contents: &[u8], padding: u8| {
        let mut contents = contents.to_vec();
        contents.resize(contents.len().next_multiple_of(4), padding);
        [&(contents.len() as u32).to_le_bytes()[..], kind, &contents].concat()
    };
    let json = chunk(b"JSON", document.to_string().as_bytes(), b' ');
    let body = [json, chunk(b"BIN\0", contents, 0)].concat();
    let length = 12 + body.len() as u32;
    [&b"glTF"[..], &2_u32.to_le_bytes(), &length.to_le_bytes(), &body].concat()
}
