//! Teams, members, grants and tokens.

use crate::output::{print_json, say};
use avln_arena::{
    Failure,
    actions::{self, TokenRequest},
    challenge::{actor, moment_of},
    data::DataFolder,
    now_unix_ms,
    setup::admit,
};
use avln_store::{AuditNote, Member, NewGrant, Reference, Store, TokenLine, TokenScope, calendar::rfc3339};
use clap::{Args, Subcommand, ValueEnum};
use std::path::Path;

#[derive(Debug, Subcommand)]
pub(crate) enum TeamCommand {
    /// Admit a team and print a new account token, once
    Add {
        /// Team name
        name: String,
        /// Show the runs for comparison, without a rank
        #[arg(long, value_enum, value_name = "KIND")]
        reference: Option<ReferenceKind>,
    },
    /// Revoke a team's tokens
    Revoke {
        /// Team name
        name: String,
    },
    /// Approve a team for a phase that requires approval
    Approve {
        /// Team name
        name: String,
        /// Phase id
        #[arg(long)]
        phase: String,
        /// Withdraw the approval; started runs continue
        #[arg(long)]
        withdraw: bool,
    },
    /// Grant a team runs beyond the quota
    Grant {
        /// Team name
        name: String,
        /// Phase id
        #[arg(long)]
        phase: String,
        /// Additional runs
        #[arg(long, value_parser = clap::value_parser!(u32).range(1..=1000))]
        runs: u32,
        /// Reason, for the audit list
        #[arg(long, value_name = "TEXT")]
        reason: String,
    },
    /// Manage a team's members; a person can be in one team per phase
    #[command(subcommand)]
    Member(MemberCommand),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ReferenceKind {
    /// A baseline agent
    Baseline,
    /// People, playing with avln agent human
    Human,
}

impl From<ReferenceKind> for Reference {
    fn from(kind: ReferenceKind) -> Self {
        match kind {
            ReferenceKind::Baseline => Self::Baseline,
            ReferenceKind::Human => Self::Human,
        }
    }
}

#[derive(Debug, Subcommand)]
pub(crate) enum MemberCommand {
    /// Add a person to a phase's team
    Add(MemberArgs),
    /// Remove a person from a phase's team
    Remove(MemberArgs),
    /// List a team's members
    List {
        /// Team name
        team: String,
    },
}

/// A team member in a phase.
#[derive(Clone, Debug, Args)]
pub(crate) struct MemberArgs {
    /// Team name
    team: String,
    /// The person's email address, such as ada@example.org
    person: String,
    /// Phase id
    #[arg(long)]
    phase: String,
}

pub(crate) async fn run(data: &Path, command: TeamCommand) -> Result<(), Failure> {
    let store = DataFolder::open(data)?.store().await?;
    match command {
        TeamCommand::Add { name, reference } => {
            let token = admit(&store, &name, reference.map(Reference::from)).await?;
            say!("team   {name}");
            say!("token  {token}");
            say!("The token is shown only once. Agents read it from --token or AVLN_TOKEN.");
        }
        TeamCommand::Revoke { name } => {
            let count = store.revoke_tokens(&name, now_unix_ms()).await?;
            store.add_audit_note(team_note(&name, format!("{count} tokens revoked")), now_unix_ms()).await?;
            say!("{count} tokens of team {name} are revoked");
        }
        TeamCommand::Approve { name, phase, withdraw } => approve(&store, &name, &phase, !withdraw).await?,
        TeamCommand::Grant { name, phase, runs, reason } => {
            let grant = NewGrant { phase: &phase, team: &name, runs, reason: &reason };
            let granted = team_note(&name, format!("granted in phase {phase}"));
            let note = AuditNote { after: Some(format!("{runs} runs")), reason: reason.clone(), ..granted };
            store.grant(&grant, note, now_unix_ms()).await?;
            say!("team {name} has {runs} more runs in phase {phase}");
        }
        TeamCommand::Member(command) => member(&store, command).await?,
    }
    Ok(())
}

fn team_note(team: &str, what: String) -> AuditNote {
    AuditNote { actor: actor(), subject: format!("team {team}"), what, ..AuditNote::default() }
}

async fn approve(store: &Store, team: &str, phase: &str, approved: bool) -> Result<(), Failure> {
    let word = if approved { "approved" } else { "no more approved" };
    let note = team_note(team, format!("{word} in phase {phase}"));
    let changed = store.approve(phase, team, approved, note, now_unix_ms()).await?;
    let already = if changed { "" } else { ", as before" };
    say!("team {team} is {word} in phase {phase}{already}");
    Ok(())
}

async fn member(store: &Store, command: MemberCommand) -> Result<(), Failure> {
    let (who, enters) = match command {
        MemberCommand::Add(who) => (who, true),
        MemberCommand::Remove(who) => (who, false),
        MemberCommand::List { team } => {
            for Member { phase, person, .. } in store.members(&team).await? {
                say!("{phase}  {person}");
            }
            return Ok(());
        }
    };
    let MemberArgs { team, person, phase } = who;
    let member = Member { person: address(&person)?, team, phase };
    let Member { phase, team, person } = &member;
    // The audit list is never deleted, so it must not name people.
    let deed = if enters { "member entered" } else { "member taken out" };
    let note = team_note(team, format!("{deed} in phase {phase}"));
    let (changed, word) = match enters {
        true => (store.add_member(&member, note, now_unix_ms()).await?, "is"),
        false => (store.remove_member(&member, note, now_unix_ms()).await?, "is not"),
    };
    let already = if changed { "" } else { ", as before" };
    say!("{person} {word} in team {team} of phase {phase}{already}");
    Ok(())
}

/// Checks an email address and converts it to lower case, the single accepted spelling.
fn address(words: &str) -> Result<String, Failure> {
    let small = words.trim().to_lowercase();
    let plain =
        small.len() <= 254 && small.chars().all(|letter| !letter.is_whitespace() && !letter.is_control());
    let (name, host) = small.split_once('@').unwrap_or_default();
    if plain && !name.is_empty() && host.contains('.') && !host.contains('@') {
        return Ok(small);
    }
    Err(Failure::data(format!("'{}' is not an email address", words.escape_debug()))
        .hinted("use one such as ada@example.org"))
}

#[derive(Debug, Subcommand)]
pub(crate) enum TokenCommand {
    /// Issue a token and print it, once
    New(NewTokenArgs),
    /// List all tokens, without their secrets
    List {
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
    /// Revoke a token
    Revoke {
        /// Token id, from avln challenge token list
        id: String,
    },
}

#[derive(Clone, Debug, Args)]
pub(crate) struct NewTokenArgs {
    /// Account token for this team: starts runs and reads the team's results
    #[arg(long, value_name = "TEAM", required_unless_present = "organiser")]
    team: Option<String>,
    /// Organiser token: full access
    #[arg(long, conflicts_with = "team")]
    organiser: bool,
    /// Read-only token: reads the team's results, starts no runs
    #[arg(long, requires = "team")]
    read_only: bool,
    /// Token name in lists
    #[arg(long, default_value = "", value_name = "TEXT")]
    name: String,
    /// Expiry: a time such as 2026-09-01T00:00:00Z, or days such as 30d; never by default
    #[arg(long, value_name = "WHEN")]
    expires: Option<String>,
}

pub(crate) async fn run_token(data: &Path, command: TokenCommand) -> Result<(), Failure> {
    let store = DataFolder::open(data)?.store().await?;
    match command {
        TokenCommand::New(args) => issue_token(&store, &args).await,
        TokenCommand::List { json } => list_tokens(&store, json).await,
        TokenCommand::Revoke { id } => {
            let revoked = actions::note(&actor(), format!("token {id}"), "revoked", "");
            store.revoke_token(&id, revoked, now_unix_ms()).await?;
            say!("token {id} is revoked");
            Ok(())
        }
    }
}

async fn issue_token(store: &Store, args: &NewTokenArgs) -> Result<(), Failure> {
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
        Failure::data(format!("--expires '{}' is not a future time", words.escape_debug()))
            .hinted("use a time such as 2026-09-01T00:00:00Z, or days such as 30d, at most 36500d")
    })
}

async fn list_tokens(store: &Store, json: bool) -> Result<(), Failure> {
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
    fn one_person_has_one_address() {
        assert_eq!(address(" Ada@Example.ORG ").ok().as_deref(), Some("ada@example.org"));
        for wrong in ["ada", "@example.org", "ada@", "ada@host", "a b@example.org", "a@b@c.org", ""] {
            assert!(address(wrong).is_err(), "{wrong}");
        }
    }

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
