//! Detection of connections that send more than their requests need.

use std::{
    io,
    pin::Pin,
    sync::{
        Arc,
        atomic::{AtomicI64, Ordering},
    },
    task::{Context, Poll},
};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};

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
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let before = buffer.filled().len();
        let outcome = Pin::new(&mut self.inner).poll_read(context, buffer);
        self.meter.count((buffer.filled().len() - before) as i64);
        if self.meter.is_full() {
            return Poll::Ready(Err(io::Error::other("the peer sends excessive data")));
        }
        outcome
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for Metered<S> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let outcome = Pin::new(&mut self.inner).poll_write(context, bytes);
        self.wrote(outcome)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        parts: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let outcome = Pin::new(&mut self.inner).poll_write_vectored(context, parts);
        self.wrote(outcome)
    }

    fn is_write_vectored(&self) -> bool {
        self.inner.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.inner).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.inner).poll_shutdown(context)
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
