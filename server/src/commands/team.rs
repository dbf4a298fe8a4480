//! Admits teams and issues tokens.

use crate::say::say;
use crate::{
    Failure, FailureKind,
    arena::{data::DataFolder, now_unix_ms, secret::new_token},
};
use avln_store::{NewToken, Store, TokenKind};
use clap::Subcommand;
use std::path::Path;

/// Commands about teams.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Admit a team, or an admitted one again, and print a new account token once
    Add {
        /// Public name of the team
        name: String,
    },
    /// Take back all tokens of a team
    Revoke {
        /// Public name of the team
        name: String,
    },
}

/// Carries out a command about teams.
///
/// # Errors
/// When the database refuses.
pub async fn run(data: &Path, command: Command) -> Result<(), Failure> {
    let store = DataFolder::open(data)?.store().await?;
    match command {
        Command::Add { name } => {
            let token = admit(&store, &name, false).await?;
            say!("team   {name}");
            say!("token  {token}");
            say!("The token is shown this once. Agents take it with --token or from AVLN_TOKEN.");
        }
        Command::Revoke { name } => {
            let count = store.revoke_tokens(&name, now_unix_ms()).await?;
            say!("{count} tokens of team {name} are void now");
        }
    }
    Ok(())
}

/// Admits a team and issues an account token.
///
/// # Errors
/// When the name cannot be used or the database refuses.
pub async fn admit(store: &Store, name: &str, baseline: bool) -> Result<String, Failure> {
    let printable = |letter: char| !letter.is_control();
    if name.trim().is_empty() || name.len() > 64 || !name.chars().all(printable) {
        return Err(Failure::new(
            FailureKind::Data,
            format!("'{}' cannot be the name of a team", name.escape_debug()),
        )
        .hinted("use 1 to 64 bytes of printable text"));
    }
    let secret = new_token("account").map_err(|error| Failure::new(FailureKind::Internal, error))?;
    store.create_team(name, baseline, now_unix_ms()).await?;
    let token = NewToken {
        secret: &secret,
        kind: TokenKind::Account,
        name: "",
        team: Some(name),
        expires_unix_ms: None,
    };
    store.issue_token(&token, now_unix_ms()).await?;
    Ok(secret)
}
