//! PNG files of 8-bit RGB, as fast as they can be made.

use crate::{CodecError, Size};
use avln_proto::v1::Encoding;
use png::{BitDepth, ColorType, Compression, Decoder, Encoder, Limits};
use std::io::Cursor;

pub(crate) fn encode(size: Size, pixels: &[u8]) -> Result<Vec<u8>, CodecError> {
    let broken = |error: png::EncodingError| CodecError::broken(Encoding::Png, error);
    let mut file = Vec::with_capacity(pixels.len() / 2);
    let mut encoder = Encoder::new(&mut file, size.width, size.height);
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_compression(Compression::Fast);
    let mut writer = encoder.write_header().map_err(broken)?;
    writer.write_image_data(pixels).map_err(broken)?;
    writer.finish().map_err(broken)?;
    Ok(file)
}

/// Memory of the decoder beside the picture itself: rows and dictionaries.
const WORKING_BYTES: usize = 1 << 20;

pub(crate) fn decode(size: Size, bytes: &[u8]) -> Result<Vec<u8>, CodecError> {
    let broken = |error: png::DecodingError| CodecError::broken(Encoding::Png, error);
    let expected = 3 * size.pixels();
    let limits = Limits { bytes: expected + WORKING_BYTES };
    let mut decoder = Decoder::new_with_limits(Cursor::new(bytes), limits);
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let header = decoder.read_header_info().map_err(broken)?;
    let fits = (header.width, header.height) == (size.width, size.height)
        && (header.color_type, header.bit_depth) == (ColorType::Rgb, BitDepth::Eight);
    if !fits {
        let detail = format!(
            "it is {} x {} {:?} of {:?} bits, agreed were {} x {} Rgb of Eight",
            header.width, header.height, header.color_type, header.bit_depth, size.width, size.height
        );
        return Err(CodecError::broken(Encoding::Png, detail));
    }
    let mut reader = decoder.read_info().map_err(broken)?;
    let mut pixels = vec![0; expected];
    reader.next_frame(&mut pixels).map_err(broken)?;
    Ok(pixels)
}
