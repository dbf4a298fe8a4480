//! Colours: `height × width × 3` bytes, RGB, first row on top.
//!
//! `PACKED` holds three planes, green, red minus green and blue minus green, all modulo 256. Of each pixel it keeps the
//! difference to the one above, which is 0 for the first row, as a signed byte, folded (0, -1, 1, -2 … become 0, 1, 2, 3 …)
//! and packed in blocks.

use crate::{CodecError, Size, blocks, not_offered, png, qoi};
use avln_proto::v1::{Encoding, SensorKind};
use bytes::Bytes;

const CHANNELS: usize = 3;

/// Packs the colours of a picture.
///
/// # Errors
/// When there are not as many bytes as `size` asks for, or the encoding is not one of colours.
pub fn encode(encoding: Encoding, size: Size, pixels: &[u8]) -> Result<Bytes, CodecError> {
    CodecError::check_length("a colour picture", "bytes", pixels.len(), CHANNELS * size.pixels())?;
    match encoding {
        Encoding::Raw => Ok(Bytes::copy_from_slice(pixels)),
        Encoding::Packed => Ok(pack(size, pixels).into()),
        Encoding::Png => png::encode(size, pixels).map(Bytes::from),
        Encoding::Qoi => Ok(qoi::encode(size, pixels).into()),
        other => not_offered(SensorKind::Rgb, other),
    }
}

/// Unpacks the colours of a picture of `size`.
///
/// # Errors
/// When `bytes` are not such a picture in this encoding.
pub fn decode(encoding: Encoding, size: Size, bytes: Bytes) -> Result<Vec<u8>, CodecError> {
    match encoding {
        Encoding::Raw => {
            CodecError::check_length("a colour picture", "bytes", bytes.len(), CHANNELS * size.pixels())?;
            Ok(bytes.into())
        }
        Encoding::Packed => unpack(size, &bytes),
        Encoding::Png => png::decode(size, &bytes),
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

/// A difference as a number that is small when it is near zero.
fn fold(difference: u8) -> u8 {
    (difference << 1) ^ (difference as i8 >> 7) as u8
}

/// The difference that [`fold`] made a number of.
fn unfold(number: u8) -> u8 {
    (number >> 1) ^ (number & 1).wrapping_neg()
}
