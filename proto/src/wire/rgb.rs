//! Colour: `height × width × 3` bytes, RGB, top row first.
//!
//! `PACKED` consists of three planes: green, red minus green, and blue minus green, modulo 256. It stores the signed byte
//! difference to the pixel above, or to 0 in the first row, folded (0, -1, 1, -2 … to 0, 1, 2, 3 …) and packed in blocks.

use super::{CodecError, Encoding, SensorKind, Size, blocks, not_offered, qoi};
use bytes::Bytes;
use png::{BitDepth, ColorType, Compression, Decoder, Encoder, Limits};
use std::io::Cursor;

const CHANNELS: usize = 3;
// The PNG decoder also needs rows and dictionaries; a foreign file must not cost more.
const WORKING_BYTES: usize = 1 << 20;

/// Encodes a colour image.
///
/// # Errors
/// If the byte count does not match `size`, or colour has no such encoding.
pub fn encode(encoding: Encoding, size: Size, pixels: &[u8]) -> Result<Bytes, CodecError> {
    CodecError::check_length("colour image", "bytes", pixels.len(), CHANNELS * size.pixels())?;
    match encoding {
        Encoding::Raw => Ok(Bytes::copy_from_slice(pixels)),
        Encoding::Packed => Ok(pack(size, pixels).into()),
        Encoding::Png => encode_png(size, pixels).map(Bytes::from),
        Encoding::Qoi => Ok(qoi::encode(size, pixels).into()),
        other => not_offered(SensorKind::Rgb, other),
    }
}

/// Decodes a colour image.
///
/// # Errors
/// If `bytes` are not an image in this size and encoding.
pub fn decode(encoding: Encoding, size: Size, bytes: Bytes) -> Result<Vec<u8>, CodecError> {
    match encoding {
        Encoding::Raw => {
            CodecError::check_length("colour image", "bytes", bytes.len(), CHANNELS * size.pixels())?;
            Ok(bytes.into())
        }
        Encoding::Packed => unpack(size, &bytes),
        Encoding::Png => decode_png(size, &bytes),
        Encoding::Qoi => qoi::decode(size, &bytes),
        other => not_offered(SensorKind::Rgb, other),
    }
}

fn pack(size: Size, pixels: &[u8]) -> Vec<u8> {
    let (width, count) = (size.width as usize, size.pixels());
    let mut planes = vec![0; CHANNELS * count];
    let (green, differences) = planes.split_at_mut(count);
    let (red, blue) = differences.split_at_mut(count);
    for ((pixel, green), (red, blue)) in pixels.as_chunks().0.iter().zip(green).zip(red.iter_mut().zip(blue))
    {
        let [r, g, b] = *pixel;
        (*green, *red, *blue) = (g, r.wrapping_sub(g), b.wrapping_sub(g));
    }
    let mut residuals = planes.clone();
    for (plane, residuals) in planes.chunks(count.max(1)).zip(residuals.chunks_mut(count.max(1))) {
        let below = residuals.get_mut(width..).unwrap_or_default();
        below.iter_mut().zip(plane).for_each(|(own, above)| *own = own.wrapping_sub(*above));
    }
    residuals.iter_mut().for_each(|residual| *residual = fold(*residual));
    blocks::pack(&residuals)
}

fn unpack(size: Size, bytes: &[u8]) -> Result<Vec<u8>, CodecError> {
    let (width, count) = (size.width as usize, size.pixels());
    let planes = blocks::unpack(bytes, CHANNELS * count, u8::BITS, |number| unfold(number as u8));
    let mut planes = planes.map_err(|fault| CodecError::broken(Encoding::Packed, fault))?;
    for plane in planes.chunks_mut(count.max(1)) {
        for row in 1..size.height as usize {
            let (above, own) = plane[(row - 1) * width..(row + 1) * width].split_at_mut(width);
            own.iter_mut().zip(above).for_each(|(own, above)| *own = own.wrapping_add(*above));
        }
    }
    let mut pixels = vec![0; planes.len()];
    let (green, differences) = planes.split_at(count);
    let (red, blue) = differences.split_at(count);
    for ((pixel, g), (r, b)) in pixels.as_chunks_mut().0.iter_mut().zip(green).zip(red.iter().zip(blue)) {
        *pixel = [r.wrapping_add(*g), *g, b.wrapping_add(*g)];
    }
    Ok(pixels)
}

fn fold(difference: u8) -> u8 {
    (difference << 1) ^ (difference as i8 >> 7) as u8
}

fn unfold(number: u8) -> u8 {
    (number >> 1) ^ (number & 1).wrapping_neg()
}

fn encode_png(size: Size, pixels: &[u8]) -> Result<Vec<u8>, CodecError> {
    let broken = |error: png::EncodingError| CodecError::broken(Encoding::Png, error);
    let mut file = Vec::with_capacity(pixels.len() / 2);
    let mut encoder = Encoder::new(&mut file, size.width, size.height);
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    // The server encodes an image per step, so time matters more than size.
    encoder.set_compression(Compression::Fast);
    let mut writer = encoder.write_header().map_err(broken)?;
    writer.write_image_data(pixels).map_err(broken)?;
    writer.finish().map_err(broken)?;
    Ok(file)
}

fn decode_png(size: Size, bytes: &[u8]) -> Result<Vec<u8>, CodecError> {
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
            "expected {} x {} Rgb with Eight bits, got {} x {} {:?} with {:?} bits",
            size.width, size.height, header.width, header.height, header.color_type, header.bit_depth
        );
        return Err(CodecError::broken(Encoding::Png, detail));
    }
    let mut reader = decoder.read_info().map_err(broken)?;
    let mut pixels = vec![0; expected];
    reader.next_frame(&mut pixels).map_err(broken)?;
    Ok(pixels)
}
