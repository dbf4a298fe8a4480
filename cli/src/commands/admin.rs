//! Inspects, notifies and drains a running server.

use crate::output::say;
use avln_arena::{
    Failure,
    admin::{Drain, Notice, Status, ask},
};
use clap::{Args, Subcommand};
use serde::Serialize;

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
    /// Admin server URL, on the server's own machine
    #[arg(long, default_value = "http://127.0.0.1:50052", value_name = "URL")]
    server: String,
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

pub(crate) async fn run(command: AdminCommand) -> Result<(), Failure> {
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
    let answer = ask(&address.server, "/metrics", "", None).await?;
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
    let answer = ask(&server.address.server, path, &server.token, body).await?;
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
