//! Files with more than plain triangles: packed meshes, other pictures, sparse and quantised numbers.

use super::*;
use draco_core::{
    DataType, EncoderBuffer, EncoderOptions, FaceIndex, GeometryAttributeType, MeshEncoder, PointAttribute,
};
use serde_json::{Value, json};

/// 16 x 16 texels made with Binomial's encoder: red (200, 40, 30) at the top left, green (30, 180, 50) at the top right,
/// blue (20, 60, 210) at the bottom left, white (240) at the bottom right.
const ETC1S: &str = concat!(
    "c0ITAE0A3EWMAAAABuYBAAABAAAAEQAAAAAAAAAAAAAAAAAAAAAABABkAAAAMQAAAwCVAAAADQAAogAAAC8AAABNAAAAAAAAAAAA",
    "AAAAAAAAABAAEAAEAAQA0QAAAAgAAABR8h5AlAAAAAAAiAOiqAGYCAAAAAAAQAaAAFEDBgAAAEHVIBsfYABEAAgAAACAnIKj8eRU",
    "VVVVBQAAAKiqqqoCFMBEAAAAAAAAEoEAmAEAAAAAAEBCCRBHYAAAIBgYWjEY+wQXAEwAAAAAAAAggADU0xDCLdLYAg==",
);
/// The same picture as UASTC.
const UASTC: &str = concat!(
    "c0ITAE0AtXEXAQAAqTYBAAABAAABEAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAABNAAAAAAAAAAAA",
    "AAAAAAAAABAAEAAEAAQAZAAAAAABAACw4BcZxeN/0McAAAAAAAAAAAAXGcXjf9DHAAAAAAAAAAAA14NW5j8zGAEAAAAAAAAAANeD",
    "VuY/MxgBAAAAAAAAAAAXGcXjf9DHAAAAAAAAAAAAFxnF43/QxwAAAAAAAAAAANeDVuY/MxgBAAAAAAAAAADXg1bmPzMYAQAAAAAA",
    "AAAAl4JH+r8wqwMAAAAAAAAAAJeCR/q/MKsDAAAAAAAAAAAXHh7+H3TOAQAAAAAAAAAAFx4e/h90zgEAAAAAAAAAAJeCR/q/MKsD",
    "AAAAAAAAAACXgkf6vzCrAwAAAAAAAAAAFx4e/h90zgEAAAAAAAAAABceHv4fdM4BAAAAAAAAAAA=",
);

fn data_uri(bytes: &[u8]) -> String {
    let coded: String = bytes.chunks(3).map(base64_group).collect();
    format!("data:application/octet-stream;base64,{coded}")
}

fn unpacked(coded: &str) -> Vec<u8> {
    source::load(&format!("data:;base64,{coded}"), None, &mut 10_000).unwrap()
}

fn bytes_of<const N: usize>(values: &[[f32; N]]) -> Vec<u8> {
    values.iter().flatten().flat_map(|value| value.to_le_bytes()).collect()
}

/// The colours in the middle of a picture's quarters: top left, top right, bottom left, bottom right.
fn quarters(texture: &Texture) -> [[u8; 3]; 4] {
    [(1, 1), (3, 1), (1, 3), (3, 3)].map(|(column, row)| {
        let at = 4 * (row * texture.height / 4 * texture.width + column * texture.width / 4) as usize;
        [0, 1, 2].map(|channel| texture.pixels[at + channel])
    })
}

#[test]
fn basis_images_have_the_top_row_first() {
    let expected = [[200, 40, 30], [30, 180, 50], [20, 60, 210], [240, 240, 240]];
    for coded in [ETC1S, UASTC] {
        let mut file = unpacked(coded);
        for bottom_first in [false, true] {
            // Header flags; the checksum is updated.
            file[21] = if bottom_first { file[21] | 2 } else { file[21] & !2 };
            let header = checksum(&file[8..77]);
            file[6..8].copy_from_slice(&header.to_le_bytes());
            let texture = images::decode(&file, &mut 1000).unwrap();
            let mut found = quarters(&texture);
            if bottom_first {
                found = [found[2], found[3], found[0], found[1]];
            }
            let off =
                found.iter().flatten().zip(expected.iter().flatten()).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(off < Some(10), "{found:?}");
            assert!(images::decode(&file, &mut 100).unwrap_err().contains("resize"));
        }
    }
}

