//! Connection settings: address, TLS and packing.

use crate::error::{Error, chain};
use avln_proto::v1::{Encoding, SensorKind};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tonic::transport::{Certificate, Channel, ClientTlsConfig, Endpoint};

const CONNECT_TIMEOUT: Duration = Duration::from_secs(10);
// Keep-alive pings detect a dead peer within 50 s, also between an agent's slow actions.
const KEEP_ALIVE: Duration = Duration::from_secs(30);
const KEEP_ALIVE_TIMEOUT: Duration = Duration::from_secs(20);
// A window fits a whole observation of default size, so that the server does not wait for updates in a step.
const STREAM_WINDOW: u32 = 2 << 20;
const CONNECTION_WINDOW: u32 = 16 << 20;
// Small: bytes received before the message length is known are copied once more.
const FRAME_BYTES: u32 = 64 << 10;
const USER_AGENT: &str = concat!("avln-client/", env!("CARGO_PKG_VERSION"));

const UNIX: &str = "unix:";

/// Connection options.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ConnectOptions {
    /// PEM file with authorities for `https://` servers, instead of the system store.
    pub ca: Option<PathBuf>,
    /// Image and sound encoding; `None`: raw on this machine, lossless otherwise.
    pub packing: Option<Packing>,
    /// Reconnection time after a loss; `None`: as permitted by the server, at least three minutes.
    pub patience: Option<Duration>,
}

impl ConnectOptions {
    pub(crate) async fn connect(&self, address: &str) -> Result<(Channel, Packing), Error> {
        let endpoint = self.endpoint(address)?;
        let default = match address.starts_with(UNIX) {
            true => Packing::Raw,
            false => Packing::of_host(endpoint.uri().host().unwrap_or_default()),
        };
        let channel = endpoint.connect().await.map_err(|error| unreachable(address, chain(&error)))?;
        Ok((channel, self.packing.unwrap_or(default)))
    }

    fn endpoint(&self, address: &str) -> Result<Endpoint, Error> {
        let wrong =
            |problem: &str| Error::Address { address: address.to_owned(), problem: problem.to_owned() };
        let secure = match address.split_once("://") {
            Some(("http", _)) => false,
            Some(("https", _)) => true,
            _ if address.strip_prefix(UNIX).is_some_and(|path| path.starts_with('/')) => false,
            Some((scheme, _)) => return Err(wrong(&format!("unknown scheme '{scheme}'"))),
            None => return Err(wrong("the scheme is missing")),
        };
        let endpoint = Endpoint::from_shared(address.to_owned()).map_err(|error| wrong(&chain(&error)))?;
        let endpoint = endpoint
            .user_agent(USER_AGENT)
            .map_err(|error| wrong(&chain(&error)))?
            .connect_timeout(CONNECT_TIMEOUT)
            .tcp_nodelay(true)
            .initial_stream_window_size(STREAM_WINDOW)
            .initial_connection_window_size(CONNECTION_WINDOW)
            .max_frame_size(FRAME_BYTES)
            .http2_keep_alive_interval(KEEP_ALIVE)
            .keep_alive_timeout(KEEP_ALIVE_TIMEOUT);
        if secure { self.secure(address, endpoint) } else { Ok(endpoint) }
    }

    fn secure(&self, address: &str, endpoint: Endpoint) -> Result<Endpoint, Error> {
        let refused = |problem| Error::Tls { address: address.to_owned(), problem };
        let config = match &self.ca {
            Some(file) => ClientTlsConfig::new().ca_certificate(authorities(file).map_err(refused)?),
            None => ClientTlsConfig::new().with_native_roots(),
        };
        endpoint.tls_config(config).map_err(|error| {
            let source = self.ca.as_ref().map_or("the system store".into(), |file| file.to_string_lossy());
            refused(format!(
                "cannot use the certificate authorities in {source}: {}; use a PEM file with --ca or AVLN_CA",
                chain(&error)
            ))
        })
    }
}

