//! Checks whether a server keeps the protocol.

use crate::say::say;
use crate::{Failure, FailureKind};
use avln_conformance::{Outcome, check};

/// Which server to check.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// Address of its gRPC port
    #[arg(long, env = "AVLN_SERVER", default_value = "http://127.0.0.1:50051", value_name = "URL")]
    pub server: String,
    /// Token of an account there
    #[arg(long, env = "AVLN_TOKEN", hide_env_values = true, value_name = "TOKEN")]
    pub token: String,
    /// Phase in which a run is begun for the checks; it plays about ten episodes, some steps each
    #[arg(long)]
    pub phase: String,
}

/// Makes all checks and prints what came of each.
///
/// # Errors
/// When the server cannot be reached, begins no run, or breaks a rule.
pub async fn run(options: Options) -> Result<(), Failure> {
    let checks = check(&options.server, &options.token, &options.phase).await;
    let checks = checks.map_err(|trouble| Failure::new(FailureKind::Run, trouble))?;
    let mut broken = 0;
    for check in &checks {
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
