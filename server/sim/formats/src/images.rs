//! Images: PNG, JPEG and Basis Universal (`.basis` files, as in HM3D, and KTX2 files) in, PNG out. Without the feature
//! `compressed`, Basis Universal is refused.

use crate::files::{self, Checked, ImportReport, neighbour, refuse_if};
use avln_scene::Texture;
use avln_scene::limits::{MAX_FILE_BYTES, MAX_TEXTURE_SIDE};
use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::PathBuf;
#[cfg(feature = "compressed")]
use transcoder::decode_basis;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

const PNG_MAGIC: &[u8] = b"\x89PNG\r\n\x1a\n";
const JPEG_MAGIC: &[u8] = &[0xff, 0xd8, 0xff];
const SUPPORTED: &str = "PNG, JPEG, KTX2 and .basis pictures are read: convert the textures";

/// Decodes an image without colour conversion; subtracts the texels from `budget`.
pub(crate) fn decode(bytes: &[u8], budget: &mut u64) -> Checked<Texture> {
    if bytes.starts_with(PNG_MAGIC) {
        decode_png(bytes, budget)
    } else if bytes.starts_with(JPEG_MAGIC) {
        decode_jpeg(bytes, budget)
    } else if is_basis(bytes) {
        decode_basis(bytes, |width, height| check_size(width, height, budget))
    } else {
        Err(format!("it is {}; {SUPPORTED}", kind_of(bytes)))
    }
}

/// Apparent format for an unsupported image.
fn kind_of(bytes: &[u8]) -> &'static str {
    match bytes {
        [0xab, b'K', b'T', b'X', ..] => "a KTX texture of version 1",
        [b'R', b'I', b'F', b'F', ..] => "a WebP texture",
        [b'D', b'D', b'S', b' ', ..] => "a DDS texture",
        _ => "in an unknown format",
    }
}

fn check_size(width: usize, height: usize, budget: &mut u64) -> Checked<()> {
    let side = MAX_TEXTURE_SIDE as usize;
    refuse_if(width > side || height > side || width == 0 || height == 0, || {
        format!("it has {width} x {height} texels, sides of 1 to {side} are read; resize it")
    })?;
    *budget = budget
        .checked_sub(width as u64 * height as u64)
        .ok_or("with it, the textures exceed the texel limit; resize them")?;
    Ok(())
}

fn decode_png(bytes: &[u8], budget: &mut u64) -> Checked<Texture> {
    let fail = |error: png::DecodingError| format!("it is a damaged PNG ({error}); export it again");
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    decoder.set_ignore_text_chunk(true);
    let header = decoder.read_header_info().map_err(fail)?;
    let (width, height) = (header.width, header.height);
    // A small file can announce a huge image: sizes are checked before any pixel is decoded.
    check_size(width as usize, height as usize, budget)?;
    decoder.set_limits(png::Limits { bytes: 16 * width as usize * height as usize + (1 << 20) });
    let mut reader = decoder.read_info().map_err(fail)?;
    let mut raw = vec![0; reader.output_buffer_size().ok_or("it is too large")?];
    let info = reader.next_frame(&mut raw).map_err(fail)?;
    raw.truncate(info.buffer_size());
    texture(width, height, &raw, info.color_type.samples())
}

fn decode_jpeg(bytes: &[u8], budget: &mut u64) -> Checked<Texture> {
    let fail =
        |error: zune_jpeg::errors::DecodeErrors| format!("it is a damaged JPEG ({error:?}); export it again");
    // Portable arithmetic: the same texels on every processor.
    let options = DecoderOptions::default()
        .set_use_unsafe(false)
        .set_max_width(MAX_TEXTURE_SIDE as usize)
        .set_max_height(MAX_TEXTURE_SIDE as usize)
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(fail)?;
    let header = decoder.info().ok_or("it is a damaged JPEG without a header; export it again")?;
    check_size(usize::from(header.width), usize::from(header.height), budget)?;
    let raw = decoder.decode().map_err(fail)?;
    let texels = usize::from(header.width) * usize::from(header.height);
    texture(u32::from(header.width), u32::from(header.height), &raw, raw.len() / texels)
}

/// Makes a texture from grey, grey-alpha, RGB or RGBA bytes.
fn texture(width: u32, height: u32, raw: &[u8], samples: usize) -> Checked<Texture> {
    let texels = width as usize * height as usize;
    refuse_if(!(1..=4).contains(&samples) || raw.len() != texels * samples, || {
        "its pixels do not fill its size; export it again".into()
    })?;
    let rgba = |texel: &[u8]| match *texel {
        [grey] => [grey, grey, grey, 255],
        [grey, alpha] => [grey, grey, grey, alpha],
        [r, g, b] => [r, g, b, 255],
        _ => [texel[0], texel[1], texel[2], texel[3]],
    };
    let pixels = raw.chunks_exact(samples).flat_map(rgba).collect();
    Ok(Texture { width, height, pixels })
}

/// Returns the placeholder for a missing image: a magenta and black checker.
pub(crate) fn checker() -> Texture {
    const SIDE: u32 = 16;
    let is_lit = |texel: u32| (texel / SIDE / 4 + texel % SIDE / 4).is_multiple_of(2);
    let pixels =
        (0..SIDE * SIDE).flat_map(|texel| if is_lit(texel) { [255, 0, 255, 255] } else { [0, 0, 0, 255] });
    Texture { width: SIDE, height: SIDE, pixels: pixels.collect() }
}

