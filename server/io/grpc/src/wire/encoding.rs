//! How the numbers of sensors are packed: what is offered, what is agreed, and the packing itself.

use crate::refusal::{Refusal, ServerFault};
use avln_codec::{CodecError, Size, audio, depth, rgb};
use avln_episode::{Encoding, Encodings, Sensors};
use avln_proto::v1::{self, Reason, SensorKind};
use bytes::Bytes;
use tokio::runtime::{Handle, RuntimeFlavor};

const KINDS: [SensorKind; 3] = [SensorKind::Rgb, SensorKind::Depth, SensorKind::Audio];

pub(crate) fn encoding(encoding: Encoding) -> v1::Encoding {
    match encoding {
        Encoding::Raw => v1::Encoding::Raw,
        Encoding::Packed => v1::Encoding::Packed,
        Encoding::Png => v1::Encoding::Png,
        Encoding::Qoi => v1::Encoding::Qoi,
        Encoding::Millimetres => v1::Encoding::DepthU16Mm,
        Encoding::PackedMillimetres => v1::Encoding::DepthU16MmPacked,
        Encoding::Int16 => v1::Encoding::AudioI16,
    }
}

fn known(encoding: v1::Encoding) -> Option<Encoding> {
    match encoding {
        v1::Encoding::Raw | v1::Encoding::Unspecified => Some(Encoding::Raw),
        v1::Encoding::Packed => Some(Encoding::Packed),
        v1::Encoding::Png => Some(Encoding::Png),
        v1::Encoding::Qoi => Some(Encoding::Qoi),
        v1::Encoding::DepthU16Mm => Some(Encoding::Millimetres),
        v1::Encoding::DepthU16MmPacked => Some(Encoding::PackedMillimetres),
        v1::Encoding::AudioI16 => Some(Encoding::Int16),
        v1::Encoding::Zstd | v1::Encoding::DepthU16MmZstd | v1::Encoding::Jpeg => None,
    }
}

/// The encoding of one kind of sensor.
pub(super) fn of(encodings: &mut Encodings, kind: SensorKind) -> &mut Encoding {
    match kind {
        SensorKind::Depth => &mut encodings.depth,
        SensorKind::Audio => &mut encodings.audio,
        SensorKind::Rgb | SensorKind::Unspecified => &mut encodings.rgb,
    }
}

/// Whether the phase lets agents ask for `encoding`: one that changes values only where such a one stands.
fn allows(most: &Sensors, kind: SensorKind, encoding: v1::Encoding) -> bool {
    let mut most = most.encodings;
    avln_codec::is_lossless(encoding) || !of(&mut most, kind).is_lossless()
}

/// What agents of a phase may ask for.
pub(crate) fn offered_in(most: &Sensors) -> Vec<i32> {
    let of_kind = |kind: SensorKind| {
        let offered = avln_codec::offered(kind).iter();
        offered.filter(move |encoding| allows(most, kind, **encoding)).map(|encoding| *encoding as i32)
    };
    unique(KINDS.into_iter().flat_map(of_kind))
}

/// What the server can pack.
pub(crate) fn offered() -> Vec<i32> {
    unique(
        KINDS.into_iter().flat_map(|kind| avln_codec::offered(kind).iter().map(|encoding| *encoding as i32)),
    )
}

fn unique(numbers: impl Iterator<Item = i32>) -> Vec<i32> {
    let mut all: Vec<i32> = numbers.collect();
    all.sort_unstable();
    all.dedup();
    all
}

/// The first wish that server and phase offer.
pub(super) fn agree(wish: &v1::SensorWish, most: &Sensors) -> Result<Encoding, Refusal> {
    if wish.encodings.is_empty() {
        return Ok(Encoding::Raw);
    }
    let kind = wish.kind();
    let offered = |wished: v1::Encoding| {
        let encoding = known(wished)?;
        let can = avln_codec::offered(kind).contains(&self::encoding(encoding));
        (can && allows(most, kind, self::encoding(encoding))).then_some(encoding)
    };
    wish.encodings().find_map(offered).ok_or_else(|| {
        let offered = avln_codec::offered(kind).iter().filter(|encoding| allows(most, kind, **encoding));
        let names: Vec<_> = offered.map(|encoding| encoding.as_str_name()).collect();
        let message = format!(
            "none of the encodings wanted for {} is offered; wish for one of {}",
            kind.as_str_name(),
            names.join(", ")
        );
        Refusal::new(Reason::EncodingUnsupported, message)
    })
}

/// The numbers of one sensor.
pub(super) enum Numbers {
    Rgb(Vec<u8>),
    Depth(Vec<f32>, f32),
    Audio(Vec<f32>),
}

/// Packs the numbers of a sensor. Those that cannot be packed are a fault of the server: they come raw, and its log says so.
pub(super) fn pack(numbers: Numbers, wanted: Encoding, sensors: &Sensors) -> (v1::Encoding, Bytes) {
    let encoding = self::encoding(wanted);
    if wanted == Encoding::Raw {
        return (encoding, raw(numbers));
    }
    let packed = undisturbed(|| try_pack(encoding, &numbers, sensors));
    match packed {
        Ok(bytes) => (encoding, bytes),
        Err(error) => {
            ServerFault::log("pack an observation", error);
            (v1::Encoding::Raw, raw(numbers))
        }
    }
}

fn try_pack(encoding: v1::Encoding, numbers: &Numbers, sensors: &Sensors) -> Result<Bytes, CodecError> {
    let size = Size { width: sensors.width, height: sensors.height };
    match numbers {
        Numbers::Rgb(pixels) => rgb::encode(encoding, size, pixels),
        Numbers::Depth(depths, unit_m) => {
            depth::encode(encoding, depth::Layout { size, unit_m: *unit_m }, depths)
        }
        Numbers::Audio(samples) => audio::encode(encoding, samples),
    }
}

fn raw(numbers: Numbers) -> Bytes {
    match numbers {
        Numbers::Rgb(pixels) => pixels.into(),
        Numbers::Depth(floats, _) | Numbers::Audio(floats) => avln_codec::raw_floats(floats),
    }
}

/// Lets other tasks go on meanwhile, where the runtime can: large pictures take milliseconds.
fn undisturbed<T>(work: impl FnOnce() -> T) -> T {
    match Handle::try_current().map(|handle| handle.runtime_flavor()) {
        Ok(RuntimeFlavor::MultiThread) => tokio::task::block_in_place(work),
        _ => work(),
    }
}
