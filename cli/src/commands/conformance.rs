//! Checks whether a server or a client keeps the protocol.

use crate::output::say;
use avln_arena::{Failure, FailureKind};
use avln_conformance::{Check, Host, Outcome, Site, check};
use std::{net::SocketAddr, path::PathBuf};

/// Which server to check, or where a client comes to be checked.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// Address of its gRPC port: http:// or https://
    #[arg(long, env = "AVLN_SERVER", default_value = "http://127.0.0.1:50051", value_name = "URL")]
    pub server: String,
    /// PEM file of the authorities that an https server's certificate may come from, instead of those of the system
    #[arg(long, env = "AVLN_CA", value_name = "FILE")]
    pub ca: Option<PathBuf>,
    /// Token of an account there
    #[arg(
        long,
        env = "AVLN_TOKEN",
        hide_env_values = true,
        value_name = "TOKEN",
        required_unless_present = "client"
    )]
    pub token: Option<String>,
    /// Phase in which a run is begun for the checks; it plays about ten episodes, some steps each
    #[arg(long, required_unless_present = "client")]
    pub phase: Option<String>,
    /// Check a client instead: listen here, take the first run that comes with any token in any phase, break streams, lose
    /// answers and more, and tell what the client made of it
    #[arg(long, value_name = "ADDRESS")]
    pub client: Option<SocketAddr>,
}

/// Makes all checks and prints what came of each.
///
/// # Errors
/// When the server cannot be reached, begins no run, or breaks a rule; when the address is taken or the client breaks one.
pub async fn run(options: Options) -> Result<(), Failure> {
    let checks = match options.client {
        Some(address) => host(address).await?,
        None => {
            let (token, phase) = (options.token.unwrap_or_default(), options.phase.unwrap_or_default());
            let ca = options.ca.map(read).transpose()?;
            let site = Site { server: &options.server, ca: ca.as_deref() };
            let checks = check(&site, &token, &phase).await;
            checks.map_err(|trouble| Failure::new(FailureKind::Run, trouble))?
        }
    };
    show(&checks)
}

fn read(file: PathBuf) -> Result<String, Failure> {
    std::fs::read_to_string(&file).map_err(|error| {
        let message = format!("cannot read the authorities in {}: {error}", file.display());
        Failure::new(FailureKind::Run, message).hinted("--ca takes a PEM file")
    })
}

async fn host(address: SocketAddr) -> Result<Vec<Check>, Failure> {
    let host = Host::bind(address).await.map_err(|error| {
        Failure::new(FailureKind::Address, format!("cannot listen at {address}: {error}"))
            .hinted("--client takes an address of this machine with a free port, like 127.0.0.1:50052")
    })?;
    say!("waiting for a client at http://{}", host.address);
    Ok(host.check().await)
}

fn show(checks: &[Check]) -> Result<(), Failure> {
    let mut broken = 0;
    for check in checks {
        match &check.outcome {
            Outcome::Kept => say!("kept         {}", check.rule),
            Outcome::NotOffered => say!("not offered  {}", check.rule),
            Outcome::Broken(what) => {
                broken += 1;
                say!("BROKEN       {}: {what}", check.rule);
            }
        }
    }
    match broken {
        0 => {
            say!("{} rules checked, none broken", checks.len());
            Ok(())
        }
        broken => {
            Err(Failure::new(FailureKind::Run, format!("{broken} of {} rules are broken", checks.len()))
                .hinted("proto/PROTOCOL.md tells each of them"))
        }
    }
}