pub(crate) fn encode_png(texture: &Texture) -> Vec<u8> {
    let opaque = texture.pixels.chunks_exact(4).all(|texel| texel[3] == 255);
    let data: Vec<u8> = if opaque {
        texture.pixels.chunks_exact(4).flat_map(|texel| [texel[0], texel[1], texel[2]]).collect()
    } else {
        texture.pixels.clone()
    };
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, texture.width, texture.height);
    encoder.set_color(if opaque { png::ColorType::Rgb } else { png::ColorType::Rgba });
    encoder.set_compression(png::Compression::Fast);
    let written = encoder.write_header().and_then(|mut writer| {
        writer.write_image_data(&data)?;
        writer.finish()
    });
    written.expect("a texture has a size and the pixels for it");
    file
}

/// A scene's images in order by first use, without duplicates.
pub(crate) struct ImageSet {
    folder: PathBuf,
    /// In number order.
    pub(crate) textures: Vec<Texture>,
    number_of: BTreeMap<String, u16>,
    texels_left: u64,
}

impl ImageSet {
    /// Creates an empty set for files in `folder` or below, with at most `texels` texels in total.
    pub(crate) fn new(folder: impl Into<PathBuf>, texels: u64) -> Self {
        Self { folder: folder.into(), textures: Vec::new(), number_of: BTreeMap::new(), texels_left: texels }
    }

    /// Returns an image's number. An unreadable image is replaced by a checker, with a warning.
    pub(crate) fn number(&mut self, name: &str, report: &mut ImportReport) -> Checked<u16> {
        if let Some(&known) = self.number_of.get(name) {
            return Ok(known);
        }
        // A missing image must not stop an import: scans are often shared without their textures. The checker makes it visible.
        let texture = self.load(name, report).unwrap_or_else(|reason| {
            report.warn(format!("texture {name:?} is replaced by a checker: {reason}"));
            checker()
        });
        let number = u16::try_from(self.textures.len())
            .map_err(|_| "it uses more than 65536 textures; merge some of them")?;
        self.textures.push(texture);
        self.number_of.insert(name.to_owned(), number);
        Ok(number)
    }

    fn load(&mut self, name: &str, report: &mut ImportReport) -> Checked<Texture> {
        let path = neighbour(&self.folder, &name.replace('\\', "/"))?;
        let bytes = files::read(&path, MAX_FILE_BYTES, report).map_err(|error| error.to_string())?;
        decode(&bytes, &mut self.texels_left)
    }
}

const KTX2_MAGIC: &[u8] = b"\xabKTX 20\xbb\r\n\x1a\n";
const BASIS_MAGIC: &[u8] = b"sB";

fn is_basis(bytes: &[u8]) -> bool {
    bytes.starts_with(BASIS_MAGIC) || bytes.starts_with(KTX2_MAGIC)
}

#[cfg(not(feature = "compressed"))]
fn decode_basis(_: &[u8], _: impl FnOnce(usize, usize) -> Checked<()>) -> Checked<Texture> {
    Err("it is a Basis Universal texture, which this build cannot decode; build with the feature `compressed`".into())
}

#[cfg(feature = "compressed")]
mod transcoder {
    use super::*;
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
    pub(super) fn decode_basis(
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn png_keeps_every_texel() {
        for alpha in [255, 40] {
            let pixels = (0..3 * 2).flat_map(|texel| [texel * 40, 255 - texel, texel, alpha]).collect();
            let texture = Texture { width: 3, height: 2, pixels };
            assert_eq!(decode(&encode_png(&texture), &mut 100).unwrap(), texture);
        }
    }

    #[test]
    fn images_beyond_the_budget_are_refused_undecoded() {
        let texture = Texture { width: 3, height: 2, pixels: vec![7; 24] };
        assert!(decode(&encode_png(&texture), &mut 5).unwrap_err().contains("resize"));
    }

    #[test]
    fn other_formats_are_refused_by_name() {
        for (bytes, name) in [
            (&b"RIFF1234WEBP"[..], "WebP"),
            (b"DDS rest", "DDS"),
            (b"\xabKTX 11\xbb", "KTX"),
            (b"", "unknown"),
        ] {
            let error = decode(bytes, &mut 100).unwrap_err();
            assert!(error.contains(name) && error.contains("convert"), "{error}");
        }
        let error = decode(b"sB\x13\0rest", &mut 100).unwrap_err();
        assert!(error.contains("Basis") && error.contains("convert"), "{error}");
    }

    #[test]
    fn missing_images_are_checkers_with_one_warning() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("bad.png"), "no picture").unwrap();
        let mut pictures = ImageSet::new(folder.path(), 1 << 20);
        let mut report = ImportReport::default();
        let numbers = ["absent.png", "bad.png", "absent.png", "../outside.png"]
            .map(|name| pictures.number(name, &mut report).unwrap());
        assert_eq!(numbers, [0, 1, 0, 2]);
        assert_eq!(report.warnings.len(), 3, "{report:?}");
        assert!(report.warnings[0].contains("\"absent.png\"") && report.warnings[0].contains("checker"));
        assert_eq!(pictures.textures[0], checker());
    }
}
