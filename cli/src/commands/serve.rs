//! `avln serve` and `avln admin`.

use crate::{documents, output::say};
use avln_arena::{
    Arena, Failure, SCENE_MEMORY_MIB,
    budget::{Budget, SESSION_MEMORY_MIB},
    data::DataFolder,
    servers::{Addresses, PublicUrls, RunningServers, Security, Servers},
};
use avln_grpc::Limits;
use avln_web::TrustedProxy;
use std::{
    net::{Ipv4Addr, Ipv6Addr, SocketAddr},
    path::{Path, PathBuf},
    str::FromStr,
    sync::Arc,
    time::Duration,
};

/// Server addresses.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct AddressArgs {
    /// Address for agents
    #[arg(long, env = "AVLN_GRPC", default_value = "127.0.0.1:50051", value_name = "ADDRESS")]
    grpc: SocketAddr,
    /// Leaderboard address
    #[arg(long, env = "AVLN_WEB", default_value = "127.0.0.1:8080", value_name = "ADDRESS")]
    web: SocketAddr,
}

impl AddressArgs {
    pub(crate) fn addresses(&self) -> Addresses {
        Addresses { grpc: self.grpc, web: self.web }
    }
}

#[derive(Clone, Debug, clap::Args)]
pub(crate) struct ServeArgs {
    #[command(flatten)]
    addresses: AddressArgs,
    /// PEM file with certificate and intermediates; agents and visitors then connect by TLS
    #[arg(long, env = "AVLN_TLS_CERT", value_name = "FILE", requires = "tls_key")]
    tls_cert: Option<PathBuf>,
    /// PEM file with the certificate's private key
    #[arg(long, env = "AVLN_TLS_KEY", value_name = "FILE", requires = "tls_cert")]
    tls_key: Option<PathBuf>,
    /// Public address of the leaderboard, such as https://arena.example: for links to runs, commands on pages
    /// and the origin of forms
    #[arg(long, env = "AVLN_WEB_URL", default_value = "", hide_default_value = true, value_name = "URL", value_parser = public_url)]
    web_url: String,
    /// Public address for agents behind a proxy, for commands on pages; without it, the host of --web-url with
    /// the port of --grpc
    #[arg(long, env = "AVLN_GRPC_URL", default_value = "", hide_default_value = true, value_name = "URL", value_parser = public_url)]
    grpc_url: String,
    /// Address or network of a reverse proxy, repeatable: X-Forwarded-For from there contains the client, for
    /// the sign-in limit
    #[arg(long, value_name = "RANGE")]
    trusted_proxy: Vec<TrustedProxy>,
    /// Admin server address on this machine, for metrics and avln admin; off to disable it
    #[arg(long, env = "AVLN_ADMIN", default_value = "127.0.0.1:50052", value_name = "ADDRESS")]
    admin: AdminListener,
    /// Memory for cached scenes in MiB; scenes in use may exceed it
    #[arg(long, value_name = "MIB", default_value_t = SCENE_MEMORY_MIB)]
    scene_memory: u32,
    /// Memory for a session's open episodes in MiB: an allowance per scene, sound and frames; more episodes wait, larger scenes
    /// are reported as server faults
    #[arg(long, value_name = "MIB", default_value_t = SESSION_MEMORY_MIB, value_parser = clap::value_parser!(u32).range(1..))]
    session_memory: u32,
    /// Time limit for a simulator step in seconds; the episode is repeated if it is exceeded
    #[arg(long, value_name = "S", default_value_t = 120, value_parser = clap::value_parser!(u32).range(1..=86400))]
    step_limit: u32,
    /// Time limit for episode preparation in seconds
    #[arg(long, value_name = "S", default_value_t = 600, value_parser = clap::value_parser!(u32).range(1..=86400))]
    preparation_limit: u32,
    /// Disk cache size for scenes and sounds in GiB; stored for all commands [default: 4]
    #[arg(long, value_name = "GIB", value_parser = clap::value_parser!(u32).range(1..=65536))]
    cache_size: Option<u32>,
}

