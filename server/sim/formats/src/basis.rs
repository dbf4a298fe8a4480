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

    /// Flag offset in a `.basis` header, and the flag for bottom row first.
    const BASIS_FLAGS_AT: usize = 21;
    const BASIS_BOTTOM_FIRST: u8 = 2;
    /// KTX2 metadata key for the orientation; the value's second letter is `u` for bottom row first.
    const ORIENTATION: &[u8] = b"KTXorientation\0";
    /// Bytes at a KTX2 file's start with the metadata.
    const METADATA_BYTES: usize = 1 << 16;

    /// Decodes the largest level, top row first, after `check_size` has accepted width and height.
    pub(crate) fn decode_basis(
        bytes: &[u8],
        check_size: impl FnOnce(usize, usize) -> Checked<()>,
    ) -> Checked<Texture> {
        let fail = |error: basisu::Error| {
            format!(
                "it is a Basis Universal texture that cannot be decoded ({error:?}); convert it to PNG or JPEG"
            )
        };
        let picture = Transcoder::new(bytes).map_err(fail)?;
        let (width, height) = picture.base_dimensions();
        check_size(width as usize, height as usize)?;
        let mut pixels = picture.transcode(0, TargetFormat::Rgba32, DecodeFlags::NONE).map_err(fail)?;
        let row_bytes = 4 * width as usize;
        refuse_if(pixels.len() != row_bytes * height as usize, || {
            "its pixels do not fill its size; export it again".into()
        })?;
        if begins_at_the_bottom(bytes) {
            pixels = pixels.chunks_exact(row_bytes).rev().flatten().copied().collect();
        }
        Ok(Texture { width, height, pixels })
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
