//! How the numbers of a tensor are packed on the wire, and how they are had back.
//!
//! Start reading at [`offered`], then [`rgb`], [`depth`] and [`audio`]. `PROTOCOL.md` gives the layouts byte by byte.
//!
//! | encoding | sensor | numbers that come back |
//! |---|---|---|
//! | `RAW` | all | the same |
//! | `PACKED` | colour, depth | the same |
//! | `PNG`, `QOI` | colour | the same |
//! | `DEPTH_U16_MM`, `DEPTH_U16_MM_PACKED` | depth | rounded to a millimetre |
//! | `AUDIO_I16` | sound | rounded to one part in 32767 |
//!
//! *Never*: allocates more than the size that was agreed, whatever the bytes say; panics on bytes from outside; depends on
//! the processor, since predictions use only additions, multiplications and divisions that round as IEEE 754 says.

pub mod audio;
mod blocks;
pub mod depth;
mod error;
mod floats;
mod png;
mod qoi;
pub mod rgb;

pub use error::CodecError;
pub use floats::raw_floats;

pub use avln_proto::v1::{Encoding, SensorKind};

/// Pixels of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl Size {
    /// How many pixels there are.
    pub fn pixels(self) -> usize {
        self.width as usize * self.height as usize
    }
}

/// The encodings of a sensor's numbers, the one that is best across a network first.
pub fn offered(kind: SensorKind) -> &'static [Encoding] {
    match kind {
        SensorKind::Rgb => &[Encoding::Packed, Encoding::Png, Encoding::Qoi, Encoding::Raw],
        SensorKind::Depth => {
            &[Encoding::Packed, Encoding::Raw, Encoding::DepthU16MmPacked, Encoding::DepthU16Mm]
        }
        SensorKind::Audio => &[Encoding::Raw, Encoding::AudioI16],
        SensorKind::Unspecified => &[],
    }
}

/// Whether the numbers come back bit for bit.
pub fn is_lossless(encoding: Encoding) -> bool {
    match encoding {
        Encoding::Raw | Encoding::Packed | Encoding::Png | Encoding::Qoi | Encoding::Zstd => true,
        Encoding::Unspecified
        | Encoding::DepthU16Mm
        | Encoding::DepthU16MmZstd
        | Encoding::DepthU16MmPacked
        | Encoding::AudioI16
        | Encoding::Jpeg => false,
    }
}

/// The most bytes that `raw_bytes` of numbers take in any encoding, however badly they pack.
pub const fn most_bytes(raw_bytes: u64) -> u64 {
    raw_bytes / 3 * 4 + 1024
}

/// The encodings that no sensor's numbers are offered in are refused here.
fn not_offered<T>(kind: SensorKind, encoding: Encoding) -> Result<T, CodecError> {
    Err(CodecError::NotOffered { kind, encoding })
}
