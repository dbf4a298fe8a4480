//! Tokens: what opens the doors, for whom and for how long.

use crate::output::say;
use avln_arena::{
    Failure, FailureKind,
    challenge::{actor, moment_of},
    data::DataFolder,
    now_unix_ms,
    office::deeds::{self, Wish, note},
};
use avln_store::{Store, TokenLine, TokenScope, calendar::rfc3339};
use clap::{Args, Subcommand};
use std::path::Path;

/// Commands about tokens.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Issue a token and print it once
    New(New),
    /// List the tokens of teams and organisers, without their secrets
    List {
        /// As JSON
        #[arg(long)]
        json: bool,
    },
    /// Take back one token
    Revoke {
        /// Id of the token, as avln challenge token list tells it
        id: String,
    },
}

/// Whose token, and what it is good for.
#[derive(Clone, Debug, Args)]
pub struct New {
    /// For a team that was admitted: starts its runs and sees its results
    #[arg(long, value_name = "TEAM", required_unless_present = "organiser")]
    pub team: Option<String>,
    /// For an organiser: sees everything
    #[arg(long, conflicts_with = "team")]
    pub organiser: bool,
    /// For looking only: sees the team's results and starts nothing
    #[arg(long, requires = "team")]
    pub read_only: bool,
    /// What to call it, so that lists tell it from others
    #[arg(long, default_value = "", value_name = "TEXT")]
    pub name: String,
    /// When it ends: a moment such as 2026-09-01T00:00:00Z, or a number of days such as 30d; never by default
    #[arg(long, value_name = "WHEN")]
    pub expires: Option<String>,
}

/// Carries out a command about tokens.
///
/// # Errors
/// When the team or the token is unknown, or the database refuses.
pub async fn run(data: &Path, command: Command) -> Result<(), Failure> {
    let store = DataFolder::open(data)?.store().await?;
    match command {
        Command::New(options) => issue(&store, &options).await,
        Command::List { json } => list(&store, json).await,
        Command::Revoke { id } => {
            let revoked = note(&actor(), format!("token {id}"), "revoked", "");
            store.revoke_token(&id, revoked, now_unix_ms()).await?;
            say!("token {id} is void now");
            Ok(())
        }
    }
}

async fn issue(store: &Store, options: &New) -> Result<(), Failure> {
    let now = now_unix_ms();
    let expires = options.expires.as_deref().map(|words| expiry(words, now)).transpose()?;
    let wish = Wish {
        kind: match (options.organiser, options.read_only) {
            (true, _) => TokenScope::Organiser,
            (false, true) => TokenScope::ReadOnly,
            (false, false) => TokenScope::Participant,
        },
        name: &options.name,
        team: options.team.as_deref(),
        expires_unix_ms: expires,
    };
    let secret = deeds::issue(store, &wish, &actor(), now).await?;
    say!("for      {}", options.team.as_deref().unwrap_or("organiser"));
    say!("token    {secret}");
    say!("expires  {}", expires.map_or_else(|| "never".to_owned(), rfc3339));
    say!("The token is shown this once.");
    Ok(())
}

/// The moment that `words` tell; it lies ahead.
fn expiry(words: &str, now_unix_ms: i64) -> Result<i64, Failure> {
    const DAY_MS: i64 = 86_400_000;
    const MOST_DAYS: u32 = 36_500;
    let days = words.strip_suffix('d').and_then(|days| days.parse::<u32>().ok());
    let found = match days {
        Some(days) => (1..=MOST_DAYS).contains(&days).then(|| now_unix_ms + i64::from(days) * DAY_MS),
        None => moment_of(words),
    };
    found.filter(|&moment| moment > now_unix_ms).ok_or_else(|| {
        Failure::new(FailureKind::Data, format!("--expires '{}' is no moment ahead", words.escape_debug()))
            .hinted("use a moment such as 2026-09-01T00:00:00Z, or days such as 30d, at most 36500d")
    })
}

async fn list(store: &Store, json: bool) -> Result<(), Failure> {
    let tokens = store.tokens().await?;
    if json {
        let text = serde_json::to_string_pretty(&tokens);
        say!("{}", text.map_err(|error| Failure::new(FailureKind::Internal, error))?);
        return Ok(());
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