/// CRC-16 as `.basis` headers carry it.
fn checksum(bytes: &[u8]) -> u16 {
    !bytes.iter().fold(!0, |crc: u16, &byte| {
        let q = u16::from(byte) ^ (crc >> 8);
        let k = (q >> 4) ^ q;
        (((crc << 8) ^ k) ^ (k << 5)) ^ (k << 12)
    })
}

#[test]
fn damaged_basis_images_never_panic() {
    let mut rng = Rng::new(8);
    for coded in [ETC1S, UASTC] {
        let whole = unpacked(coded);
        let mut refused = 0;
        for round in 0..3000 {
            let mut bytes = whole.clone();
            for _ in 0..=rng.below(3) {
                let at = rng.below(bytes.len());
                bytes[at] ^= 1 << rng.below(8);
            }
            if round % 4 == 0 {
                bytes.truncate(2 + rng.below(whole.len() - 2));
            } else {
                let header = checksum(&bytes[8..77]);
                bytes[6..8].copy_from_slice(&header.to_le_bytes());
            }
            refused += u32::from(images::decode(&bytes, &mut 1_000_000).is_err());
        }
        assert!(refused > 700, "{refused}");
    }
}

#[test]
fn basis_slice_larger_than_its_picture_is_refused() {
    let mut file = unpacked(ETC1S);
    let table = u32::from_le_bytes(file[65..69].try_into().unwrap()) as usize;
    // 65,535 x 65,535 blocks: hours of work.
    file[table + 9..table + 13].fill(0xff);
    assert!(images::decode(&file, &mut 1000).unwrap_err().contains("contradict its size"));
}

/// The UASTC picture as a KTX2 file without further compression; `orientation` is `rd` or `ru`.
fn ktx2(orientation: &str) -> Vec<u8> {
    const HEADER_BYTES: u32 = 80;
    const LEVEL_INDEX_BYTES: u32 = 24;
    let blocks = unpacked(UASTC).split_off(77 + 23);
    let value = format!("KTXorientation\0{orientation}\0");
    let mut metadata = (value.len() as u32).to_le_bytes().to_vec();
    metadata.extend(value.bytes());
    metadata.resize(metadata.len().next_multiple_of(4), 0);
    // Basic data format descriptor: UASTC, BT.709, sRGB; blocks of 4 x 4 texels in 16 bytes; one sample.
    let descriptor: [u32; 11] =
        [44, 0, 40 << 16 | 2, 166 | 1 << 8 | 2 << 16, 3 | 3 << 8, 16, 0, 127 << 16, 0, 0, u32::MAX];
    let descriptor_at = HEADER_BYTES + LEVEL_INDEX_BYTES;
    let metadata_at = descriptor_at + 44;
    let level_at = (metadata_at + metadata.len() as u32).next_multiple_of(16);
    let mut file = b"\xabKTX 20\xbb\r\n\x1a\n".to_vec();
    let words =
        [0, 1, 16, 16, 0, 0, 1, 1, 0, descriptor_at, 44, metadata_at, metadata.len() as u32, 0, 0, 0, 0];
    file.extend(words.iter().flat_map(|word: &u32| word.to_le_bytes()));
    for number in [u64::from(level_at), blocks.len() as u64, blocks.len() as u64] {
        file.extend(number.to_le_bytes());
    }
    file.extend(descriptor.iter().flat_map(|word| word.to_le_bytes()));
    file.extend(metadata);
    file.resize(level_at as usize, 0);
    file.extend(blocks);
    file
}

#[test]
fn ktx2_orientation_is_respected() {
    let plain = images::decode(&unpacked(UASTC), &mut 1000).unwrap();
    assert_eq!(images::decode(&ktx2("rd"), &mut 1000).unwrap(), plain);
    let [top_left, top_right, bottom_left, bottom_right] = quarters(&plain);
    let turned = images::decode(&ktx2("ru"), &mut 1000).unwrap();
    assert_eq!(quarters(&turned), [bottom_left, bottom_right, top_left, top_right]);
    let mut rng = Rng::new(13);
    let mut refused = 0;
    for _ in 0..2000 {
        let mut bytes = ktx2("rd");
        let at = rng.below(160);
        bytes[at] ^= 1 << rng.below(8);
        bytes.truncate(bytes.len() - rng.below(2) * rng.below(bytes.len()));
        refused += u32::from(images::decode(&bytes, &mut 1_000_000).is_err());
    }
    assert!(refused > 700, "{refused}");
}

