//! Tokens of teams and organisers.

use crate::output::{print_json, say};
use avln_arena::{
    Failure, FailureKind,
    actions::{self, TokenRequest, note},
    challenge::{actor, moment_of},
    data::DataFolder,
    now_unix_ms,
};
use avln_store::{Store, TokenLine, TokenScope, calendar::rfc3339};
use clap::{Args, Subcommand};
use std::path::Path;

/// Commands on tokens.
#[derive(Debug, Subcommand)]
pub enum TokenCommand {
    /// Issue a token and print it, once
    New(NewTokenArgs),
    /// List all tokens, without their secrets
    List {
        /// Print JSON
        /// Reason, for the audit list
        #[arg(long)]
        json: bool,
    },
    /// Revoke a token
    Revoke {
        /// Id of the token, from avln challenge token list
        id: String,
    },
}

/// Arguments of `new`.
#[derive(Clone, Debug, Args)]
pub struct NewTokenArgs {
    /// Account token of this team: starts runs and reads the team's results
    #[arg(long, value_name = "TEAM", required_unless_present = "organiser")]
    pub team: Option<String>,
    /// Organiser token: full access
    #[arg(long, conflicts_with = "team")]
    pub organiser: bool,
    /// Read-only token: reads the team's results, starts no runs
    #[arg(long, requires = "team")]
    pub read_only: bool,
    /// Name of the token in lists
    #[arg(long, default_value = "", value_name = "TEXT")]
    pub name: String,
    /// Expiry: a time such as 2026-09-01T00:00:00Z, or a number of days such as 30d; never by default
    #[arg(long, value_name = "WHEN")]
    pub expires: Option<String>,
}

/// Runs a command on tokens.
///
/// # Errors
/// If the team or the token is unknown, or the database fails.
pub async fn run(data: &Path, command: TokenCommand) -> Result<(), Failure> {
    let store = DataFolder::open(data)?.store().await?;
    match command {
        TokenCommand::New(args) => issue(&store, &args).await,
        TokenCommand::List { json } => list(&store, json).await,
        TokenCommand::Revoke { id } => {
            let revoked = note(&actor(), format!("token {id}"), "revoked", "");
            store.revoke_token(&id, revoked, now_unix_ms()).await?;
            say!("token {id} is revoked");
            Ok(())
        }
    }
}

async fn issue(store: &Store, args: &NewTokenArgs) -> Result<(), Failure> {
    let now = now_unix_ms();
    let expires = args.expires.as_deref().map(|words| expiry(words, now)).transpose()?;
    let wish = TokenRequest {
        kind: match (args.organiser, args.read_only) {
            (true, _) => TokenScope::Organiser,
            (false, true) => TokenScope::ReadOnly,
            (false, false) => TokenScope::Participant,
        },
        name: &args.name,
        team: args.team.as_deref(),
        expires_unix_ms: expires,
    };
    let secret = actions::issue(store, &wish, &actor(), now).await?;
    say!("for      {}", args.team.as_deref().unwrap_or("organiser"));
    say!("token    {secret}");
    say!("expires  {}", expires.map_or_else(|| "never".to_owned(), rfc3339));
    say!("The token is shown only once.");
    Ok(())
}

/// Parses an expiry time, which must be in the future; Unix milliseconds.
fn expiry(words: &str, now_unix_ms: i64) -> Result<i64, Failure> {
    const DAY_MS: i64 = 86_400_000;
    const MOST_DAYS: u32 = 36_500;
    let days = words.strip_suffix('d').and_then(|days| days.parse::<u32>().ok());
    let found = match days {
        Some(days) => (1..=MOST_DAYS).contains(&days).then(|| now_unix_ms + i64::from(days) * DAY_MS),
        None => moment_of(words),
    };
    found.filter(|&moment| moment > now_unix_ms).ok_or_else(|| {
        Failure::new(FailureKind::Data, format!("--expires '{}' is not a future time", words.escape_debug()))
            .hinted("use a time such as 2026-09-01T00:00:00Z, or days such as 30d, at most 36500d")
    })
}

async fn list(store: &Store, json: bool) -> Result<(), Failure> {
    let tokens = store.tokens().await?;
    if json {
        return print_json(&tokens);
    }
    for token in tokens {
        let TokenLine { id, kind, name, team, created_ms, expires_ms, revoked_ms } = token;
        let whose = team.unwrap_or_else(|| "-".to_owned());
        let end = match (revoked_ms, expires_ms) {
            (Some(moment), _) => format!("revoked {}", rfc3339(moment)),
            (None, Some(moment)) => format!("expires {}", rfc3339(moment)),
            (None, None) => "never expires".to_owned(),
        };
        say!("{id}  {kind:<9}  {}  {end}  {whose}  {name}", rfc3339(created_ms));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_end_at_moments_that_lie_ahead() {
        let now = 1_000;
        assert_eq!(expiry("2d", now).ok(), Some(now + 172_800_000));
        assert_eq!(expiry("1970-01-01T00:00:02Z", now).ok(), Some(2_000));
        for wrong in ["0d", "36501d", "-1d", "soon", "1970-01-01T00:00:00Z", "2026-09-01", "d"] {
            assert!(expiry(wrong, now).is_err(), "{wrong}");
        }
    }
}
