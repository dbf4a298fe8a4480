//! Asks a running server what is going on, announces things, and lets it come to its end.

use crate::output::say;
use avln_arena::{
    Failure, FailureKind,
    admin::{Drain, Notice, Status, ask},
};
use clap::{Args, Subcommand};
use serde::Serialize;

/// Commands to a running server.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Tell by the exit code whether the server is up; needs no token
    Health(Door),
    /// Tell what is being played
    Status(Server),
    /// Begin nothing new, give open episodes time to end, then stop
    Drain {
        /// Where the server is
        #[command(flatten)]
        server: Server,
        /// Why, for agents and people
        #[arg(long, value_name = "TEXT")]
        reason: String,
        /// For how long open episodes may go on
        #[arg(long, default_value_t = 10, value_name = "MINUTES")]
        minutes: u32,
    },
    /// Announce something to agents and people
    Notice {
        /// Where the server is
        #[command(flatten)]
        server: Server,
        /// The text, on one line; an empty one takes the last back
        text: String,
    },
}

/// Where the server is.
#[derive(Clone, Debug, Args)]
pub struct Door {
    /// Address of the operator's door, which is on the server's own machine
    #[arg(long, default_value = "http://127.0.0.1:50052", value_name = "URL")]
    pub server: String,
}

/// Where the server is, and who asks.
#[derive(Clone, Debug, Args)]
pub struct Server {
    /// Where it is
    #[command(flatten)]
    pub door: Door,
    /// Token of an organiser
    #[arg(long, env = "AVLN_TOKEN", hide_env_values = true, value_name = "TOKEN")]
    pub token: String,
}

/// Carries out a command.
///
/// # Errors
/// When the server does not answer or refuses.
pub async fn run(command: Command) -> Result<(), Failure> {
    let status = match command {
        Command::Health(door) => return health(&door).await,
        Command::Status(server) => request(&server, "/v1/status", None::<&()>).await?,
        Command::Drain { server, reason, minutes } => {
            request(&server, "/v1/drain", Some(&Drain { reason, minutes })).await?
        }
        Command::Notice { server, text } => request(&server, "/v1/notice", Some(&Notice { text })).await?,
    };
    show(&status);
    Ok(())
}

/// The metrics are counted in the database, so that a server that answers with them can do its work.
async fn health(door: &Door) -> Result<(), Failure> {
    let answer = ask(&door.server, "/metrics", "", None).await?;
    if !answer.status.is_success() {
        let message = format!("the server is not well: it answered {}", answer.status.as_u16());
        return Err(Failure::new(FailureKind::Run, message));
    }
    say!("up");
    Ok(())
}

async fn request(server: &Server, path: &str, body: Option<&impl Serialize>) -> Result<Status, Failure> {
    let internal = |error: serde_json::Error| Failure::new(FailureKind::Internal, error);
    let body = body.map(serde_json::to_vec).transpose().map_err(internal)?;
    let answer = ask(&server.door.server, path, &server.token, body).await?;
    if answer.status.is_success() {
        return serde_json::from_slice(&answer.body).map_err(internal);
    }
    let words = String::from_utf8_lossy(&answer.body).into_owned();
    let error = serde_json::from_slice::<serde_json::Value>(&answer.body).ok();
    let error = error.and_then(|value| value["error"].as_str().map(str::to_owned)).unwrap_or(words);
    Err(Failure::new(FailureKind::Run, format!("the server refused ({}): {error}", answer.status.as_u16())))
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
        say!("hanging  {} simulations; start the server again when it suits", status.hanging);
    }
    say!("playing  {} episodes", status.slots.len());
    for slot in &status.slots {
        say!("  {} slot {} step {}", slot.run, slot.slot, slot.step);
    }
}