#[test]
fn ktx2_levels_beyond_their_picture_are_refused() {
    // Start, bytes and uncompressed bytes of the only level.
    for (at, value) in [(80, u64::MAX), (88, u64::MAX), (96, 1 << 50)] {
        let mut file = ktx2("rd");
        file[at..at + 8].copy_from_slice(&value.to_le_bytes());
        assert!(images::decode(&file, &mut 1000).unwrap_err().contains("contradict its size"));
    }
}

/// A grid of 3 x 3 m with texture coordinates and colours, packed with Draco, and its numbers of attributes.
fn packed_grid(speed: i32) -> Vec<u8> {
    const SIDE: usize = 4;
    let mut attributes = [(GeometryAttributeType::Position, 3), (GeometryAttributeType::TexCoord, 2)].map(
        |(kind, components)| {
            let mut attribute = PointAttribute::new();
            attribute.init(kind, components, DataType::Float32, false, SIDE * SIDE);
            attribute
        },
    );
    let mut colors = PointAttribute::new();
    colors.init(GeometryAttributeType::Color, 4, DataType::Uint8, true, SIDE * SIDE);
    for index in 0..SIDE * SIDE {
        let (x, z) = ((index % SIDE) as f32, (index / SIDE) as f32);
        attributes[0].buffer_mut().write(12 * index, &bytes_of(&[[x, 0.5, z]]));
        attributes[1].buffer_mut().write(8 * index, &bytes_of(&[[x / 3.0, z / 3.0]]));
        colors.buffer_mut().write(4 * index, &[255, 0, 255, 255]);
    }
    let mut mesh = draco_core::Mesh::new();
    let [positions, uvs] = attributes;
    for attribute in [positions, uvs, colors] {
        mesh.add_attribute(attribute);
    }
    mesh.set_num_faces(18);
    for cell in 0..9_u32 {
        let corner = cell / 3 * 4 + cell % 3;
        mesh.set_face(FaceIndex(2 * cell), [corner.into(), (corner + 4).into(), (corner + 1).into()]);
        mesh.set_face(
            FaceIndex(2 * cell + 1),
            [(corner + 1).into(), (corner + 4).into(), (corner + 5).into()],
        );
    }
    let mut options = EncoderOptions::new();
    options.set_global_int("encoding_speed", speed);
    options.set_global_int("decoding_speed", speed);
    options.set_attribute_int(0, "quantization_bits", 14);
    options.set_attribute_int(1, "quantization_bits", 12);
    let mut encoder = MeshEncoder::new();
    encoder.set_mesh(mesh);
    let mut buffer = EncoderBuffer::new();
    encoder.encode(&options, &mut buffer).unwrap();
    buffer.data().to_vec()
}

/// A document with one primitive that is packed in `bytes`.
fn packed_document(bytes: &[u8]) -> Value {
    json!({
        "extensionsRequired": ["KHR_draco_mesh_compression"],
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{
            "attributes": { "POSITION": 0, "TEXCOORD_0": 1, "COLOR_0": 2 },
            "extensions": { "KHR_draco_mesh_compression": {
                "bufferView": 0, "attributes": { "POSITION": 0, "TEXCOORD_0": 1, "COLOR_0": 2 },
            } },
        }] }],
        "accessors": [
            { "componentType": 5126, "count": 16, "type": "VEC3" },
            { "componentType": 5126, "count": 16, "type": "VEC2" },
            { "componentType": 5121, "count": 16, "type": "VEC4", "normalized": true },
        ],
        "bufferViews": [{ "buffer": 0, "byteLength": bytes.len() }],
        "buffers": [{ "byteLength": bytes.len(), "uri": data_uri(bytes) }],
    })
}

fn read(document: &Value) -> Result<Scene, SceneError> {
    from_bytes("made", "memory", document.to_string().as_bytes())
}

