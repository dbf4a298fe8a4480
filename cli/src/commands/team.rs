//! Admits teams and issues tokens.

use crate::output::say;
use avln_arena::{Failure, FailureKind, challenge::actor, data::DataFolder, now_unix_ms, setup::admit};
use avln_store::{AuditNote, Member, NewGrant, Reference, Store};
use clap::{Args, Subcommand, ValueEnum};
use std::path::Path;

/// Commands about teams.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Admit a team, or an admitted one again, and print a new account token once
    Add {
        /// Public name of the team
        name: String,
        /// Show its runs among the others for comparison, without a rank
        #[arg(long, value_enum, value_name = "KIND")]
        reference: Option<ReferenceKind>,
    },
    /// Take back all tokens of a team
    Revoke {
        /// Public name of the team
        name: String,
    },
    /// Let a team play in a phase that asks for approval
    Approve {
        /// Public name of the team
        name: String,
        /// Id of the phase
        #[arg(long)]
        phase: String,
        /// Take the approval back; runs that were started go on
        #[arg(long)]
        withdraw: bool,
    },
    /// Give a team runs beyond its quota
    Grant {
        /// Public name of the team
        name: String,
        /// Id of the phase
        #[arg(long)]
        phase: String,
        /// How many
        #[arg(long, value_parser = clap::value_parser!(u32).range(1..=1000))]
        runs: u32,
        /// Why, for the audit list
        #[arg(long, value_name = "TEXT")]
        reason: String,
    },
    /// Enter people into teams; a person is in one team of a phase at most
    #[command(subcommand)]
    Member(MemberCommand),
}

/// What a team's runs are shown for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ReferenceKind {
    /// An agent that others are compared with
    Baseline,
    /// People, who play with avln agent human
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

/// Commands about people in teams.
#[derive(Debug, Subcommand)]
pub enum MemberCommand {
    /// Enter a person into a team of a phase
    Add(Who),
    /// Take a person out of a team of a phase
    Remove(Who),
    /// List the people of a team
    List {
        /// Public name of the team
        team: String,
    },
}

/// A person in a team of a phase.
#[derive(Clone, Debug, Args)]
pub struct Who {
    /// Public name of the team
    pub team: String,
    /// The person, by an address such as ada@example.org
    pub person: String,
    /// Id of the phase
    #[arg(long)]
    pub phase: String,
}

/// Carries out a command about teams.
///
/// # Errors
/// When the database refuses.
pub async fn run(data: &Path, command: Command) -> Result<(), Failure> {
    let store = DataFolder::open(data)?.store().await?;
    match command {
        Command::Add { name, reference } => {
            let token = admit(&store, &name, reference.map(Reference::from)).await?;
            say!("team   {name}");
            say!("token  {token}");
            say!("The token is shown this once. Agents take it with --token or from AVLN_TOKEN.");
        }
        Command::Revoke { name } => {
            let count = store.revoke_tokens(&name, now_unix_ms()).await?;
            store.add_audit_note(note(&name, format!("{count} tokens revoked")), now_unix_ms()).await?;
            say!("{count} tokens of team {name} are void now");
        }
        Command::Approve { name, phase, withdraw } => approve(&store, &name, &phase, !withdraw).await?,
        Command::Grant { name, phase, runs, reason } => {
            let grant = NewGrant { phase: &phase, team: &name, runs, reason: &reason };
            let after = Some(format!("{runs} runs"));
            let note = AuditNote {
                after,
                reason: reason.clone(),
                ..note(&name, format!("granted in phase {phase}"))
            };
            store.grant(&grant, note, now_unix_ms()).await?;
            say!("team {name} has {runs} runs more in phase {phase}");
        }
        Command::Member(command) => member(&store, command).await?,
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
    let Who { team, person, phase } = who;
    let member = Member { person: address(&person)?, team, phase };
    let Member { phase, team, person } = &member;
    // The list of changes outlives memberships: it does not name people.
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

/// An address of e-mail in small letters, so that one person is not two.
fn address(words: &str) -> Result<String, Failure> {
    let small = words.trim().to_lowercase();
    let plain =
        small.len() <= 254 && small.chars().all(|letter| !letter.is_whitespace() && !letter.is_control());
    let (name, host) = small.split_once('@').unwrap_or_default();
    if plain && !name.is_empty() && host.contains('.') && !host.contains('@') {
        return Ok(small);
    }
    Err(Failure::new(FailureKind::Data, format!("'{}' is no address of a person", words.escape_debug()))
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
