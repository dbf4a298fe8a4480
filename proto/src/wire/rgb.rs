//! Colour: `height × width × 3` bytes, RGB, top row first.
//!
//! `PACKED` consists of three planes: green, red minus green, and blue minus green, modulo 256. It stores the signed byte
//! difference to the pixel above, or to 0 in the first row, folded (0, -1, 1, -2 … to 0, 1, 2, 3 …) and packed in blocks.

use super::{CodecError, Encoding, SensorKind, Size, blocks, not_offered};
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
        Encoding::Qoi => Ok(encode_qoi(size, pixels).into()),
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
        Encoding::Qoi => decode_qoi(size, &bytes),
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

// QOI files with three channels, by the QOI specification (Szablewski, qoiformat.org, version 1.0, 2022).
const MAGIC: &[u8; 4] = b"qoif";
const SRGB: u8 = 0;
const END: [u8; 8] = [0, 0, 0, 0, 0, 0, 0, 1];
const HEADER_BYTES: usize = 14;

const INDEX: u8 = 0x00;
const DIFF: u8 = 0x40;
const LUMA: u8 = 0x80;
const RUN: u8 = 0xc0;
const RGB: u8 = 0xfe;
const RGBA: u8 = 0xff;
const LONGEST_RUN: u8 = 62;

type Pixel = [u8; 3];

fn qoi_header(size: Size) -> [u8; HEADER_BYTES] {
    let mut header = [0; HEADER_BYTES];
    header[..4].copy_from_slice(MAGIC);
    header[4..8].copy_from_slice(&size.width.to_be_bytes());
    header[8..12].copy_from_slice(&size.height.to_be_bytes());
    [header[12], header[13]] = [CHANNELS as u8, SRGB];
    header
}

/// Returns a pixel's index in the table of earlier pixels. Alpha is always 255.
fn index_of([r, g, b]: Pixel) -> usize {
    let sum = 3 * usize::from(r) + 5 * usize::from(g) + 7 * usize::from(b) + 11 * 255;
    sum % 64
}

fn encode_qoi(size: Size, pixels: &[u8]) -> Vec<u8> {
    let mut file = Vec::with_capacity(pixels.len() / 2);
    file.extend_from_slice(&qoi_header(size));
    // The specification starts with transparent pixels here, which differ from all RGB pixels.
    let mut seen: [Option<Pixel>; 64] = [None; 64];
    let (mut last, mut run) = ([0; 3], 0);
    for &pixel in pixels.as_chunks().0 {
        if pixel == last {
            run += 1;
            if run == LONGEST_RUN {
                end_run(&mut run, &mut file);
            }
            continue;
        }
        end_run(&mut run, &mut file);
        let index = index_of(pixel);
        if seen[index] == Some(pixel) {
            file.push(INDEX | index as u8);
        } else {
            seen[index] = Some(pixel);
            push_change(last, pixel, &mut file);
        }
        last = pixel;
    }
    end_run(&mut run, &mut file);
    file.extend_from_slice(&END);
    file
}

fn end_run(run: &mut u8, file: &mut Vec<u8>) {
    if *run > 0 {
        file.push(RUN | (*run - 1));
        *run = 0;
    }
}

fn push_change(last: Pixel, pixel: Pixel, file: &mut Vec<u8>) {
    let [dr, dg, db] = [0, 1, 2].map(|channel| pixel[channel].wrapping_sub(last[channel]));
    let small = [dr, dg, db].map(|change| change.wrapping_add(2));
    let luma = [dr.wrapping_sub(dg), db.wrapping_sub(dg)].map(|change| change.wrapping_add(8));
    let green = dg.wrapping_add(32);
    if small.iter().all(|change| *change < 4) {
        file.push(DIFF | small[0] << 4 | small[1] << 2 | small[2]);
    } else if green < 64 && luma.iter().all(|change| *change < 16) {
        file.extend_from_slice(&[LUMA | green, luma[0] << 4 | luma[1]]);
    } else {
        file.extend_from_slice(&[RGB, pixel[0], pixel[1], pixel[2]]);
    }
}

fn decode_qoi(size: Size, bytes: &[u8]) -> Result<Vec<u8>, CodecError> {
    let broken = |detail: &str| CodecError::broken(Encoding::Qoi, detail);
    let body = bytes.strip_prefix(&qoi_header(size)).ok_or_else(|| {
        broken(&format!("expected a header with {} x {} pixels, RGB, sRGB", size.width, size.height))
    })?;
    let mut body = body.strip_suffix(&END).ok_or_else(|| broken("its end marker is missing"))?;
    let mut pixels = vec![0; 3 * size.pixels()];
    let mut seen = [[0; 3]; 64];
    let (mut last, mut run) = ([0; 3], 0);
    for pixel in pixels.as_chunks_mut().0 {
        if run > 0 {
            run -= 1;
        } else {
            (last, run, body) = next_pixel(last, &seen, body).ok_or_else(|| broken("it ends too early"))?;
            seen[index_of(last)] = last;
        }
        *pixel = last;
    }
    if run > 0 || !body.is_empty() {
        return Err(broken("it continues after the last pixel"));
    }
    Ok(pixels)
}

/// Returns the next pixel, the repetitions, and the remaining file.
fn next_pixel<'a>(last: Pixel, seen: &[Pixel; 64], body: &'a [u8]) -> Option<(Pixel, u8, &'a [u8])> {
    let (&tag, rest) = body.split_first()?;
    let moved =
        |[dr, dg, db]: Pixel| [last[0].wrapping_add(dr), last[1].wrapping_add(dg), last[2].wrapping_add(db)];
    match tag {
        RGB => rest.split_first_chunk().map(|(pixel, rest)| (*pixel, 0, rest)),
        // RGB files have no transparent pixels.
        RGBA => None,
        _ => match tag & 0xc0 {
            INDEX => Some((seen[usize::from(tag & 63)], 0, rest)),
            DIFF => {
                let changes = [tag >> 4 & 3, tag >> 2 & 3, tag & 3].map(|change| change.wrapping_sub(2));
                Some((moved(changes), 0, rest))
            }
            LUMA => {
                let (&luma, rest) = rest.split_first()?;
                let green = (tag & 63).wrapping_sub(32);
                let other = |change: u8| green.wrapping_add(change).wrapping_sub(8);
                Some((moved([other(luma >> 4), green, other(luma & 15)]), 0, rest))
            }
            _ => Some((last, tag & 63, rest)),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Worked out by hand from the specification.
    #[test]
    fn files_follow_the_specification() {
        let size = Size { width: 7, height: 1 };
        let pixels =
            [[0, 0, 0], [0, 0, 0], [1, 0, 255], [11, 10, 10], [200, 0, 0], [11, 10, 10], [11, 10, 10]];
        let file = encode_qoi(size, pixels.as_flattened());
        let body = [
            0xc1,                       // twice the previous pixel, black at first
            0x40 | 3 << 4 | 2 << 2 | 1, // +1, 0, -1
            0x80 | 42,
            (8 + 10 - 10) << 4 | (8 + 11 - 10), // green +10, red +10, blue +11
            0xfe,
            200,
            0,
            0,
            (3 * 11 + 5 * 10 + 7 * 10 + 11 * 255) as u8 % 64,
            0xc0,
        ];
        let expected = [&qoi_header(size)[..], &body, &END].concat();
        assert_eq!(file, expected);
        assert_eq!(decode_qoi(size, &file).unwrap(), pixels.as_flattened());
    }
}
