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
