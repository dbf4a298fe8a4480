//! Sensor subscriptions, agreement on encodings, and encoding of tensors.

use crate::{
    host::ClientRange,
    refusal::{Failure, Refusal},
};
use avln_episode::{Encoding, Encodings, Sensors};
use avln_proto::v1::{self, Reason, SensorKind};
use avln_proto::wire::{CodecError, Size, audio, depth, rgb};
use bytes::Bytes;
use std::collections::BTreeSet;

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

fn agreed(encoding: v1::Encoding) -> Encoding {
    match encoding {
        v1::Encoding::Raw | v1::Encoding::Unspecified => Encoding::Raw,
        v1::Encoding::Packed => Encoding::Packed,
        v1::Encoding::Png => Encoding::Png,
        v1::Encoding::Qoi => Encoding::Qoi,
        v1::Encoding::DepthU16Mm => Encoding::Millimetres,
        v1::Encoding::DepthU16MmPacked => Encoding::PackedMillimetres,
        v1::Encoding::AudioI16 => Encoding::Int16,
    }
}

fn encoding_of(encodings: &mut Encodings, kind: SensorKind) -> &mut Encoding {
    match kind {
        SensorKind::Depth => &mut encodings.depth,
        SensorKind::Audio => &mut encodings.audio,
        SensorKind::Rgb | SensorKind::Unspecified => &mut encodings.rgb,
    }
}

/// Returns the encodings that a phase offers: lossy ones only if the phase's own encoding is lossy.
fn offered_of(most: &Sensors, kind: SensorKind) -> impl Iterator<Item = v1::Encoding> {
    let mut encodings = most.encodings;
    let allows_loss = !encoding_of(&mut encodings, kind).is_lossless();
    let offered = avln_proto::wire::offered(kind).iter().copied();
    offered.filter(move |encoding| allows_loss || avln_proto::wire::is_lossless(*encoding))
}

pub(crate) fn offered_in(most: &Sensors) -> Vec<i32> {
    unique(KINDS.into_iter().flat_map(|kind| offered_of(most, kind)))
}

pub(crate) fn offered() -> Vec<i32> {
    unique(KINDS.into_iter().flat_map(|kind| avln_proto::wire::offered(kind).iter().copied()))
}

fn unique(encodings: impl Iterator<Item = v1::Encoding>) -> Vec<i32> {
    encodings.map(|encoding| encoding as i32).collect::<BTreeSet<_>>().into_iter().collect()
}

/// Returns the first wish that server and phase offer.
fn agree(wish: &v1::SensorWish, most: &Sensors) -> Result<Encoding, Refusal> {
    if wish.encodings.is_empty() {
        return Ok(Encoding::Raw);
    }
    let kind = wish.kind();
    // An unspecified encoding means raw.
    let agreed = wish
        .encodings()
        .map(agreed)
        .find(|wished| offered_of(most, kind).any(|one| one == encoding(*wished)));
    agreed.ok_or_else(|| {
        let names: Vec<_> = offered_of(most, kind).map(|encoding| encoding.as_str_name()).collect();
        let message = format!(
            "none of the requested encodings of {} is offered; request one of {}",
            kind.as_str_name(),
            names.join(", ")
        );
        Refusal::new(Reason::EncodingUnsupported, message)
    })
}

pub(super) enum SensorValues {
    Rgb(Vec<u8>),
    /// Depths and their unit, metres.
    Depth(Vec<f32>, f32),
    Audio(Vec<f32>),
}

/// Encodes sensor values. Values that cannot be encoded are sent raw.
pub(super) fn pack(values: SensorValues, wanted: Encoding, sensors: &Sensors) -> (v1::Encoding, Bytes) {
    let encoding = self::encoding(wanted);
    if wanted == Encoding::Raw {
        return (encoding, raw(values));
    }
    match try_pack(encoding, &values, sensors) {
        Ok(bytes) => (encoding, bytes),
        Err(error) => {
            // Tensors carry their encoding, so a client can read the raw values: a logged fault costs no episode.
            Failure::server("pack an observation", error);
            (v1::Encoding::Raw, raw(values))
        }
    }
}

fn try_pack(encoding: v1::Encoding, values: &SensorValues, sensors: &Sensors) -> Result<Bytes, CodecError> {
    let size = Size { width: sensors.width, height: sensors.height };
    match values {
        SensorValues::Rgb(pixels) => rgb::encode(encoding, size, pixels),
        SensorValues::Depth(depths, unit_m) => {
            depth::encode(encoding, depth::Layout { size, unit_m: *unit_m }, depths)
        }
        SensorValues::Audio(samples) => audio::encode(encoding, samples),
    }
}

fn raw(values: SensorValues) -> Bytes {
    match values {
        SensorValues::Rgb(pixels) => pixels.into(),
        SensorValues::Depth(floats, _) | SensorValues::Audio(floats) => avln_proto::wire::raw_floats(floats),
    }
}

