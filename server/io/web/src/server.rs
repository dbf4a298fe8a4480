//! HTTP server: accept loop, connection limits, client addresses behind trusted proxies, and graceful shutdown.

use crate::{Site, router_until};
use avln_net::{AcceptLimits, AcceptLoop, Connection, Listener};
use avln_store::Reader;
use axum::{
    Router,
    http::{HeaderMap, Request},
};
use hyper::{body::Incoming, server::conn::http1};
use hyper_util::{
    rt::{TokioIo, TokioTimer},
    service::TowerToHyperService,
};
use ipnet::IpNet;
use std::{
    future::Future,
    io,
    net::{IpAddr, Ipv6Addr},
    pin::pin,
    str::FromStr,
    sync::Arc,
    time::Duration,
};
use tokio::{
    sync::watch,
    time::{sleep, timeout},
};
use tower::ServiceExt;

/// The listener failed permanently.
#[derive(Debug, thiserror::Error)]
#[error("the web server cannot accept connections, {ACCEPT_ATTEMPTS} attempts failed in a row: {0}")]
pub struct WebError(#[from] io::Error);

// Open connections; further clients wait in the system's queue.
pub(crate) const MAX_CONNECTIONS: usize = 256;
/// Time-out for TLS handshakes, request heads and idle connections.
const HEADER_TIMEOUT: Duration = Duration::from_secs(10);
// Connection lifetime. The client then reconnects, so slow clients cannot occupy all connections.
const CONNECTION_LIFETIME: Duration = Duration::from_secs(60);
/// Time-out for the response in progress when a connection closes.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_secs(10);
const MAX_HEAD_BYTES: usize = 16 * 1024;
/// Consecutive failures of `accept` before the server stops.
const ACCEPT_ATTEMPTS: u32 = 100;
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// Marks a response with a streamed body, which is neither cached nor tagged.
#[derive(Clone, Copy)]
pub(crate) struct Streaming;

/// Serves the web application on `listener` (plain text or TLS) until `shutdown` completes, then finishes the responses in
/// progress. Fails if the listener fails permanently.
pub async fn serve(
    listener: impl Into<Listener>,
    reader: Reader,
    site: Site,
    shutdown: impl Future<Output = ()> + Send + 'static,
) -> Result<(), WebError> {
    let listener = listener.into();
    let (closing, closed) = watch::channel(());
    let proxies = site.trusted_proxies.clone();
    let router = router_until(reader, site, listener.is_secure(), Some(closed));
    let shutdown = async move {
        shutdown.await;
        // Event streams end now; otherwise each would use up the whole shutdown time-out.
        drop(closing);
    };
    serve_connections(listener, router, proxies, shutdown).await
}

/// Serves `router` with the same connection limits as [`serve`]. Fails if the listener fails permanently.
pub async fn serve_router(
    listener: impl Into<Listener>,
    router: Router,
    shutdown: impl Future<Output = ()> + Send + 'static,
) -> Result<(), WebError> {
    serve_connections(listener.into(), router, Vec::new(), shutdown).await
}

async fn serve_connections(
    listener: Listener,
    router: Router,
    proxies: Vec<TrustedProxy>,
    shutdown: impl Future<Output = ()>,
) -> Result<(), WebError> {
    let proxies: Arc<[TrustedProxy]> = proxies.into();
    let limits = AcceptLimits {
        max_connections: MAX_CONNECTIONS,
        max_connections_per_address: MAX_CONNECTIONS,
        // A proxy forwards the connections of all visitors from its own address.
        shares_by_address: proxies.is_empty(),
        // Browsers open several connections at once and show a refused one as an error page.
        waits_when_full: true,
        handshake: HEADER_TIMEOUT,
        failure_pause: ACCEPT_PAUSE,
        max_failures: Some(ACCEPT_ATTEMPTS),
    };
    let mut accept = AcceptLoop::new(listener, limits);
    let serve = move |connection| serve_connection(connection, router.clone(), proxies.clone());
    let accepted = tokio::select! {
        failed = accept.run(serve) => Err(failed.into()),
        () = shutdown => Ok(()),
    };
    accept.stop_listening().close().await;
    accepted
}

/// Serves requests until the client disconnects, the connection's lifetime ends or the server shuts down.
async fn serve_connection(connection: Connection, router: Router, proxies: Arc<[TrustedProxy]>) {
    let Connection { stream, peer, mut closing, permit: _permit, .. } = connection;
    let mut builder = http1::Builder::new();
    builder.timer(TokioTimer::new()).header_read_timeout(HEADER_TIMEOUT).max_header_size(MAX_HEAD_BYTES);
    let add_client_address = move |mut request: Request<Incoming>| {
        let client = client_address(peer.ip(), request.headers(), &proxies);
        request.extensions_mut().insert(ClientAddress::new(client));
        request
    };
    let router = ServiceExt::<Request<Incoming>>::map_request(router, add_client_address);
    let connection = builder.serve_connection(TokioIo::new(stream), TowerToHyperService::new(router));
    let mut connection = pin!(connection);
    let ended = tokio::select! {
        ended = connection.as_mut() => Some(ended),
        () = closing.wait() => None,
        () = sleep(CONNECTION_LIFETIME) => None,
    };
    if ended.is_none() {
        connection.as_mut().graceful_shutdown();
        // A client too slow for the last response loses the rest.
        let _ = timeout(SHUTDOWN_TIMEOUT, connection).await;
    }
}

const FORWARDED_FOR: &str = "x-forwarded-for";

/// An address or network with trusted reverse proxies, such as `127.0.0.1` or `10.0.0.0/8`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TrustedProxy(IpNet);

/// The text is neither an address nor a network.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("'{0}' is neither an IP address nor a network; examples: 127.0.0.1, 10.0.0.0/8")]
pub struct ProxyRangeError(String);

impl FromStr for TrustedProxy {
    type Err = ProxyRangeError;

    fn from_str(text: &str) -> Result<Self, ProxyRangeError> {
        let address = || text.parse::<IpAddr>().map(|address| IpNet::from(address.to_canonical()));
        text.parse().or_else(|_| address()).map(Self).map_err(|_| ProxyRangeError(text.to_owned()))
    }
}

/// A request's origin for rate limits: an IPv4 address or an IPv6 /64 network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct ClientAddress(IpAddr);

impl ClientAddress {
    pub(crate) fn new(address: IpAddr) -> Self {
        match address.to_canonical() {
            // One customer usually owns a whole /64 and can choose any address in it.
            IpAddr::V6(address) => {
                let network = u128::from(address) >> 64 << 64;
                Self(IpAddr::V6(Ipv6Addr::from(network)))
            }
            v4 => Self(v4),
        }
    }
}

/// Returns the TCP peer, or behind a trusted proxy the last address in `X-Forwarded-For` that is not a trusted proxy.
pub(crate) fn client_address(peer: IpAddr, headers: &HeaderMap, trusted: &[TrustedProxy]) -> IpAddr {
    let is_trusted = |address: IpAddr| trusted.iter().any(|TrustedProxy(range)| range.contains(&address));
    let peer = peer.to_canonical();
    if !is_trusted(peer) {
        return peer;
    }
    let values: Vec<&str> =
        headers.get_all(FORWARDED_FOR).iter().filter_map(|value| value.to_str().ok()).collect();
    let mut client = peer;
    // Each proxy appends the address of the peer. Entries left of the first untrusted address are the client's claims.
    for entry in values.iter().rev().flat_map(|value| value.rsplit(',')) {
        let Ok(address) = entry.trim().parse::<IpAddr>() else { break };
        client = address.to_canonical();
        if !is_trusted(client) {
            break;
        }
    }
    client
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderValue;

    fn client(peer: &str, forwarded: &[&'static str]) -> String {
        let trusted = ["127.0.0.1", "10.0.0.0/8", "::1"].map(|range| range.parse().expect("a range"));
        let mut headers = HeaderMap::new();
        for value in forwarded {
            headers.append(FORWARDED_FOR, HeaderValue::from_static(value));
        }
        client_address(peer.parse().expect("an address"), &headers, &trusted).to_string()
    }

    #[test]
    fn only_trusted_peers_name_the_client() {
        assert_eq!(client("192.0.2.1", &["198.51.100.7"]), "192.0.2.1");
        assert_eq!(client("127.0.0.1", &["198.51.100.7"]), "198.51.100.7");
        assert_eq!(client("::ffff:127.0.0.1", &["198.51.100.7"]), "198.51.100.7");
        assert_eq!(client("127.0.0.1", &[]), "127.0.0.1");
    }

    #[test]
    fn the_last_untrusted_entry_is_the_client() {
        assert_eq!(client("127.0.0.1", &["203.0.113.9, 198.51.100.7, 10.1.2.3"]), "198.51.100.7");
        assert_eq!(client("127.0.0.1", &["203.0.113.9", "198.51.100.7"]), "198.51.100.7");
        assert_eq!(client("127.0.0.1", &["198.51.100.7, unknown"]), "127.0.0.1");
        assert_eq!(client("10.0.0.1", &["2001:db8::7"]), "2001:db8::7");
    }

    #[test]
    fn ranges_are_addresses_or_networks() {
        for range in ["127.0.0.1", "10.0.0.0/8", "::1", "2001:db8::/32"] {
            range.parse::<TrustedProxy>().expect(range);
        }
        for wrong in ["", "localhost", "10.0.0.0/33", "10.0.0"] {
            wrong.parse::<TrustedProxy>().expect_err(wrong);
        }
    }
}
