//! Listeners, TLS handshakes, byte streams, and detection of clients that send more than their requests need.

use crate::identity::Identity;
use std::{
    io,
    net::SocketAddr,
    pin::Pin,
    sync::{
        Arc,
        atomic::{AtomicI64, Ordering},
    },
    task::{Context, Poll},
    time::Duration,
};
use tokio::{
    io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, ReadBuf, copy, sink},
    net::{TcpListener, TcpStream},
    time::{error::Elapsed, timeout},
};
use tokio_rustls::{TlsAcceptor, server::TlsStream};
use tokio_util::either::Either;

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
        let tls = identity.map(|identity| (identity.acceptor(protocol.name()), protocol));
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
            None => Ok(Either::Left(tcp)),
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
    Ok(Either::Right(Box::new(acceptor.accept(tcp).await?)))
}

impl std::fmt::Debug for Handshaker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Handshaker").field(&self.0.as_ref().map(|(_, protocol)| protocol)).finish()
    }
}

/// A connection's byte stream: plain text or TLS.
pub type Stream = Either<TcpStream, Box<TlsStream<TcpStream>>>;

/// Received bytes, minus sent bytes and an allowance per request.
///
/// Clients send little and receive much, so a flood of headers, frames or pings without requests makes the excess grow.
#[derive(Debug)]
pub struct Meter {
    excess: AtomicI64,
    limit: i64,
}

impl Meter {
    /// Creates a meter with a limit for the excess, bytes.
    pub fn new(limit: i64) -> Arc<Self> {
        Arc::new(Self { excess: AtomicI64::new(0), limit })
    }

    /// Returns whether the excess is above the limit.
    pub fn is_full(&self) -> bool {
        self.exceeds(self.limit)
    }

    /// Returns whether the excess is above `bytes`.
    pub fn exceeds(&self, bytes: i64) -> bool {
        self.excess.load(Ordering::Relaxed) > bytes
    }

    /// Adds to the allowance, bytes.
    pub fn allow(&self, bytes: usize) {
        self.count(-i64::try_from(bytes).unwrap_or(i64::MAX));
    }

    fn count(&self, bytes: i64) {
        let sum = self.excess.load(Ordering::Relaxed).saturating_add(bytes);
        // Bounded: an honest connection must not save credit for a later flood.
        self.excess.store(sum.max(-self.limit), Ordering::Relaxed);
    }
}

/// A stream with a meter, which fails when the excess is above the limit.
#[derive(Debug)]
pub struct Metered<S> {
    inner: S,
    meter: Arc<Meter>,
}

impl<S> Metered<S> {
    /// Attaches a meter to a stream.
    pub fn new(inner: S, meter: Arc<Meter>) -> Self {
        Self { inner, meter }
    }

    fn wrote(&self, outcome: Poll<io::Result<usize>>) -> Poll<io::Result<usize>> {
        if let Poll::Ready(Ok(bytes)) = outcome {
            self.meter.allow(bytes);
        }
        outcome
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for Metered<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buf: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let before = buf.filled().len();
        let outcome = Pin::new(&mut self.inner).poll_read(cx, buf);
        self.meter.count((buf.filled().len() - before) as i64);
        if self.meter.is_full() {
            return Poll::Ready(Err(io::Error::other("the peer sends excessive data")));
        }
        outcome
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for Metered<S> {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let outcome = Pin::new(&mut self.inner).poll_write(cx, bytes);
        self.wrote(outcome)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        parts: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let outcome = Pin::new(&mut self.inner).poll_write_vectored(cx, parts);
        self.wrote(outcome)
    }

    fn is_write_vectored(&self) -> bool {
        self.inner.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.inner).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.inner).poll_shutdown(cx)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio::io::{AsyncReadExt, AsyncWriteExt, duplex};

    #[tokio::test]
    async fn answered_and_allowed_bytes_do_not_count() {
        let (mut peer, server) = duplex(1 << 16);
        let meter = Meter::new(1000);
        let mut server = Metered::new(server, meter.clone());
        let mut buffer = [0; 900];
        for _ in 0..5 {
            peer.write_all(&[1; 900]).await.unwrap();
            server.read_exact(&mut buffer).await.unwrap();
            server.write_all(&[2; 600]).await.unwrap();
            meter.allow(300);
        }
        assert!(!meter.is_full());
        peer.write_all(&[1; 900]).await.unwrap();
        server.read_exact(&mut buffer).await.unwrap();
        peer.write_all(&[1; 900]).await.unwrap();
        let error = server.read_exact(&mut buffer).await.unwrap_err();
        assert!(meter.is_full() && error.to_string().contains("excessive"), "{error}");
    }

    #[test]
    fn credit_is_bounded() {
        let meter = Meter::new(1000);
        meter.allow(1 << 30);
        meter.count(1999);
        assert!(!meter.is_full());
        meter.count(2);
        assert!(meter.is_full());
    }
}
