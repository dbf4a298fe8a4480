//! The organiser's rulings on runs.

use crate::output::say;
use avln_arena::{
    Failure, FailureKind,
    actions::{disqualify, verify},
    challenge::actor,
    data::DataFolder,
};
use clap::{Args, Subcommand};
use std::path::Path;

/// Commands on reviewed runs.
#[derive(Debug, Subcommand)]
pub enum RulingCommand {
    /// Mark a finished run as verified on leaderboards and on its page
    Verified(RulingArgs),
    /// Remove a run from all leaderboards; its page remains, with the reason
    Disqualified(RulingArgs),
}

/// Arguments of a ruling.
#[derive(Clone, Debug, Args)]
pub struct RulingArgs {
    /// Id of the run
    pub run: String,
    /// Reason
    #[arg(long, value_name = "TEXT")]
    pub reason: String,
    /// Withdraw the ruling
    #[arg(long)]
    pub withdraw: bool,
}

/// Runs a ruling.
///
/// # Errors
/// If there is no such run, the reason is empty, or the database fails.
pub async fn run(data: &Path, command: RulingCommand) -> Result<(), Failure> {
    let store = DataFolder::open(data)?.store().await?;
    let (RulingCommand::Verified(ruling) | RulingCommand::Disqualified(ruling)) = &command;
    let RulingArgs { run, reason, withdraw } = ruling;
    let reason = reason.trim();
    if reason.is_empty() || reason.chars().any(char::is_control) {
        return Err(Failure::new(FailureKind::Data, "--reason is empty or not a single line")
            .hinted("say why, on one line: --reason \"it read the map\""));
    }
    let actor = actor();
    let because = (actor.as_str(), reason);
    let words = match command {
        RulingCommand::Verified(_) => verify(&store, run, !withdraw, because).await?,
        RulingCommand::Disqualified(_) => disqualify(&store, run, !withdraw, because).await?,
    };
    say!("{words}");
    Ok(())
}