/// The admin server address; `None` if it is off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct AdminListener(pub(crate) Option<SocketAddr>);

impl FromStr for AdminListener {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = |_| "write an address like 127.0.0.1:50052, or off".to_owned();
        match text {
            "off" => Ok(Self(None)),
            _ => text.parse().map(|address| Self(Some(address))).map_err(wrong),
        }
    }
}

/// Hosts the data folder's phases until a signal or a drain.
pub(crate) async fn run(data: &Path, args: ServeArgs) -> Result<(), Failure> {
    let data = DataFolder::open(data)?;
    // Before any change: a newer program must not migrate the database of a running server.
    let lock = data.lock()?;
    data.limit_cache(args.cache_size)?;
    let security = Security { tls_cert: args.tls_cert, tls_key: args.tls_key };
    // Before the phases are read, so that a used address fails at once.
    let mut servers = Servers::bind_as(&args.addresses.addresses(), security.identity()?).await?;
    servers = servers.with_trusted_proxies(args.trusted_proxy).with_documents(documents());
    let given = |url: String| (!url.is_empty()).then_some(url);
    let urls = PublicUrls { web: given(args.web_url), grpc: given(args.grpc_url) };
    // Links may lead to the local address, but only a given one is canonical.
    let link_url = urls.web.clone().or_else(|| servers.web_url());
    servers = servers.with_public_urls(urls);
    if let AdminListener(Some(address)) = args.admin {
        servers = servers.with_admin(address).await?;
    }
    let store = data.store().await?;
    let seconds = |s: u32| Duration::from_secs(u64::from(s));
    let (step, preparation) = (seconds(args.step_limit), seconds(args.preparation_limit));
    let servers = servers.with_limits(|limits| Limits { step, preparation, ..limits });
    let budget = Budget { session_memory_mib: args.session_memory, preparation };
    let arena = Arena::open_locked(lock, &data, store.clone(), args.scene_memory)
        .await?
        .with_budget(budget)
        .with_web_url(link_url.clone().unwrap_or_default());
    let named = |(id, episodes)| format!("{id} ({episodes} episodes)");
    let phases: Vec<_> = arena.phases().await?.into_iter().map(named).collect();
    if phases.is_empty() {
        let message = format!("data folder {} has no phase to host", data.root().display());
        return Err(Failure::data(message).hinted(
            "make one with: avln data split make NAME && avln challenge phase open ID --split NAME; in a container, before `docker compose up`: docker compose run --rm challenge-server avln …",
        ));
    }
    let memory_warnings = arena.memory_warnings().await?;
    let open = servers.open(Arc::new(arena), store.reader())?;
    say!("data         {}", data.root().display());
    say!("phases       {}", phases.join(", "));
    print_addresses(&open);
    for warning in memory_warnings {
        eprintln!("warning: {warning}");
    }
    if link_url.is_none() {
        eprintln!("warning: links to runs lack an address: set --web-url");
    }
    say!("Stop with Ctrl-C.");
    let ended = open.wait().await;
    store.close().await;
    ended
}

fn print_addresses(open: &RunningServers) {
    say!("agents       {}://{}", open.scheme(), reachable(open.grpc));
    say!("leaderboard  {}://{}", open.scheme(), reachable(open.web));
    if let Some(admin) = open.admin {
        say!("operator     http://{admin}");
    }
}

/// Returns a URL without the final slash; an empty text means none.
fn public_url(text: &str) -> Result<String, String> {
    if text.is_empty() || text.starts_with("http://") || text.starts_with("https://") {
        return Ok(text.trim_end_matches('/').to_owned());
    }
    Err("write a URL like https://arena.example".to_owned())
}

/// Returns an address for clients on this machine: servers can listen on all addresses, but clients need one.
fn reachable(mut address: SocketAddr) -> SocketAddr {
    if address.ip().is_unspecified() {
        address.set_ip(match address {
            SocketAddr::V4(_) => Ipv4Addr::LOCALHOST.into(),
            SocketAddr::V6(_) => Ipv6Addr::LOCALHOST.into(),
        });
    }
    address
}
