//! Depth: `height × width` values, top row first.
//!
//! The reciprocal of depth is linear in an image column of a plane. `PACKED` therefore predicts a value from the two above
//! it, `a` (directly above) and `b`: `p = a·b / (b + b - a)`, in binary32, with every operation rounded to nearest. If `p` is
//! not positive and finite, and in the second row, the prediction is `a`; in the first row it is the value to the left, or 0.
//! The stored residual is the difference of the bit patterns as signed 32-bit integers, modulo 2^32, folded (0, -1, 1, -2 …
//! become 0, 1, 2, 3 …) and packed in blocks.
//!
//! `DEPTH_U16_MM_PACKED` predicts millimetres as left plus above minus above left, modulo 2^16, with 0 outside of the picture,
//! and stores the difference as a signed 16-bit integer in the same way.

use super::{
    CodecError, Encoding, SensorKind, Size,
    blocks::{self, fold, unfold},
    copy_floats, floats_from, not_offered,
};
use bytes::Bytes;

/// Depth image size and unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layout {
    /// Size.
    pub size: Size,
    /// Value unit, metres.
    pub unit_m: f32,
}

/// Encodes a depth image.
///
/// # Errors
/// If the value count does not match the size, or depth has no such encoding.
pub fn encode(encoding: Encoding, layout: Layout, depth: &[f32]) -> Result<Bytes, CodecError> {
    let width = layout.size.width as usize;
    CodecError::check_length("depth image", "numbers", depth.len(), layout.size.pixels())?;
    match encoding {
        Encoding::Raw => Ok(copy_floats(depth)),
        Encoding::Packed => Ok(pack(width, depth).into()),
        Encoding::DepthU16Mm => {
            Ok(millimetres(depth, layout.unit_m).iter().flat_map(|mm| mm.to_le_bytes()).collect())
        }
        Encoding::DepthU16MmPacked => Ok(pack_millimetres(width, &millimetres(depth, layout.unit_m)).into()),
        other => not_offered(SensorKind::Depth, other),
    }
}

/// Decodes a depth image.
///
/// # Errors
/// If `bytes` are not an image in this size and encoding.
pub fn decode(encoding: Encoding, layout: Layout, bytes: &[u8]) -> Result<Vec<f32>, CodecError> {
    let (width, count) = (layout.size.width as usize, layout.size.pixels());
    let check = |each: usize| CodecError::check_length("depth image", "bytes", bytes.len(), each * count);
    let unpacked = |most_bits| {
        let numbers = blocks::unpack(bytes, count, most_bits, |number| number);
        numbers.map_err(|fault| CodecError::broken(encoding, fault))
    };
    match encoding {
        Encoding::Raw => check(4).map(|()| floats_from(bytes)),
        Encoding::Packed => unpacked(u32::BITS).map(|residuals| unpack(width, &residuals)),
        Encoding::DepthU16Mm => {
            check(2)?;
            let words = bytes.as_chunks().0.iter();
            Ok(words.map(|word| from_millimetres(u16::from_le_bytes(*word), layout.unit_m)).collect())
        }
        Encoding::DepthU16MmPacked => {
            let millimetres = unpack_millimetres(width, &unpacked(u16::BITS)?);
            Ok(millimetres.iter().map(|mm| from_millimetres(*mm, layout.unit_m)).collect())
        }
        other => not_offered(SensorKind::Depth, other),
    }
}

fn predict(above: f32, farther: f32) -> f32 {
    let straight = above * farther / (farther + farther - above);
    if straight > 0.0 && straight < f32::INFINITY { straight } else { above }
}

fn difference(actual: f32, predicted: f32) -> u32 {
    fold(actual.to_bits().wrapping_sub(predicted.to_bits()) as i32)
}

fn restore(predicted: f32, difference: u32) -> f32 {
    f32::from_bits(predicted.to_bits().wrapping_add(unfold(difference) as u32))
}

fn pack(width: usize, depth: &[f32]) -> Vec<u8> {
    let mut residuals = vec![0u32; depth.len()];
    let row = |row: usize| depth.get(row * width..(row + 1) * width).unwrap_or_default();
    for (y, residuals) in residuals.chunks_exact_mut(width.max(1)).enumerate() {
        let actual = row(y).iter().zip(residuals);
        match y {
            0 => {
                let left = std::iter::once(&0.0).chain(depth);
                actual.zip(left).for_each(|((own, out), left)| *out = difference(*own, *left));
            }
            1 => actual.zip(row(0)).for_each(|((own, out), above)| *out = difference(*own, *above)),
            _ => {
                let above = row(y - 1).iter().zip(row(y - 2));
                actual.zip(above).for_each(|((own, out), (above, farther))| {
                    *out = difference(*own, predict(*above, *farther));
                });
            }
        }
    }
    blocks::pack(&residuals)
}

fn unpack(width: usize, residuals: &[u32]) -> Vec<f32> {
    let mut depth = vec![0.0; residuals.len()];
    for (y, residuals) in residuals.chunks_exact(width.max(1)).enumerate() {
        let (known, rest) = depth.split_at_mut(y * width);
        let actual = rest.iter_mut().zip(residuals);
        let row = |back: usize| &known[(y - back) * width..][..width];
        match y {
            0 => {
                let mut left = 0.0;
                actual.for_each(|(own, residual)| {
                    left = restore(left, *residual);
                    *own = left;
                });
            }
            1 => actual.zip(row(1)).for_each(|((own, residual), above)| *own = restore(*above, *residual)),
            _ => actual.zip(row(1).iter().zip(row(2))).for_each(|((own, residual), (above, farther))| {
                *own = restore(predict(*above, *farther), *residual);
            }),
        }
    }
    depth
}

fn millimetres(depth: &[f32], unit_m: f32) -> Vec<u16> {
    let scale = 1000.0 * unit_m;
    let rounded = |depth: &f32| {
        let millimetres = (depth * scale).round() as u16;
        // Never to 0, which means "no hit".
        if *depth > 0.0 { millimetres.max(1) } else { millimetres }
    };
    depth.iter().map(rounded).collect()
}

fn from_millimetres(millimetres: u16, unit_m: f32) -> f32 {
    f32::from(millimetres) / (1000.0 * unit_m)
}

fn pack_millimetres(width: usize, millimetres: &[u16]) -> Vec<u8> {
    let mut residuals = Vec::with_capacity(millimetres.len());
    let mut above = vec![0; width];
    for row in millimetres.chunks_exact(width.max(1)) {
        let mut rise = 0u16;
        for (own, above) in row.iter().zip(&above) {
            let own_rise = own.wrapping_sub(*above);
            residuals.push(fold(i32::from(own_rise.wrapping_sub(rise) as i16)));
            rise = own_rise;
        }
        above.copy_from_slice(row);
    }
    blocks::pack(&residuals)
}

fn unpack_millimetres(width: usize, residuals: &[u32]) -> Vec<u16> {
    let mut millimetres = Vec::with_capacity(residuals.len());
    let mut above = vec![0u16; width];
    for row in residuals.chunks_exact(width.max(1)) {
        let mut rise = 0u16;
        for (residual, above) in row.iter().zip(&mut above) {
            rise = rise.wrapping_add(unfold(*residual) as u16);
            *above = above.wrapping_add(rise);
        }
        millimetres.extend_from_slice(&above);
    }
    millimetres
}
