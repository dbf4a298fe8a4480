//! What the organiser rules on runs.

use crate::output::say;
use avln_arena::{
    Failure, FailureKind,
    challenge::actor,
    data::DataFolder,
    office::deeds::{disqualify, verify},
};
use clap::{Args, Subcommand};
use std::path::Path;

/// Commands about runs that were looked at.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Mark a run that is over as verified: boards and its page say that you vouch for it
    Verified(Ruling),
    /// Take a run off all boards; its page stays, and tells the reason to everybody
    Disqualified(Ruling),
}

/// Which run, and why.
#[derive(Clone, Debug, Args)]
pub struct Ruling {
    /// Id of the run
    pub run: String,
    /// Why
    #[arg(long, value_name = "TEXT")]
    pub reason: String,
    /// Take the ruling back
    #[arg(long)]
    pub withdraw: bool,
}

/// Carries out a command about runs.
///
/// # Errors
/// When there is no such run, there is no reason, or the database refuses.
pub async fn run(data: &Path, command: Command) -> Result<(), Failure> {
    let store = DataFolder::open(data)?.store().await?;
    let (Command::Verified(ruling) | Command::Disqualified(ruling)) = &command;
    let Ruling { run, reason, withdraw } = ruling;
    let reason = reason.trim();
    if reason.is_empty() || reason.chars().any(char::is_control) {
        return Err(Failure::new(FailureKind::Data, "--reason is no line of text")
            .hinted("say why, on one line: --reason \"it read the map\""));
    }
    let actor = actor();
    let because = (actor.as_str(), reason);
    let words = match command {
        Command::Verified(_) => verify(&store, run, !withdraw, because).await?,
        Command::Disqualified(_) => disqualify(&store, run, !withdraw, because).await?,
    };
    say!("{words}");
    Ok(())
}
