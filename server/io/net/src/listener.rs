use crate::{Identity, Stream};
use std::{io, net::SocketAddr, time::Duration};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt, copy, sink},
    net::{TcpListener, TcpStream},
    time::{error::Elapsed, timeout},
};
use tokio_rustls::TlsAcceptor;

/// What is spoken inside of TLS.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// HTTP/1.1.
    Http1,
    /// HTTP/2, for gRPC.
    Http2,
}

/// Bytes of plain text that are waited for.
const MOST_SMALL_TALK: u64 = 64 << 10;
/// First byte of every TLS connection: a handshake record.
const HANDSHAKE: u8 = 0x16;
const ADVICE: &str = "this port speaks TLS: write https:// in the address";

impl Protocol {
    /// The name by which TLS peers agree on it.
    pub(crate) fn name(self) -> &'static [u8] {
        match self {
            Self::Http1 => b"http/1.1",
            Self::Http2 => b"h2",
        }
    }

    /// What a client that speaks plain text is told: as far as it understands anything, this.
    fn farewell(self) -> Vec<u8> {
        match self {
            Self::Http1 => format!(
                "HTTP/1.1 400 Bad Request\r\ncontent-type: text/plain\r\ncontent-length: {}\r\nconnection: close\r\n\r\n{ADVICE}\n",
                ADVICE.len() + 1
            )
            .into_bytes(),
            Self::Http2 => {
                // An empty SETTINGS frame, then GOAWAY: last stream 0, INADEQUATE_SECURITY, and the advice (RFC 9113, 6.8).
                let length = (8 + ADVICE.len()) as u8;
                let head = [0, 0, 0, 4, 0, 0, 0, 0, 0, 0, 0, length, 7, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 12];
                [&head, ADVICE.as_bytes()].concat()
            }
        }
    }
}

/// A place where clients connect.
#[derive(Debug)]
pub struct Listener {
    tcp: TcpListener,
    greeter: Greeter,
}

impl From<TcpListener> for Listener {
    /// A listener that speaks plain text.
    fn from(tcp: TcpListener) -> Self {
        Self { tcp, greeter: Greeter(None) }
    }
}

impl Listener {
    /// A listener that speaks TLS where there is an identity, else plain text.
    pub fn new(tcp: TcpListener, identity: Option<&Identity>, protocol: Protocol) -> Self {
        let tls = identity.map(|identity| (identity.acceptor(protocol), protocol));
        Self { tcp, greeter: Greeter(tls) }
    }

    /// The next connection, before anything was said.
    ///
    /// # Errors
    /// When the system has none to give.
    pub async fn accept(&self) -> io::Result<(TcpStream, SocketAddr)> {
        self.tcp.accept().await
    }

    /// Whether TLS is spoken here.
    pub fn is_secure(&self) -> bool {
        self.greeter.0.is_some()
    }

    /// Who greets connections.
    pub fn greeter(&self) -> Greeter {
        self.greeter.clone()
    }
}

/// Turns connections into streams of what is spoken.
#[derive(Clone)]
pub struct Greeter(Option<(TlsAcceptor, Protocol)>);

/// Why a connection did not become a stream.
#[derive(Debug, thiserror::Error)]
pub enum Refused {
    /// It was silent for too long.
    #[error("no handshake in time")]
    Silent(#[from] Elapsed),
    /// It speaks plain text where TLS is asked for.
    #[error("plain text on a TLS port")]
    PlainText,
    /// The handshake failed.
    #[error("the handshake failed: {0}")]
    Handshake(#[from] io::Error),
}

impl Greeter {
    /// Agrees on TLS within `limit`, where this port speaks it.
    ///
    /// # Errors
    /// When the client does not.
    pub async fn greet(&self, tcp: TcpStream, limit: Duration) -> Result<Stream, Refused> {
        match &self.0 {
            None => Ok(Stream::Plain(tcp)),
            Some((acceptor, protocol)) => timeout(limit, secure(acceptor, *protocol, tcp)).await?,
        }
    }
}

async fn secure(acceptor: &TlsAcceptor, protocol: Protocol, mut tcp: TcpStream) -> Result<Stream, Refused> {
    let mut first = [0];
    let arrived = tcp.peek(&mut first).await?;
    if arrived == 1 && first[0] != HANDSHAKE {
        tcp.write_all(&protocol.farewell()).await?;
        tcp.shutdown().await?;
        // Closing on unread bytes resets the connection, and the client would lose the answer.
        copy(&mut tcp.take(MOST_SMALL_TALK), &mut sink()).await?;
        return Err(Refused::PlainText);
    }
    Ok(Stream::Secure(Box::new(acceptor.accept(tcp).await?)))
}

impl std::fmt::Debug for Greeter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Greeter").field(&self.0.as_ref().map(|(_, protocol)| protocol)).finish()
    }
}
