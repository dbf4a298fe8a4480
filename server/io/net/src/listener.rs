//! Listeners, TLS handshakes and byte streams.

use crate::Identity;
use std::{
    io,
    net::SocketAddr,
    pin::Pin,
    task::{Context, Poll},
    time::Duration,
};
use tokio::{
    io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, ReadBuf, copy, sink},
    net::{TcpListener, TcpStream},
    time::{error::Elapsed, timeout},
};
use tokio_rustls::{TlsAcceptor, server::TlsStream};

/// Application protocol inside TLS.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// HTTP/1.1.
    Http1,
    /// HTTP/2, for gRPC.
    Http2,
}

/// Bytes of plain text that are read before the connection closes.
const MAX_PLAIN_TEXT: u64 = 64 << 10;
/// First byte of a TLS connection: the handshake record type.
const HANDSHAKE: u8 = 0x16;
const ADVICE: &str = "this port uses TLS: write https:// in the address";

impl Protocol {
    /// Returns the ALPN name.
    pub(crate) fn name(self) -> &'static [u8] {
        match self {
            Self::Http1 => b"http/1.1",
            Self::Http2 => b"h2",
        }
    }

    /// Returns the answer to plain text, in the client's protocol.
    fn plain_text_answer(self) -> Vec<u8> {
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

/// A TCP listener, with or without TLS.
#[derive(Debug)]
pub struct Listener {
    tcp: TcpListener,
    handshaker: Handshaker,
}

impl From<TcpListener> for Listener {
    /// Creates a listener without TLS.
    fn from(tcp: TcpListener) -> Self {
        Self { tcp, handshaker: Handshaker(None) }
    }
}

impl Listener {
    /// Creates a listener that uses TLS if there is an identity.
    pub fn new(tcp: TcpListener, identity: Option<&Identity>, protocol: Protocol) -> Self {
        let tls = identity.map(|identity| (identity.acceptor(protocol), protocol));
        Self { tcp, handshaker: Handshaker(tls) }
    }

    /// Accepts a connection, before the handshake.
    ///
    /// # Errors
    /// If the system cannot provide a connection.
    pub async fn accept(&self) -> io::Result<(TcpStream, SocketAddr)> {
        self.tcp.accept().await
    }

    /// Returns whether the listener uses TLS.
    pub fn is_secure(&self) -> bool {
        self.handshaker.0.is_some()
    }

    /// Returns the handshaker for accepted connections.
    pub fn handshaker(&self) -> Handshaker {
        self.handshaker.clone()
    }
}

/// Performs TLS handshakes.
#[derive(Clone)]
pub struct Handshaker(Option<(TlsAcceptor, Protocol)>);

/// Handshake error.
#[derive(Debug, thiserror::Error)]
pub enum HandshakeError {
    /// The client was silent for too long.
    #[error("no handshake in time")]
    Silent(#[from] Elapsed),
    /// The client sent plain text to a TLS port.
    #[error("plain text on a TLS port")]
    PlainText,
    /// The TLS handshake failed.
    #[error("the handshake failed: {0}")]
    Handshake(#[from] io::Error),
}

impl Handshaker {
    /// Performs the TLS handshake within `limit`. Without TLS it returns at once.
    ///
    /// # Errors
    /// If the client does not complete the handshake.
    pub async fn handshake(&self, tcp: TcpStream, limit: Duration) -> Result<Stream, HandshakeError> {
        match &self.0 {
            None => Ok(Stream::Plain(tcp)),
            Some((acceptor, protocol)) => timeout(limit, secure(acceptor, *protocol, tcp)).await?,
        }
    }
}

async fn secure(
    acceptor: &TlsAcceptor,
    protocol: Protocol,
    mut tcp: TcpStream,
) -> Result<Stream, HandshakeError> {
    let mut first = [0];
    let arrived = tcp.peek(&mut first).await?;
    if arrived == 1 && first[0] != HANDSHAKE {
        tcp.write_all(&protocol.plain_text_answer()).await?;
        tcp.shutdown().await?;
        // Closing with unread bytes resets the connection, and the client would lose the answer.
        copy(&mut tcp.take(MAX_PLAIN_TEXT), &mut sink()).await?;
        return Err(HandshakeError::PlainText);
    }
    Ok(Stream::Secure(Box::new(acceptor.accept(tcp).await?)))
}

impl std::fmt::Debug for Handshaker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Handshaker").field(&self.0.as_ref().map(|(_, protocol)| protocol)).finish()
    }
}

/// A connection's byte stream.
#[derive(Debug)]
pub enum Stream {
    /// Plain text.
    Plain(TcpStream),
    /// TLS.
    Secure(Box<TlsStream<TcpStream>>),
}

/// Forwards a method call to the variant.
macro_rules! to_either {
    ($stream:expr, $method:ident $(, $argument:expr)*) => {
        match $stream.get_mut() {
            Stream::Plain(stream) => Pin::new(stream).$method($($argument),*),
            Stream::Secure(stream) => Pin::new(stream.as_mut()).$method($($argument),*),
        }
    };
}

impl AsyncRead for Stream {
    fn poll_read(self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        to_either!(self, poll_read, cx, buf)
    }
}

impl AsyncWrite for Stream {
    fn poll_write(self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &[u8]) -> Poll<io::Result<usize>> {
        to_either!(self, poll_write, cx, buf)
    }

    fn poll_flush(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        to_either!(self, poll_flush, cx)
    }

    fn poll_shutdown(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        to_either!(self, poll_shutdown, cx)
    }

    fn poll_write_vectored(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bufs: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        to_either!(self, poll_write_vectored, cx, bufs)
    }

    fn is_write_vectored(&self) -> bool {
        match self {
            Self::Plain(stream) => stream.is_write_vectored(),
            Self::Secure(stream) => stream.is_write_vectored(),
        }
    }
}
