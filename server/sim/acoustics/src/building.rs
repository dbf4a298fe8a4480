//! A building prepared for sound, and the simulation settings; a persistent cache for source data in a binary format:
//! little-endian number lists with length prefixes.

use crate::air::Air;
use crate::head::Head;
use crate::late::cells::Cells;
use crate::planes::Planes;
use crate::surfaces::Surfaces;
use crate::{SAMPLE_RATE_HZ, SPEED_OF_SOUND_M_S};
use avln_geom::{RayMesh, Vector3};
use avln_scene::Scene;
use std::sync::Arc;

/// Simulation scope and resolution. Equal settings give equal bits.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Impulse response length, seconds; later sound is dropped.
    pub response_s: f32,
    /// Rays per source for late energy.
    pub ray_count: usize,
    /// Highest order of discrete reflections, 0 to 3; all others are late energy.
    pub reflection_order: usize,
    /// Head model; [`Source::with_head`](crate::Source::with_head) replaces it.
    pub head: Head,
}

impl Default for Settings {
    fn default() -> Self {
        Self { response_s: 1.0, ray_count: 8192, reflection_order: 2, head: Head::Sphere }
    }
}

impl Settings {
    pub(crate) fn response_samples(&self) -> usize {
        (self.response_s.max(0.0) * SAMPLE_RATE_HZ as f32) as usize
    }

    /// Cache name for the source at a position (as bits) in the building named `building`.
    pub(crate) fn source_name(&self, building: &str, [x, y, z]: [u32; 3]) -> String {
        let (samples, rays, order) = (self.response_samples(), self.ray_count, self.reflection_order);
        format!("{building}-{x:08x}{y:08x}{z:08x}-{samples}-{rays}-{order}-{VERSION}")
    }

    /// Longest path within a response, metres.
    pub(crate) fn reach_m(&self) -> f32 {
        self.response_s.max(0.0) * SPEED_OF_SOUND_M_S
    }
}

#[derive(Clone)]
pub(crate) struct Building {
    pub(crate) air: Arc<Air>,
    pub(crate) planes: Arc<Planes>,
    pub(crate) surfaces: Arc<Surfaces>,
    pub(crate) settings: Settings,
    /// Per triangle: unit normal; 0 for degenerate triangles.
    pub(crate) normals: Arc<[Vector3<f32>]>,
    pub(crate) cells: Arc<Cells>,
}

impl Building {
    pub(crate) fn new(scene: &Scene, rays: Arc<RayMesh>, surfaces: Surfaces, settings: Settings) -> Self {
        let air = Air::new(scene, rays);
        let cells = Cells::new(&air, settings.response_s);
        let normal = |triangle: usize| {
            let [a, b, c] = scene.corners(triangle);
            (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_default()
        };
        let normals = (0..scene.mesh.triangles.len()).map(normal).collect();
        Self {
            air: Arc::new(air),
            planes: Arc::new(Planes::new(scene)),
            surfaces: Arc::new(surfaces),
            settings,
            normals,
            cells: Arc::new(cells),
        }
    }

    /// Returns the same building with settings for levels.
    pub(crate) fn for_levels(&self) -> Self {
        let head = self.settings.head.clone();
        let settings = Settings { response_s: 0.5, ray_count: 1024, reflection_order: 0, head };
        Self { settings, cells: Arc::new(self.cells.larger(&self.air)), ..self.clone() }
    }

    pub(crate) fn byte_count(&self) -> usize {
        self.air.byte_count()
            + self.planes.byte_count()
            + self.cells.byte_count()
            + size_of_val(&*self.normals)
    }
}

/// A persistent cache for source data between program runs.
pub trait SoundCache: Send + Sync {
    /// Returns the bytes stored as `name`, if present and intact.
    fn load_sound(&self, name: &str) -> Option<Vec<u8>>;
    /// Stores bytes; failures are ignored.
    fn store_sound(&self, name: &str, bytes: &[u8]);
}

/// A building's part in a cache.
#[derive(Clone)]
pub struct BuildingCache {
    /// The cache.
    pub cache: Arc<dyn SoundCache>,
    /// Building name, unique per content and surfaces.
    pub name: String,
}

// Increment whenever equal positions in equal buildings would give different bytes.
pub(crate) const VERSION: u32 = 5;

#[derive(Default)]
pub(crate) struct Writer {
    pub(crate) bytes: Vec<u8>,
}

impl Writer {
    pub(crate) fn words(&mut self, words: &[u32]) {
        self.length(words.len());
        words.iter().for_each(|word| self.bytes.extend(word.to_le_bytes()));
    }

    pub(crate) fn halves(&mut self, halves: &[u16]) {
        self.length(halves.len());
        halves.iter().for_each(|half| self.bytes.extend(half.to_le_bytes()));
    }

    fn length(&mut self, length: usize) {
        self.bytes.extend((length as u32).to_le_bytes());
    }
}

/// A list reader; `None` if the bytes end too early.
pub(crate) struct Reader<'a> {
    bytes: &'a [u8],
}

impl<'a> Reader<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes }
    }

    pub(crate) fn words(&mut self) -> Option<Vec<u32>> {
        let words = self.list(4)?.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word));
        Some(words.collect())
    }

    pub(crate) fn halves(&mut self) -> Option<Vec<u16>> {
        let halves = self.list(2)?.as_chunks().0.iter().map(|half| u16::from_le_bytes(*half));
        Some(halves.collect())
    }

    pub(crate) fn is_at_end(&self) -> bool {
        self.bytes.is_empty()
    }

    fn list(&mut self, size: usize) -> Option<&'a [u8]> {
        let (length, rest) = self.bytes.split_first_chunk()?;
        let (list, rest) =
            rest.split_at_checked((u32::from_le_bytes(*length) as usize).checked_mul(size)?)?;
        self.bytes = rest;
        Some(list)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_round_trip_and_truncated_bytes_fail() {
        let mut writer = Writer::default();
        writer.words(&[7, u32::MAX]);
        writer.halves(&[]);
        writer.halves(&[3, 65_535, 1]);
        let mut reader = Reader::new(&writer.bytes);
        assert_eq!(reader.words().as_deref(), Some(&[7, u32::MAX][..]));
        assert_eq!(reader.halves().as_deref(), Some(&[][..]));
        assert!(!reader.is_at_end());
        assert_eq!(reader.halves().as_deref(), Some(&[3, 65_535, 1][..]));
        assert!(reader.is_at_end() && reader.words().is_none());
        for end in 0..12 {
            assert!(Reader::new(&writer.bytes[..end]).words().is_none());
        }
    }
}
