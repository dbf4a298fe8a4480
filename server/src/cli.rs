use crate::{Failure, FailureKind, commands, failure::EXIT_CODES};
use avln_kit::run::run_for;
use clap::{Parser, Subcommand};
use std::{path::PathBuf, process::ExitCode};
use tracing_subscriber::EnvFilter;

/// LH-AVLN Arena: hosts long-horizon audio-visual-language navigation episodes, scores them and shows the results
#[derive(Debug, Parser)]
#[command(name = "avln", bin_name = "avln", version, after_help = EXIT_CODES)]
pub struct Cli {
    /// Where database, splits and caches lie
    #[arg(long, global = true, env = "AVLN_DATA", default_value = "avln-data", value_name = "FOLDER")]
    pub data: PathBuf,
    /// What to log to standard error, such as info or avln_grpc=debug
    #[arg(long, global = true, env = "AVLN_LOG", default_value = "warn", value_name = "FILTER")]
    pub log: String,
    /// What to do
    #[command(subcommand)]
    pub command: Command,
}

/// The commands, one file each.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Build houses and missions, run two agents over gRPC, show the leaderboard
    Demo(commands::demo::Options),
    /// Host the phases of the data folder for remote agents
    Serve(commands::serve::Options),
    /// Ask a running server what is going on, announce things, let it come to its end
    #[command(subcommand)]
    Admin(commands::admin::Command),
    /// Run one of the agents that come with the arena against a server
    #[command(subcommand)]
    Agent(commands::agent::Agent),
    /// Let every agent that comes with the arena play one split, and write down what they reach
    #[command(subcommand)]
    Ladder(commands::ladder::Command),
    /// Make splits of scenes and missions
    #[command(subcommand)]
    Split(commands::split::Command),
    /// Record demonstrations of the oracle on a training split, to learn from
    Rollout(commands::rollout::Options),
    /// Build data sets by recipe, count them, check them
    #[command(subcommand)]
    Dataset(commands::dataset::Command),
    /// Check whether a server, this one or another, keeps the protocol
    Conformance(commands::conformance::Options),
    /// Tell before a run whether it will go well: token, clock, versions, speed, and some episodes of practice
    Doctor(commands::doctor::Options),
    /// Prove that a server scores as the published one does, to the last bit
    Calibrate(commands::calibrate::Options),
    /// Check a run by its log: that nobody changed it, that each action leads where it did, that it is worth what it was
    Verify(commands::verify::Options),
    /// Score runs again with the scorer of this build, keep both, show what changed
    Rescore(commands::rescore::Options),
    /// Open phases on a split
    #[command(subcommand)]
    Phase(commands::phase::Command),
    /// Write down what everybody sees, as pages and tables that need no server
    #[command(subcommand)]
    Board(commands::board::Command),
    /// Set up all phases by one file, see what was changed, publish what was promised
    #[command(subcommand)]
    Challenge(commands::challenge::Command),
    /// Admit teams and issue their tokens
    #[command(subcommand)]
    Team(commands::team::Command),
    /// Rule on runs: mark them as verified, take them off the boards
    #[command(subcommand)]
    Ruling(commands::ruling::Command),
    /// Run an agent against a phase, shut off from everything but the server
    #[command(subcommand)]
    Sealed(commands::sealed::Command),
    /// Issue, list and take back tokens
    #[command(subcommand)]
    Token(commands::token::Command),
    /// Back the data folder up, restore it, let go of what is old
    #[command(subcommand)]
    Db(commands::db::Command),
    /// Look at scenes and export them
    #[command(subcommand)]
    Scene(commands::scene::Command),
    /// Ask how far it is to walk in a scene, where actions lead and what a camera sees, as Habitat would; and what ears hear
    #[command(subcommand)]
    Sim(commands::sim::Command),
    /// Write man pages and completions of Bash, Zsh and Fish
    Manual(commands::manual::Options),
}

/// The whole program: carries out the command line of this process, and says on standard error why it could not.
pub fn main() -> ExitCode {
    match run(Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("error: {failure}");
            failure.exit_code()
        }
    }
}

/// Carries out one command line.
///
/// # Errors
/// When the command fails; the failure carries the exit code and the next step.
pub fn run(cli: Cli) -> Result<(), Failure> {
    let filter = EnvFilter::try_new(&cli.log).map_err(|error| {
        Failure::new(FailureKind::Internal, format!("cannot read the log filter '{}': {error}", cli.log))
            .hinted("use a level such as info, or target=level pairs separated by commas")
    })?;
    let subscriber = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr);
    // A log that cannot be written, on a full disk, must not take the server down.
    let subscriber = subscriber.log_internal_errors(false);
    // A second subscriber in one process (a test) keeps the first.
    let _ = subscriber.try_init();
    match cli.command {
        Command::Scene(command) => commands::scene::run(&cli.data, command),
        Command::Sim(command) => commands::sim::run(&cli.data, command),
        Command::Dataset(command) => commands::dataset::run(&cli.data, command),
        Command::Sealed(commands::sealed::Command::Enter(step)) => step.take(),
        Command::Agent(agent) => play(agent),
        Command::Manual(options) => commands::manual::run(&options),
        other => asynchronous(&cli.data, other),
    }
}

fn play(agent: commands::agent::Agent) -> Result<(), Failure> {
    let no_threads = |error| Failure::new(FailureKind::Internal, format!("cannot start threads: {error}"));
    run_for(agent.slots(), commands::agent::run(agent)).map_err(no_threads)?
}

#[tokio::main]
async fn asynchronous(data: &std::path::Path, command: Command) -> Result<(), Failure> {
    match command {
        Command::Demo(options) => commands::demo::run(data, options).await,
        Command::Serve(options) => commands::serve::run(data, options).await,
        Command::Admin(command) => commands::admin::run(command).await,
        Command::Agent(agent) => commands::agent::run(agent).await,
        Command::Ladder(command) => commands::ladder::run(command).await,
        Command::Split(command) => commands::split::run(data, command).await,
        Command::Rollout(options) => commands::rollout::run(data, options).await,
        Command::Phase(command) => commands::phase::run(data, command).await,
        Command::Board(command) => commands::board::run(data, command).await,
        Command::Challenge(command) => commands::challenge::run(data, command).await,
        Command::Team(command) => commands::team::run(data, command).await,
        Command::Ruling(command) => commands::ruling::run(data, command).await,
        Command::Sealed(command) => commands::sealed::run(data, command).await,
        Command::Token(command) => commands::token::run(data, command).await,
        Command::Rescore(options) => commands::rescore::run(data, options).await,
        Command::Doctor(options) => commands::doctor::run(options).await,
        Command::Calibrate(options) => commands::calibrate::run(data, options).await,
        Command::Db(command) => commands::db::run(data, command).await,
        Command::Conformance(options) => commands::conformance::run(options).await,
        Command::Verify(options) => commands::verify::run(data, options).await,
        Command::Scene(command) => commands::scene::run(data, command),
        Command::Sim(command) => commands::sim::run(data, command),
        Command::Dataset(command) => commands::dataset::run(data, command),
        Command::Manual(options) => commands::manual::run(&options),
    }
}
