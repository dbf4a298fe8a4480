//! How much a connection says beyond what it is answered.

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

/// Bytes that came on a connection less those that went, and less what its calls may cost: agents say little and are answered at
/// length. A flood of heads, frames or pings that lead to no call shows.
#[derive(Debug)]
pub(crate) struct Meter {
    excess: AtomicI64,
    limit: i64,
}

impl Meter {
    pub(crate) fn new(limit: i64) -> Arc<Self> {
        Arc::new(Self { excess: AtomicI64::new(0), limit })
    }

    /// Whether more came than may.
    pub(crate) fn is_full(&self) -> bool {
        self.exceeds(self.limit)
    }

    /// Whether so many bytes more came than were answered or allowed.
    pub(crate) fn exceeds(&self, bytes: i64) -> bool {
        self.excess.load(Ordering::Relaxed) > bytes
    }

    /// Allows as many bytes more. What is not used up to the limit is forgotten.
    pub(crate) fn allow(&self, bytes: usize) {
        self.count(-i64::try_from(bytes).unwrap_or(i64::MAX));
    }

    fn count(&self, bytes: i64) {
        let sum = self.excess.load(Ordering::Relaxed).saturating_add(bytes);
        self.excess.store(sum.max(-self.limit), Ordering::Relaxed);
    }
}

/// A connection whose bytes are counted; it fails when the meter is full.
#[derive(Debug)]
pub(crate) struct Metered<S> {
    inner: S,
    meter: Arc<Meter>,
}

impl<S> Metered<S> {
    pub(crate) fn new(inner: S, meter: Arc<Meter>) -> Self {
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
            return Poll::Ready(Err(io::Error::other("the peer says far more than its calls can mean")));
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
    async fn what_is_answered_or_allowed_does_not_count() {
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
        assert!(meter.is_full() && error.to_string().contains("far more"), "{error}");
    }

    #[test]
    fn credit_is_not_saved_up() {
        let meter = Meter::new(1000);
        meter.allow(1 << 30);
        meter.count(1999);
        assert!(!meter.is_full());
        meter.count(2);
        assert!(meter.is_full());
    }
}