/// Default width and height of pictures, pixels, if the phase allows them.
const DEFAULT_SIDE: u32 = 256;

/// Returns all sensors of the phase, for a client that requests none.
fn default_sensors(most: &Sensors) -> Sensors {
    let Sensors { rgb, depth, audio, width, height, .. } = *most;
    Sensors { rgb, depth, audio, ..Sensors::all(width.min(DEFAULT_SIDE), height.min(DEFAULT_SIDE)) }
}

/// Refuses sensors beyond those of the phase, `most`.
pub(crate) fn check_sensors(sensors: &Sensors, most: &Sensors) -> Result<(), Refusal> {
    if sensors.is_within(most) {
        return Ok(());
    }
    let message = format!("the phase allows at most {most}; requested: {sensors}");
    Err(Refusal::new(Reason::SensorNotAllowed, message))
}

/// Returns the subscribed sensors; by default all of the phase, `most`. Their limits are checked by [`check_sensors`].
pub(crate) fn requested_sensors(
    wish: Option<&v1::SensorSubscription>,
    most: &Sensors,
) -> Result<Sensors, Refusal> {
    let Some(wish) = wish else { return Ok(default_sensors(most)) };
    let mut sensors = Sensors {
        rgb: false,
        depth: false,
        audio: false,
        width: wish.width,
        height: wish.height,
        hfov_rad: wish.hfov_rad,
        encodings: Encodings::default(),
    };
    for wish in &wish.wishes {
        let wanted = match wish.kind() {
            SensorKind::Rgb => &mut sensors.rgb,
            SensorKind::Depth => &mut sensors.depth,
            SensorKind::Audio => &mut sensors.audio,
            SensorKind::Unspecified => {
                let message = format!("sensor kind {} does not exist; use RGB, DEPTH or AUDIO", wish.kind);
                return Err(Refusal::new(Reason::BadRequest, message));
            }
        };
        if std::mem::replace(wanted, true) {
            let message = format!("sensor {} is listed twice; list it once", wish.kind().as_str_name());
            return Err(Refusal::new(Reason::BadRequest, message));
        }
        *encoding_of(&mut sensors.encodings, wish.kind()) = agree(wish, most)?;
    }
    sensors.validate().map_err(|error| Refusal::new(Reason::BadRequest, error.to_string()))?;
    Ok(sensors)
}

/// Refuses client library versions outside the accepted ranges.
pub(crate) fn check_client(client: Option<&v1::ClientInfo>, accepted: &[ClientRange]) -> Result<(), Refusal> {
    let Some(client) = client else { return Ok(()) };
    let Some(range) = accepted.iter().find(|range| range.name == client.name) else { return Ok(()) };
    let version = numbers(&client.version);
    let reason = if !range.min_version.is_empty() && version < numbers(&range.min_version) {
        Reason::ClientTooOld
    } else if !range.max_version.is_empty() && version > numbers(&range.max_version) {
        Reason::ClientTooNew
    } else {
        return Ok(());
    };
    let message = format!(
        "{} {} is not accepted, versions {} to {} are; {}",
        range.name,
        client.version.chars().take(40).collect::<String>(),
        or_any(&range.min_version),
        or_any(&range.max_version),
        range.install
    );
    Err(Refusal::new(reason, message))
}

fn or_any(version: &str) -> &str {
    if version.is_empty() { "any" } else { version }
}