#[test]
fn draco_meshes_are_decoded_exactly() {
    for speed in [0, 5, 10] {
        let scene = read(&packed_document(&packed_grid(speed))).unwrap();
        assert_eq!((scene.mesh.triangles.len(), scene.mesh.positions.len()), (18, 16), "speed {speed}");
        let area: f32 = (0..18)
            .map(|triangle| {
                let [a, b, c] = scene.corners(triangle);
                (b - a).cross(&(c - a)).y / 2.0
            })
            .sum();
        assert!((area - 9.0).abs() < 1e-3, "all triangles face up: {area}");
        for (position, uv) in scene.mesh.positions.iter().zip(&scene.mesh.uvs) {
            let expected = Point2::new(position.x / 3.0, position.z / 3.0);
            assert!((uv - expected).norm() < 1e-3 && (position.y - 0.5).abs() < 1e-3, "{position} {uv}");
        }
        assert!(scene.mesh.colors.iter().all(|color| *color == [255, 0, 255]));
    }
}

#[test]
fn damaged_draco_meshes_never_panic() {
    let mut rng = Rng::new(21);
    let mut refused = 0;
    for speed in [0, 5, 10] {
        let whole = packed_grid(speed);
        for round in 0..1000 {
            let mut bytes = whole.clone();
            for _ in 0..=rng.below(3) {
                let at = rng.below(bytes.len());
                bytes[at] ^= 1 << rng.below(8);
            }
            if round % 4 == 0 {
                bytes.truncate(rng.below(whole.len()));
            }
            refused += u32::from(read(&packed_document(&bytes)).is_err());
        }
    }
    assert!(refused > 700, "{refused}");
}

#[test]
fn sparse_accessors_replace_single_elements() {
    let sparse = |indices: &[u8], values: &[[f32; 3]]| {
        let mut bytes = bytes_of(&TRIANGLE);
        let ends = [bytes.len(), bytes.len() + indices.len()];
        bytes.extend(indices);
        bytes.extend(bytes_of(values));
        json!({
            "nodes": [{ "mesh": 0 }],
            "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
            "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "sparse": {
                "count": indices.len(),
                "indices": { "bufferView": 1, "componentType": 5121 },
                "values": { "bufferView": 1, "byteOffset": indices.len() },
            } }],
            "bufferViews": [
                { "buffer": 0, "byteLength": ends[0] },
                { "buffer": 0, "byteOffset": ends[0], "byteLength": bytes.len() - ends[0] },
            ],
            "buffers": [{ "byteLength": bytes.len(), "uri": data_uri(&bytes) }],
        })
    };
    let document = sparse(&[2], &[[0.0, 7.0, 0.0]]);
    assert_eq!(read(&document).unwrap().corners(0)[2], Point3::new(0.0, 7.0, 0.0));
    // Without a buffer view, the rest is zero.
    let mut empty = sparse(&[1, 2], &[[5.0, 0.0, 0.0], [0.0, 7.0, 0.0]]);
    empty["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    assert_eq!(
        read(&empty).unwrap().corners(0),
        [Point3::origin(), Point3::new(5.0, 0.0, 0.0), Point3::new(0.0, 7.0, 0.0)]
    );
    let outside = sparse(&[3], &[[0.0, 7.0, 0.0]]);
    assert!(read(&outside).unwrap_err().to_string().contains("replaces element 3 of 3"));
    empty["accessors"][0]["count"] = 4_000_000_000_u64.into();
    assert!(read(&empty).unwrap_err().to_string().contains("without data"));
}

