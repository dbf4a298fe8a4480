use avln_proto::v1::{Encoding, SensorKind};

/// Encoding of images and sound.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Packing {
    /// Raw: fastest on the same machine.
    Raw,
    /// In fewer bytes, and the same numbers: the quickest across a network.
    Lossless,
    /// Depth rounded to millimetres and sound to 16 bits if the phase permits it, otherwise
    /// [`Lossless`](Packing::Lossless).
    Rounded,
}

impl Packing {
    /// Default for a server address: raw on this machine, otherwise lossless.
    pub(crate) fn of_host(host: &str) -> Self {
        let address = host.trim_start_matches('[').trim_end_matches(']').parse::<std::net::IpAddr>();
        let is_here = address.map_or(host == "localhost", |address| address.is_loopback());
        if is_here { Self::Raw } else { Self::Lossless }
    }

    /// The encodings to wish for, best first.
    pub(crate) fn wishes(self, kind: SensorKind) -> Vec<Encoding> {
        let offered = avln_proto::wire::offered(kind).iter().copied();
        let lossless = offered.clone().filter(|encoding| avln_proto::wire::is_lossless(*encoding));
        match self {
            Self::Raw => vec![Encoding::Raw],
            Self::Lossless => lossless.collect(),
            Self::Rounded => {
                offered.filter(|encoding| !avln_proto::wire::is_lossless(*encoding)).chain(lossless).collect()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_machine_is_told_from_others() {
        for host in ["localhost", "127.0.0.1", "127.8.0.1", "[::1]"] {
            assert_eq!(Packing::of_host(host), Packing::Raw, "{host}");
        }
        for host in ["arena.example", "10.0.0.1", "[2001:db8::1]", "localhost.example"] {
            assert_eq!(Packing::of_host(host), Packing::Lossless, "{host}");
        }
    }

    #[test]
    fn raw_is_always_among_the_wishes_and_rounding_only_where_asked_for() {
        for kind in [SensorKind::Rgb, SensorKind::Depth, SensorKind::Audio] {
            for packing in [Packing::Raw, Packing::Lossless, Packing::Rounded] {
                let wishes = packing.wishes(kind);
                assert!(wishes.contains(&Encoding::Raw), "{kind:?} {packing:?}");
                let rounds = wishes.iter().any(|encoding| !avln_proto::wire::is_lossless(*encoding));
                assert_eq!(
                    rounds,
                    packing == Packing::Rounded && kind != SensorKind::Rgb,
                    "{kind:?} {packing:?}"
                );
            }
        }
    }
}