/// Returns major, minor and patch; other text counts as 0.
fn numbers(version: &str) -> [u64; 3] {
    let core = version.split(['-', '+']).next().unwrap_or_default();
    let mut parts = core.split('.').map(|part| part.parse().unwrap_or(0));
    [(); 3].map(|()| parts.next().unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_episode::Encoding as Agreed;
    use avln_proto::v1::Encoding;

    fn most() -> Sensors {
        Sensors::all(1024, 1024)
    }

    fn sensors(wish: Option<&v1::SensorSubscription>, most: &Sensors) -> Result<Sensors, Refusal> {
        let sensors = requested_sensors(wish, most)?;
        check_sensors(&sensors, most).map(|()| sensors)
    }

    fn wish(kind: SensorKind, encodings: &[Encoding]) -> v1::SensorWish {
        v1::SensorWish { kind: kind.into(), encodings: encodings.iter().map(|&e| e.into()).collect() }
    }

    fn subscription(wishes: Vec<v1::SensorWish>) -> v1::SensorSubscription {
        v1::SensorSubscription { wishes, width: 128, height: 96, hfov_rad: 1.5 }
    }

    #[test]
    fn the_subscription_sets_the_sensors() {
        let asked = subscription(vec![wish(SensorKind::Depth, &[Encoding::Png, Encoding::Raw])]);
        let expected = Sensors { rgb: false, audio: false, hfov_rad: 1.5, ..Sensors::all(128, 96) };
        assert_eq!(sensors(Some(&asked), &most()), Ok(expected));
    }

    #[test]
    fn default_sensors_are_those_of_the_phase() {
        assert_eq!(sensors(None, &most()), Ok(Sensors::all(256, 256)));
        let few = Sensors { depth: false, ..Sensors::all(512, 128) };
        assert_eq!(sensors(None, &few), Ok(Sensors { depth: false, ..Sensors::all(256, 128) }));
    }

    #[test]
    fn the_first_offered_encoding_is_agreed() {
        let agreed = |kind, encodings: &[Encoding], most: &Sensors| {
            let granted = sensors(Some(&subscription(vec![wish(kind, encodings)])), most)?;
            let Encodings { rgb, depth, audio } = granted.encodings;
            Ok::<_, Refusal>(if kind == SensorKind::Rgb {
                rgb
            } else if kind == SensorKind::Depth {
                depth
            } else {
                audio
            })
        };
        let (rgb, depth, audio) = (SensorKind::Rgb, SensorKind::Depth, SensorKind::Audio);
        assert_eq!(
            agreed(rgb, &[Encoding::AudioI16, Encoding::Png, Encoding::Packed], &most()),
            Ok(Agreed::Png)
        );
        assert_eq!(agreed(depth, &[Encoding::Packed, Encoding::Raw], &most()), Ok(Agreed::Packed));
        let rounding = [Encoding::DepthU16MmPacked, Encoding::Packed];
        assert_eq!(
            agreed(depth, &rounding, &most()),
            Ok(Agreed::Packed),
            "the phase allows no lossy encoding"
        );
        let mut generous = most();
        generous.encodings.depth = Agreed::Millimetres;
        assert_eq!(agreed(depth, &rounding, &generous), Ok(Agreed::PackedMillimetres));
        let refused = agreed(audio, &[Encoding::AudioI16], &generous).unwrap_err();
        assert_eq!(refused.reason, Reason::EncodingUnsupported);
        assert!(refused.message.contains("one of ENCODING_RAW"), "{}", refused.message);
        generous.encodings.audio = Agreed::Int16;
        assert_eq!(agreed(audio, &[Encoding::AudioI16], &generous), Ok(Agreed::Int16));
    }

    #[test]
    fn impossible_subscriptions_are_refused() {
        let cases = [
            (subscription(vec![wish(SensorKind::Rgb, &[Encoding::AudioI16])]), Reason::EncodingUnsupported),
            (subscription(vec![wish(SensorKind::Unspecified, &[])]), Reason::BadRequest),
            (subscription(vec![wish(SensorKind::Rgb, &[]), wish(SensorKind::Rgb, &[])]), Reason::BadRequest),
            (v1::SensorSubscription { width: 4096, ..subscription(vec![]) }, Reason::BadRequest),
            (v1::SensorSubscription { hfov_rad: f32::NAN, ..subscription(vec![]) }, Reason::BadRequest),
        ];
        for (asked, reason) in cases {
            assert_eq!(sensors(Some(&asked), &most()).unwrap_err().reason, reason, "{asked:?}");
        }
        let modest = Sensors { audio: false, ..Sensors::all(512, 512) };
        let wide = v1::SensorSubscription {
            width: 600,
            height: 600,
            hfov_rad: modest.hfov_rad,
            ..subscription(vec![wish(SensorKind::Rgb, &[])])
        };
        for asked in [wide.clone(), subscription(vec![wish(SensorKind::Audio, &[])])] {
            assert_eq!(sensors(Some(&asked), &modest).unwrap_err().reason, Reason::SensorNotAllowed);
        }
        assert_eq!(
            sensors(Some(&wide), &modest).unwrap_err().message,
            "the phase allows at most 512 x 512, RGB + DEPTH; requested: 600 x 600, RGB"
        );
    }

    #[test]
    fn refused_versions_receive_install_advice() {
        let range = ClientRange {
            name: "avln-client".into(),
            min_version: "0.9.0".into(),
            max_version: "1.2.3".into(),
            install: "cargo add avln-client@1".into(),
        };
        let check = |name: &str, version: &str| {
            let client = v1::ClientInfo { name: name.into(), version: version.into(), api_minor: 0 };
            check_client(Some(&client), std::slice::from_ref(&range))
        };
        assert_eq!(check("avln-client", "0.10.0"), Ok(()));
        assert_eq!(check("avln-client", "1.2.3-beta"), Ok(()));
        assert_eq!(check("other-client", "0.0.1"), Ok(()));
        assert_eq!(check("avln-client", "1.10.0").unwrap_err().reason, Reason::ClientTooNew);
        let old = check("avln-client", "0.8.9").unwrap_err();
        assert_eq!(old.reason, Reason::ClientTooOld);
        assert!(old.message.contains("cargo add"), "{}", old.message);
    }
}