#[test]
fn quantised_positions_and_texture_transforms_are_applied() {
    // Positions as normalised i16 under a node that is 10 m large; texture coordinates as u8.
    let positions: Vec<u8> = [[0, 0, 0], [32_767, 0, 0], [0, 0, -32_767_i16]]
        .iter()
        .flatten()
        .flat_map(|value| value.to_le_bytes())
        .collect();
    let mut bytes = positions.clone();
    bytes.extend([0, 0, 255, 0, 0, 255]);
    let picture = images::encode_png(&texture(2, 2, 255));
    let document = json!({
        "extensionsRequired": ["KHR_mesh_quantization", "KHR_texture_transform"],
        "nodes": [{ "mesh": 0, "scale": [10, 10, 10] }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_1": 1 }, "material": 0 }] }],
        "materials": [{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0, "extensions": { "KHR_texture_transform": {
            "offset": [0.25, 0.5], "rotation": std::f64::consts::FRAC_PI_2, "scale": [2, 4], "texCoord": 1,
        } } } } }],
        "textures": [{ "source": 0 }],
        "images": [{ "uri": data_uri(&picture) }],
        "accessors": [
            { "bufferView": 0, "componentType": 5122, "count": 3, "type": "VEC3", "normalized": true },
            { "bufferView": 1, "componentType": 5121, "count": 3, "type": "VEC2", "normalized": true },
        ],
        "bufferViews": [
            { "buffer": 0, "byteLength": positions.len() },
            { "buffer": 0, "byteOffset": positions.len(), "byteLength": 6 },
        ],
        "buffers": [{ "byteLength": bytes.len(), "uri": data_uri(&bytes) }],
    });
    let scene = read(&document).unwrap();
    assert_eq!(
        scene.corners(0),
        [Point3::origin(), Point3::new(10.0, 0.0, 0.0), Point3::new(0.0, 0.0, -10.0)]
    );
    // (1, 0) is scaled to (2, 0), turned a quarter up to (0, -2) and moved; (0, 1) becomes (4, 0) and is moved.
    let expected = [[0.25, 0.5], [0.25, -1.5], [4.25, 0.5]];
    for (uv, expected) in scene.mesh.uvs.iter().zip(expected) {
        assert!((uv - Point2::from(expected)).norm() < 1e-5, "{uv} is not {expected:?}");
    }
}

#[test]
fn palette_and_16_bit_images_are_read() {
    let encode = |kind, depth, data: &[u8], palette: Option<&[u8]>| {
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, 2, 1);
        encoder.set_color(kind);
        encoder.set_depth(depth);
        if let Some(palette) = palette {
            encoder.set_palette(palette.to_vec());
            encoder.set_trns(vec![255, 40]);
        }
        encoder.write_header().unwrap().write_image_data(data).unwrap();
        images::decode(&file, &mut 10).unwrap().pixels
    };
    let palette =
        encode(png::ColorType::Indexed, png::BitDepth::One, &[0b0100_0000], Some(&[1, 2, 3, 9, 8, 7]));
    assert_eq!(palette, [1, 2, 3, 255, 9, 8, 7, 40]);
    let deep = encode(png::ColorType::Grayscale, png::BitDepth::Sixteen, &[200, 0, 7, 255], None);
    assert_eq!(deep, [200, 200, 200, 255, 7, 7, 7, 255]);
}

#[test]
fn missing_image_is_a_warning_and_checker() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room one.gltf");
    std::fs::write(folder.path().join("room one.bin"), bytes_of(&TRIANGLE)).unwrap();
    let document = json!({
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "material": 0 }] }],
        "materials": [{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }],
        "textures": [{ "source": 0 }],
        "images": [{ "uri": "gone/wood.jpg" }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3" }],
        "bufferViews": [{ "buffer": 0, "byteLength": 36 }],
        "buffers": [{ "byteLength": 36, "uri": "room%20one.bin" }],
    });
    std::fs::write(&path, document.to_string()).unwrap();
    let mut report = ImportReport::default();
    let scene = import(&path, &ImportOptions::default(), &mut report).unwrap();
    assert_eq!(scene.textures, [images::checker()]);
    assert!(report.warnings[0].contains("gone/wood.jpg"), "{:?}", report.warnings);
    std::fs::write(
        folder.path().join("room one.bin"),
        "version https://git-lfs.github.com/spec/v1\noid sha256:1\n",
    )
    .unwrap();
    let error =
        import(&path, &ImportOptions::default(), &mut ImportReport::default()).unwrap_err().to_string();
    assert!(error.contains("git lfs pull"), "{error}");
}

#[test]
fn excessive_mesh_reuse_is_refused_quickly() {
    let nodes: Vec<Value> = (0..2000).map(|_| json!({ "mesh": 0 })).collect();
    let lines: Vec<Value> = (0..2000).map(|_| json!({ "mode": 1, "attributes": {} })).collect();
    let document = json!({ "nodes": nodes, "meshes": [{ "primitives": lines }] });
    assert!(read(&document).unwrap_err().to_string().contains("primitives"));
    // A chain of nodes as long as lists may be is no trouble.
    let chain: Vec<Value> =
        (0..100_000).map(|index| json!({ "children": [index + 1] })).chain([json!({})]).collect();
    let error = read(&json!({ "nodes": chain })).unwrap_err().to_string();
    assert!(error.contains("no triangles"), "{error}");
}
