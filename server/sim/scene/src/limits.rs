//! How much a file may ask for, so that an absurd one is refused before memory is spent on it.

/// Bytes of one scene file, and of all files it names together.
pub const MAX_FILE_BYTES: u64 = 2 << 30;
/// Bytes of the JSON part.
pub const MAX_JSON_BYTES: usize = 64 << 20;
/// Entries of one JSON list (nodes, accessors, materials …).
pub const MAX_ENTRIES: usize = 1 << 18;
/// Triangles of a scene.
pub const MAX_TRIANGLES: usize = 8_000_000;
/// Vertices of a scene; a vertex that several primitives share counts once for each.
pub const MAX_VERTICES: usize = 3 * MAX_TRIANGLES;
/// Texels along one side of a texture.
pub const MAX_TEXTURE_SIDE: u32 = 16_384;
/// Texels of all textures together.
pub const MAX_TEXELS: u64 = 1 << 29;
/// A building is at least this long in its longest direction, metres.
pub const MIN_SCENE_SIDE_M: f32 = 1.0;
/// A building is at most this long in its longest direction, metres.
pub const MAX_SCENE_SIDE_M: f32 = 300.0;
/// Characters of a category or attribute.
pub const MAX_WORD_CHARS: usize = 100;
