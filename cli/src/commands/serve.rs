//! `avln serve` hosts phases; `avln admin` inspects, notifies and drains a running server.

use crate::{documents, output::say};
use avln_arena::{
    Arena, Failure, SCENE_MEMORY_MIB,
    admin::{Drain, Notice, Status, ask},
    budget::{Budget, SESSION_MEMORY_MIB},
    data::DataFolder,
    servers::{Addresses, PublicUrls, RunningServers, Security, Servers},
};
use avln_grpc::Limits;
use avln_web::TrustedProxy;
use clap::{Args, Subcommand};
use serde::Serialize;
use std::{
    net::{Ipv4Addr, Ipv6Addr, SocketAddr},
    path::{Path, PathBuf},
    str::FromStr,
    sync::Arc,
    time::Duration,
};

/// Server addresses.
#[derive(Clone, Debug, Args)]
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

#[derive(Clone, Debug, Args)]
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
    servers = servers.with_public_urls(urls.clone());
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
    print_addresses(&open, urls);
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

/// Prints the public addresses, where they are known: behind a port mapping or a proxy, the local ones cannot be reached.
fn print_addresses(open: &RunningServers, urls: PublicUrls) {
    let local = |address| format!("{}://{}", open.scheme(), reachable(address));
    let admin = open.admin.filter(|_| urls.web.is_none());
    say!("agents       {}", urls.grpc.unwrap_or_else(|| local(open.grpc)));
    say!("leaderboard  {}", urls.web.unwrap_or_else(|| local(open.web)));
    if let Some(admin) = admin {
        say!("operator     http://{admin} (only on this machine, or in this container)");
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

#[derive(Debug, Subcommand)]
pub(crate) enum AdminCommand {
    /// Exit with code 0 if the server is up; needs no token
    Health(AdminAddress),
    /// Print server state and running episodes
    Status(AdminAccess),
    /// Start no more runs, let open episodes finish, then stop the server
    Drain {
        #[command(flatten)]
        server: AdminAccess,
        /// Reason, shown to agents and visitors
        #[arg(long, value_name = "TEXT")]
        reason: String,
        /// Time for open episodes
        #[arg(long, default_value_t = 10, value_name = "MINUTES")]
        minutes: u32,
    },
    /// Announce a text to agents and visitors
    Notice {
        #[command(flatten)]
        server: AdminAccess,
        /// One line of text; an empty text removes the announcement
        text: String,
    },
}

/// Admin server address.
#[derive(Clone, Debug, Args)]
pub(crate) struct AdminAddress {
    /// Admin server on the server's own machine, as HOST:PORT or URL
    #[arg(long = "admin", alias = "server", env = "AVLN_ADMIN", default_value = "127.0.0.1:50052", value_name = "ADDRESS", value_parser = admin_url)]
    url: String,
}

/// Returns the URL for an address; `serve` accepts the word `off` for the same variable.
fn admin_url(text: &str) -> Result<String, String> {
    match text {
        "off" => Err("the admin server is off; start it with: avln serve --admin 127.0.0.1:50052".to_owned()),
        url if url.contains("://") => Ok(url.to_owned()),
        address => Ok(format!("http://{address}")),
    }
}

/// Address and token for the admin server.
#[derive(Clone, Debug, Args)]
pub(crate) struct AdminAccess {
    #[command(flatten)]
    address: AdminAddress,
    /// Organiser token
    #[arg(long, env = "AVLN_TOKEN", hide_env_values = true, value_name = "TOKEN")]
    token: String,
}

pub(crate) async fn administer(command: AdminCommand) -> Result<(), Failure> {
    let status = match command {
        AdminCommand::Health(address) => return health(&address).await,
        AdminCommand::Status(server) => request(&server, "/v1/status", None::<&()>).await?,
        AdminCommand::Drain { server, reason, minutes } => {
            request(&server, "/v1/drain", Some(&Drain { reason, minutes })).await?
        }
        AdminCommand::Notice { server, text } => {
            request(&server, "/v1/notice", Some(&Notice { text })).await?
        }
    };
    show(&status);
    Ok(())
}

// The metrics page is the check: its counts come from the database, so a server that returns it can work.
async fn health(address: &AdminAddress) -> Result<(), Failure> {
    let answer = ask(&address.url, "/metrics", "", None).await?;
    if !answer.status.is_success() {
        let message = format!("the server is not healthy: it answered {}", answer.status.as_u16());
        return Err(Failure::run(message));
    }
    say!("up");
    Ok(())
}

async fn request(server: &AdminAccess, path: &str, body: Option<&impl Serialize>) -> Result<Status, Failure> {
    let internal = |error: serde_json::Error| Failure::internal(error);
    let body = body.map(serde_json::to_vec).transpose().map_err(internal)?;
    let answer = ask(&server.address.url, path, &server.token, body).await?;
    if answer.status.is_success() {
        return serde_json::from_slice(&answer.body).map_err(internal);
    }
    let words = String::from_utf8_lossy(&answer.body).into_owned();
    let error = serde_json::from_slice::<serde_json::Value>(&answer.body).ok();
    let error = error.and_then(|value| value["error"].as_str().map(str::to_owned)).unwrap_or(words);
    Err(Failure::run(format!("the server refused ({}): {error}", answer.status.as_u16())))
}

fn show(status: &Status) {
    match &status.draining {
        Some(reason) => say!("state    draining: {reason}"),
        None => say!("state    up"),
    }
    if !status.notice.is_empty() {
        say!("notice   {}", status.notice);
    }
    say!("steps    {}", status.steps);
    say!("scenes   {} MiB", status.scene_bytes >> 20);
    if status.hanging > 0 {
        say!("hanging  {} simulations; restart the server when convenient", status.hanging);
    }
    say!("playing  {} episodes", status.slots.len());
    for slot in &status.slots {
        say!("  {} slot {} step {}", slot.run, slot.slot, slot.step);
    }
}

#[cfg(test)]
mod tests {
    use super::admin_url;
    use crate::Cli;
    use clap::Parser;

    #[test]
    fn admin_addresses_become_urls() {
        let url = "http://127.0.0.1:50052";
        assert_eq!(admin_url("127.0.0.1:50052").as_deref(), Ok(url));
        assert_eq!(admin_url(url).as_deref(), Ok(url));
        let refused = admin_url("off").expect_err("nothing to ask");
        assert!(refused.starts_with("the admin server is off"), "{refused}");
    }

    #[test]
    fn admin_option_keeps_its_old_name() {
        for words in
            ["avln admin health --admin 127.0.0.1:1", "avln admin health --server http://127.0.0.1:1"]
        {
            let parsed = Cli::try_parse_from(words.split(' ')).expect("a command line");
            assert!(format!("{parsed:?}").contains("\"http://127.0.0.1:1\""), "{parsed:?}");
        }
        assert!(Cli::try_parse_from("avln admin health --admin off".split(' ')).is_err());
    }
}
