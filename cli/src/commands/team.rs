//! Teams, their members and their grants.

use crate::output::say;
use avln_arena::{Failure, FailureKind, challenge::actor, data::DataFolder, now_unix_ms, setup::admit};
use avln_store::{AuditNote, Member, NewGrant, Reference, Store};
use clap::{Args, Subcommand, ValueEnum};
use std::path::Path;

/// Commands on teams.
#[derive(Debug, Subcommand)]
pub enum TeamCommand {
    /// Admit a team and print a new account token, once
    Add {
        /// Name of the team
        name: String,
        /// Show its runs for comparison, without a rank
        /// Reason, for the audit list
        #[arg(long, value_enum, value_name = "KIND")]
        reference: Option<ReferenceKind>,
    },
    /// Revoke all tokens of a team
    Revoke {
        /// Name of the team
        name: String,
    },
    /// Approve a team for a phase that requires approval
    Approve {
        /// Name of the team
        name: String,
        /// Id of the phase
        /// Reason, for the audit list
        #[arg(long)]
        phase: String,
        /// Withdraw the approval; started runs continue
        /// Reason, for the audit list
        #[arg(long)]
        withdraw: bool,
    },
    /// Grant a team runs beyond its quota
    Grant {
        /// Name of the team
        name: String,
        /// Id of the phase
        /// Reason, for the audit list
        #[arg(long)]
        phase: String,
        /// Number of runs
        /// Why, for the audit list
        /// Reason, for the audit list
        #[arg(long, value_parser = clap::value_parser!(u32).range(1..=1000))]
        runs: u32,
        /// Reason, for the audit list
        /// Reason, for the audit list
        #[arg(long, value_name = "TEXT")]
        reason: String,
    },
    /// Manage the members of a team; a person can be in only one team of a phase
    #[command(subcommand)]
    Member(MemberCommand),
}

/// The purpose of a reference team.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ReferenceKind {
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

/// Commands on team members.
#[derive(Debug, Subcommand)]
pub enum MemberCommand {
    /// Add a person to a team of a phase
    Add(MemberArgs),
    /// Remove a person from a team of a phase
    Remove(MemberArgs),
    /// List the members of a team
    List {
        /// Name of the team
        team: String,
    },
}

/// A person in a team of a phase.
#[derive(Clone, Debug, Args)]
pub struct MemberArgs {
    /// Name of the team
    pub team: String,
    /// Email address of the person, such as ada@example.org
    pub person: String,
    /// Id of the phase
    #[arg(long)]
    pub phase: String,
}

/// Runs a command on teams.
///
/// # Errors
/// If the database fails.
pub async fn run(data: &Path, command: TeamCommand) -> Result<(), Failure> {
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
            store.add_audit_note(note(&name, format!("{count} tokens revoked")), now_unix_ms()).await?;
            say!("{count} tokens of team {name} are revoked");
        }
        TeamCommand::Approve { name, phase, withdraw } => approve(&store, &name, &phase, !withdraw).await?,
        TeamCommand::Grant { name, phase, runs, reason } => {
            let grant = NewGrant { phase: &phase, team: &name, runs, reason: &reason };
            let after = Some(format!("{runs} runs"));
            let note = AuditNote {
                after,
                reason: reason.clone(),
                ..note(&name, format!("granted in phase {phase}"))
            };
            store.grant(&grant, note, now_unix_ms()).await?;
            say!("team {name} has {runs} more runs in phase {phase}");
        }
        TeamCommand::Member(command) => member(&store, command).await?,
    }
    Ok(())
}

fn note(team: &str, what: String) -> AuditNote {
    AuditNote { actor: actor(), subject: format!("team {team}"), what, ..AuditNote::default() }
}

async fn approve(store: &Store, team: &str, phase: &str, approved: bool) -> Result<(), Failure> {
    let word = if approved { "approved" } else { "no more approved" };
    let note = note(team, format!("{word} in phase {phase}"));
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
    let note = note(team, format!("{deed} in phase {phase}"));
    let (changed, word) = match enters {
        true => (store.add_member(&member, note, now_unix_ms()).await?, "is"),
        false => (store.remove_member(&member, note, now_unix_ms()).await?, "is not"),
    };
    let already = if changed { "" } else { ", as before" };
    say!("{person} {word} in team {team} of phase {phase}{already}");
    Ok(())
}

/// Checks an email address and converts it to lower case, so that a person has only one spelling.
fn address(words: &str) -> Result<String, Failure> {
    let small = words.trim().to_lowercase();
    let plain =
        small.len() <= 254 && small.chars().all(|letter| !letter.is_whitespace() && !letter.is_control());
    let (name, host) = small.split_once('@').unwrap_or_default();
    if plain && !name.is_empty() && host.contains('.') && !host.contains('@') {
        return Ok(small);
    }
    Err(Failure::new(FailureKind::Data, format!("'{}' is not an email address", words.escape_debug()))
        .hinted("use one such as ada@example.org"))
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
}
