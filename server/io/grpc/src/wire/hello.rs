use super::encoding;
use crate::{host::ClientRange, refusal::Refusal};
use avln_episode::{Encodings, Sensors};
use avln_proto::v1::{self, Reason, SensorKind};

/// Side of the pictures for agents that do not say.
const DEFAULT_SIDE: u32 = 256;

/// The sensors that an agent subscribes to; all of them when it does not say. `most` is what its phase allows.
pub(crate) fn sensors(wish: Option<&v1::SensorSubscription>, most: &Sensors) -> Result<Sensors, Refusal> {
    let Some(wish) = wish else { return Ok(Sensors::all(DEFAULT_SIDE, DEFAULT_SIDE)) };
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
        *encoding::of(&mut sensors.encodings, wish.kind()) = encoding::agree(wish, most)?;
    }
    sensors.validate().map_err(|error| Refusal::new(Reason::BadRequest, error.to_string()))?;
    Ok(sensors)
}

/// Refuses client libraries whose versions the server does not accept.
pub(crate) fn client_is_welcome(
    client: Option<&v1::ClientInfo>,
    accepted: &[ClientRange],
) -> Result<(), Refusal> {
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

/// Major, minor and patch; what is not a number counts as 0.
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

    fn wish(kind: SensorKind, encodings: &[Encoding]) -> v1::SensorWish {
        v1::SensorWish { kind: kind.into(), encodings: encodings.iter().map(|&e| e.into()).collect() }
    }

    fn subscription(wishes: Vec<v1::SensorWish>) -> v1::SensorSubscription {
        v1::SensorSubscription { wishes, width: 128, height: 96, hfov_rad: 1.5 }
    }

    #[test]
    fn what_is_wished_for_is_what_is_rendered() {
        let asked = subscription(vec![wish(SensorKind::Depth, &[Encoding::Png, Encoding::Raw])]);
        let expected = Sensors { rgb: false, audio: false, hfov_rad: 1.5, ..Sensors::all(128, 96) };
        assert_eq!(sensors(Some(&asked), &most()), Ok(expected));
        assert_eq!(sensors(None, &most()), Ok(Sensors::all(256, 256)));
    }

    #[test]
    fn the_first_encoding_that_is_offered_is_agreed() {
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
        assert_eq!(agreed(rgb, &[Encoding::Jpeg, Encoding::Png, Encoding::Packed], &most()), Ok(Agreed::Png));
        assert_eq!(agreed(depth, &[Encoding::Packed, Encoding::Raw], &most()), Ok(Agreed::Packed));
        let rounding = [Encoding::DepthU16MmPacked, Encoding::Packed];
        assert_eq!(
            agreed(depth, &rounding, &most()),
            Ok(Agreed::Packed),
            "the phase does not let values change"
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
    fn impossible_wishes_are_refused_with_their_reason() {
        let cases = [
            (subscription(vec![wish(SensorKind::Rgb, &[Encoding::Jpeg])]), Reason::EncodingUnsupported),
            (subscription(vec![wish(SensorKind::Unspecified, &[])]), Reason::BadRequest),
            (subscription(vec![wish(SensorKind::Rgb, &[]), wish(SensorKind::Rgb, &[])]), Reason::BadRequest),
            (v1::SensorSubscription { width: 4096, ..subscription(vec![]) }, Reason::BadRequest),
            (v1::SensorSubscription { hfov_rad: f32::NAN, ..subscription(vec![]) }, Reason::BadRequest),
        ];
        for (asked, reason) in cases {
            assert_eq!(sensors(Some(&asked), &most()).unwrap_err().reason, reason, "{asked:?}");
        }
    }

    #[test]
    fn versions_outside_of_the_range_are_told_what_to_install() {
        let range = ClientRange {
            name: "avln-client".into(),
            min_version: "0.9.0".into(),
            max_version: "1.2.3".into(),
            install: "cargo add avln-client@1".into(),
        };
        let check = |name: &str, version: &str| {
            let client = v1::ClientInfo { name: name.into(), version: version.into(), api_minor: 0 };
            client_is_welcome(Some(&client), std::slice::from_ref(&range))
        };
        assert_eq!(check("avln-client", "0.10.0"), Ok(()));
        assert_eq!(check("avln-client", "1.2.3-beta"), Ok(()));
        assert_eq!(check("somebody-else", "0.0.1"), Ok(()));
        assert_eq!(check("avln-client", "1.10.0").unwrap_err().reason, Reason::ClientTooNew);
        let old = check("avln-client", "0.8.9").unwrap_err();
        assert_eq!(old.reason, Reason::ClientTooOld);
        assert!(old.message.contains("cargo add"), "{}", old.message);
    }
}
