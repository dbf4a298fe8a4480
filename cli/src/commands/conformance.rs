//! Checks that a server or a client follows the protocol.

use crate::output::say;
use avln_arena::{Failure, FailureKind};
use avln_conformance::{Check, Host, Outcome, Site, check};
use std::{net::SocketAddr, path::PathBuf};

/// Arguments of `avln lab conformance`.
#[derive(Clone, Debug, clap::Args)]
pub struct ConformanceArgs {
    /// URL of the gRPC server: http:// or https://
    #[arg(long, env = "AVLN_SERVER", default_value = "http://127.0.0.1:50051", value_name = "URL")]
    pub server: String,
    /// PEM file of trusted certificate authorities, instead of those of the system
    #[arg(long, env = "AVLN_CA", value_name = "FILE")]
    pub ca: Option<PathBuf>,
    /// Account token
    #[arg(
        long,
        env = "AVLN_TOKEN",
        hide_env_values = true,
        value_name = "TOKEN",
        required_unless_present = "client"
    )]
    pub token: Option<String>,
    /// Phase for the test run, which plays a few steps of about ten episodes
    #[arg(long, required_unless_present = "client")]
    pub phase: Option<String>,
    /// Check a client instead: listen at this address, accept the first run with any token and phase, inject faults such as
    /// broken streams and lost replies, and report the client's reactions
    #[arg(long, value_name = "ADDRESS")]
    pub client: Option<SocketAddr>,
}

/// Runs all checks and prints their results.
///
/// # Errors
/// If the server cannot be reached or starts no run, the address is taken, or a rule is broken.
pub async fn run(args: ConformanceArgs) -> Result<(), Failure> {
    let checks = match args.client {
        Some(address) => host(address).await?,
        None => {
            let (token, phase) = (args.token.unwrap_or_default(), args.phase.unwrap_or_default());
            let ca = args.ca.map(read).transpose()?;
            let site = Site { server: &args.server, ca: ca.as_deref() };
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
            .hinted("use an address of this machine with a free port, such as --client 127.0.0.1:50052")
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
                .hinted("the rules are in proto/PROTOCOL.md"))
        }
    }
}
