//! Basis Universal images: `.basis` files, as in HM3D, and KTX2 files. Without the feature `compressed`, they are refused.

use crate::files::Checked;
use avln_scene::Texture;

#[cfg(feature = "compressed")]
pub(crate) use transcoder::decode_basis;

const KTX2_MAGIC: &[u8] = b"\xabKTX 20\xbb\r\n\x1a\n";
const BASIS_MAGIC: &[u8] = b"sB";

pub(crate) fn is_basis(bytes: &[u8]) -> bool {
    bytes.starts_with(BASIS_MAGIC) || bytes.starts_with(KTX2_MAGIC)
}

#[cfg(not(feature = "compressed"))]
pub(crate) fn decode_basis(_: &[u8], _: impl FnOnce(usize, usize) -> Checked<()>) -> Checked<Texture> {
    Err("it is a Basis Universal texture, which this build cannot decode; build with the feature `compressed`".into())
}

#[cfg(feature = "compressed")]
mod transcoder {
    use super::*;
    use crate::files::refuse_if;
    use basisu::{DecodeFlags, TargetFormat, Transcoder};
    use std::{ops::Range, panic::catch_unwind};

    /// Flag offset in a `.basis` header, and the flag for bottom row first.
    const BASIS_FLAGS_AT: usize = 21;
    const BASIS_BOTTOM_FIRST: u8 = 2;
    /// KTX2 metadata key for the orientation; the value's second letter is `u` for bottom row first.
    const ORIENTATION: &[u8] = b"KTXorientation\0";
    /// Bytes at a KTX2 file's start with the metadata.
    const METADATA_BYTES: usize = 1 << 16;

    /// `.basis` header: number of slices, start of the slice table.
    const BASIS_SLICES_AT: Range<usize> = 14..17;
    const BASIS_TABLE_AT: Range<usize> = 65..69;
    /// Slice in the table: bytes, and fields for a side of the picture with its number of blocks.
    const BASIS_SLICE_BYTES: usize = 23;
    const BASIS_WIDTH: [Range<usize>; 2] = [5..7, 9..11];
    const BASIS_HEIGHT: [Range<usize>; 2] = [7..9, 11..13];
    /// KTX2 header: layers and faces, which are 1 or 0 in a picture; start, bytes and uncompressed bytes of the largest level.
    const KTX2_LAYERS_AT: Range<usize> = 32..36;
    const KTX2_FACES_AT: Range<usize> = 36..40;
    const KTX2_LEVEL_AT: [Range<usize>; 3] = [80..88, 88..96, 96..104];
    /// Side of the smallest block, texels, and the bytes of a block.
    const BLOCK_SIDE: u64 = 4;
    const BLOCK_BYTES: u64 = 16;

    /// Decodes the largest level, top row first, after `check_size` has accepted width and height.
    pub(crate) fn decode_basis(
        bytes: &[u8],
        check_size: impl FnOnce(usize, usize) -> Checked<()>,
    ) -> Checked<Texture> {
        let fail = |reason: String| {
            format!(
                "it is a Basis Universal texture that cannot be decoded ({reason}); convert it to PNG or JPEG"
            )
        };
        let (width, height) =
            guarded(|| Transcoder::new(bytes).map(|picture| picture.base_dimensions())).map_err(fail)?;
        check_size(width as usize, height as usize)?;
        refuse_if(!has_plausible_tables(bytes, u64::from(width), u64::from(height)), || {
            fail("its tables contradict its size".into())
        })?;
        let transcode = || Transcoder::new(bytes)?.transcode(0, TargetFormat::Rgba32, DecodeFlags::NONE);
        let mut pixels = guarded(transcode).map_err(fail)?;
        let row_bytes = 4 * width as usize;
        refuse_if(pixels.len() != row_bytes * height as usize, || {
            "its pixels do not fill its size; export it again".into()
        })?;
        if begins_at_the_bottom(bytes) {
            pixels = pixels.chunks_exact(row_bytes).rev().flatten().copied().collect();
        }
        Ok(Texture { width, height, pixels })
    }

    /// Calls the decoder, which panics on some damaged files.
    fn guarded<T>(
        decode: impl FnOnce() -> Result<T, basisu::Error> + std::panic::UnwindSafe,
    ) -> Result<T, String> {
        match catch_unwind(decode) {
            Ok(decoded) => decoded.map_err(|error| format!("{error:?}")),
            Err(_) => Err("the decoder failed".into()),
        }
    }

    /// Checks the tables that decide how much the decoder allocates and computes: a few bytes could demand hours.
    fn has_plausible_tables(bytes: &[u8], width: u64, height: u64) -> bool {
        let plausible = if bytes.starts_with(BASIS_MAGIC) {
            has_plausible_slices(bytes, width, height)
        } else {
            has_plausible_level(bytes, width, height)
        };
        plausible.unwrap_or(false)
    }

    fn has_plausible_slices(bytes: &[u8], width: u64, height: u64) -> Option<bool> {
        let first = number(bytes, 0, BASIS_TABLE_AT)? as usize;
        for slice in 0..number(bytes, 0, BASIS_SLICES_AT)? as usize {
            let at = first.checked_add(slice.checked_mul(BASIS_SLICE_BYTES)?)?;
            for ([side_at, blocks_at], limit) in [(BASIS_WIDTH, width), (BASIS_HEIGHT, height)] {
                let side = number(bytes, at, side_at)?;
                if side > limit || number(bytes, at, blocks_at)? > side.div_ceil(BLOCK_SIDE) {
                    return Some(false);
                }
            }
        }
        Some(true)
    }

    fn has_plausible_level(bytes: &[u8], width: u64, height: u64) -> Option<bool> {
        let [start, stored, unpacked] = KTX2_LEVEL_AT.map(|at| number(bytes, 0, at));
        let is_picture = number(bytes, 0, KTX2_LAYERS_AT)? <= 1 && number(bytes, 0, KTX2_FACES_AT)? <= 1;
        let limit = width.div_ceil(BLOCK_SIDE) * height.div_ceil(BLOCK_SIDE) * BLOCK_BYTES;
        Some(is_picture && start?.checked_add(stored?)? <= bytes.len() as u64 && unpacked? <= limit)
    }

    /// Returns a little-endian number of at most eight bytes; `None` beyond the end.
    fn number(bytes: &[u8], start: usize, at: Range<usize>) -> Option<u64> {
        let field = bytes.get(start.checked_add(at.start)?..start.checked_add(at.end)?)?;
        Some(field.iter().rev().fold(0, |number, &byte| number << 8 | u64::from(byte)))
    }

    fn begins_at_the_bottom(bytes: &[u8]) -> bool {
        if bytes.starts_with(BASIS_MAGIC) {
            return bytes.get(BASIS_FLAGS_AT).is_some_and(|flags| flags & BASIS_BOTTOM_FIRST != 0);
        }
        let metadata = &bytes[..bytes.len().min(METADATA_BYTES)];
        let at = metadata.windows(ORIENTATION.len()).position(|window| window == ORIENTATION);
        at.is_some_and(|at| metadata.get(at + ORIENTATION.len() + 1) == Some(&b'u'))
    }
}
