//! Toy host and test client.

mod agent;
mod attack;
mod host;
mod runner;

pub(crate) use agent::{Agent, authorised, channel, hello, play_client, reason};
pub(crate) use attack::{Attack, Siege};
pub(crate) use host::{ACCOUNT, Book, LOOKING, ORGANISER, PATIENT, Plan, RUN, RUN_TOKEN, ToyHost};
pub(crate) use runner::Quirk;

use avln_grpc::{Limits, serve};
use avln_proto::v1::run_service_client::RunServiceClient;
use std::{net::SocketAddr, sync::Arc, time::Duration};
use tokio::{net::TcpListener, sync::oneshot, task::JoinHandle, time::timeout};
use tonic::transport::Channel;

/// A gRPC server on a free port.
pub(crate) struct TestServer {
    pub(crate) host: Arc<ToyHost>,
    pub(crate) address: SocketAddr,
    stop: oneshot::Sender<()>,
    served: JoinHandle<()>,
}

impl TestServer {
    pub(crate) async fn open(plan: Plan) -> Self {
        Self::with_limits(plan, Limits::default()).await
    }

    pub(crate) async fn with_limits(plan: Plan, limits: Limits) -> Self {
        Self::with_book(plan, limits, Book::default()).await
    }

    /// Opens a server that continues the episodes of another with the same book.
    pub(crate) async fn with_book(plan: Plan, limits: Limits, book: Book) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let host = Arc::new(ToyHost::new(plan, book));
        let (stop, stopped) = oneshot::channel::<()>();
        let behind = host.clone();
        let served = tokio::spawn(async move {
            let until = async { drop(stopped.await) };
            serve(listener, behind, limits, until).await.unwrap();
        });
        Self { host, address, stop, served }
    }

    /// Returns a client for the run service.
    pub(crate) async fn runs(&self) -> RunServiceClient<Channel> {
        RunServiceClient::new(channel(self).await)
    }

    /// Stops the server.
    pub(crate) fn close(self) -> JoinHandle<()> {
        self.stop.send(()).unwrap();
        self.served
    }

    /// Returns whether a new connection is served.
    pub(crate) async fn answers(&self) -> bool {
        let endpoint = tonic::transport::Endpoint::from_shared(format!("http://{}", self.address)).unwrap();
        let Ok(channel) = endpoint.connect().await else { return false };
        let mut client = avln_proto::v1::info_service_client::InfoServiceClient::new(channel);
        client.get_server_info(avln_proto::v1::GetServerInfoRequest {}).await.is_ok()
    }

    /// Plays an episode, as proof that the server works.
    pub(crate) async fn still_serves(&self) {
        self.host.refill();
        let mut agent = Agent::enter(self, 1).await;
        let start = agent.ready(0).await;
        agent.act(0, &start.episode, 1, 5).await;
        assert!(agent.observation().await.terminated);
        agent.episode_end().await;
    }
}

/// Waits up to 20 s.
pub(crate) async fn soon<T>(future: impl Future<Output = T>) -> T {
    timeout(Duration::from_secs(20), future).await.expect("nothing happened within 20 s")
}