fn authorities(file: &Path) -> Result<Certificate, String> {
    let pem = fs::read(file)
        .map_err(|error| format!("cannot read the certificate authorities in {}: {error}", file.display()))?;
    // A file without a certificate would only fail in the TLS handshake, where the message cannot name it.
    const BEGIN: &[u8] = b"-----BEGIN CERTIFICATE-----";
    if pem.windows(BEGIN.len()).any(|words| words == BEGIN) {
        return Ok(Certificate::from_pem(pem));
    }
    Err(format!("{} contains no certificate; use a PEM file", file.display()))
}

fn unreachable(address: &str, detail: String) -> Error {
    // tonic reports TLS causes only as text.
    let advice = [
        ("InvalidContentType", "the server does not use TLS; use http:// in the address"),
        ("UnknownIssuer", "unknown certificate authority; use its PEM file with --ca or AVLN_CA"),
        (
            "CaUsedAsEndEntity",
            "the server uses an authority's certificate; ask its organiser for a server certificate",
        ),
        ("not valid for name", "the certificate is for another name; use that name in the address"),
        ("Expired", "the certificate has expired; ask the organiser for a new one"),
        ("NotValidYet", "the certificate is not valid yet; check this machine's clock"),
        (
            "BadSignature",
            "no known authority signed the certificate; use its authority's PEM file with --ca or AVLN_CA",
        ),
    ];
    let address = address.to_owned();
    match advice.iter().find(|(word, _)| detail.contains(word)) {
        Some((_, advice)) => Error::Tls { address, problem: format!("{advice} ({detail})") },
        None => Error::Unreachable { address, detail },
    }
}

/// Image and sound encoding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Packing {
    /// Raw; fastest on the same machine.
    Raw,
    /// Smaller, with equal numbers; fastest across a network.
    Lossless,
    /// Depth rounded to millimetres and sound to 16 bits if the phase permits it, otherwise lossless.
    Rounded,
}

impl Packing {
    /// Returns the default for a server address.
    pub(crate) fn of_host(host: &str) -> Self {
        let address = host.trim_start_matches('[').trim_end_matches(']').parse::<std::net::IpAddr>();
        let is_here = address.map_or(host == "localhost", |address| address.is_loopback());
        if is_here { Self::Raw } else { Self::Lossless }
    }

    /// Returns the requested encodings, best first.
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

    fn problem(link: &ConnectOptions, address: &str) -> String {
        link.endpoint(address).unwrap_err().to_string()
    }

    #[test]
    fn invalid_address_error_shows_the_syntax() {
        for address in ["localhost:50051", "ftp://x", "http://", "http://a b", "unix:", "unix:relative.sock"]
        {
            let text = problem(&ConnectOptions::default(), address);
            assert!(text.contains(address) && text.contains("http://127.0.0.1:50051"), "{text}");
        }
        for address in ["http://localhost:50051", "unix:/run/arena.sock", "unix:///run/arena.sock"] {
            assert!(ConnectOptions::default().endpoint(address).is_ok(), "{address}");
        }
    }

    #[test]
    fn unusable_authority_file_error_has_path() {
        let missing = ConnectOptions { ca: Some("no-such-file.pem".into()), ..ConnectOptions::default() };
        let text = problem(&missing, "https://arena.example");
        assert!(text.contains("no-such-file.pem") && text.contains("cannot read"), "{text}");
        let wrong = ConnectOptions {
            ca: Some(concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml").into()),
            ..ConnectOptions::default()
        };
        let text = problem(&wrong, "https://arena.example");
        assert!(text.contains("Cargo.toml") && text.contains("no certificate"), "{text}");
    }

    #[test]
    fn loopback_addresses_are_local() {
        for host in ["localhost", "127.0.0.1", "127.8.0.1", "[::1]"] {
            assert_eq!(Packing::of_host(host), Packing::Raw, "{host}");
        }
        for host in ["arena.example", "10.0.0.1", "[2001:db8::1]", "localhost.example"] {
            assert_eq!(Packing::of_host(host), Packing::Lossless, "{host}");
        }
    }

    #[test]
    fn raw_is_always_requested_and_rounding_optional() {
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
