//! Command line of `avln`: arguments, output and wiring.
//!
//! Start at [`run`]. `commands` has a file per command or group.

use crate::{
    commands::*,
    output::{LogFormat, processors, say, start_log},
};
use avln_arena::Failure;
use avln_kit::run::run_for;
use avln_web::Documents;
use clap::{Arg, Args, CommandFactory, Parser, Subcommand, value_parser};
use clap_complete::Shell;
use std::{
    fs, io,
    path::{Path, PathBuf},
    process::ExitCode,
};
use tokio::runtime::Builder;

/// The commands of `avln`, a file per command or group. The documentation of arguments is the help text.
mod commands {
    pub(crate) mod agents;
    pub(crate) mod challenge;
    pub(crate) mod checks;
    pub(crate) mod data;
    pub(crate) mod demo;
    pub(crate) mod leaderboard;
    pub(crate) mod phase;
    pub(crate) mod run;
    pub(crate) mod scene;
    pub(crate) mod scene_stats;
    pub(crate) mod sealed;
    mod sealed_sandbox;
    pub(crate) mod serve;
    pub(crate) mod sim;
    pub(crate) mod split;
    pub(crate) mod team;
}
mod output;

/// LH-AVLN Arena: hosts long-horizon audio-visual-language navigation episodes, scores them and shows the results
#[derive(Debug, Parser)]
#[command(name = "avln", bin_name = "avln", version, after_help = EXIT_CODES)]
pub struct Cli {
    /// Folder of the database, splits and caches
    // Commands that use the folder show the option by `data_option`, which has the same id: clap copies the value
    // upwards. Here it is hidden and global, because `avln --data FOLDER COMMAND` is common in scripts.
    #[arg(long, global = true, hide = true, env = "AVLN_DATA", default_value = DATA_FOLDER, value_name = "FOLDER")]
    pub(crate) data: PathBuf,
    /// Log filter for standard error, such as info or avln_grpc=debug
    #[arg(long, global = true, env = "AVLN_LOG", default_value = "warn", value_name = "FILTER")]
    pub(crate) log: String,
    /// Format of the log: text for people, or a JSON object per line
    #[arg(long, global = true, env = "AVLN_LOG_FORMAT", default_value = "text", value_name = "FORMAT")]
    pub(crate) log_format: LogFormat,
    /// Command to run
    #[command(subcommand)]
    pub(crate) command: TopCommand,
}

const EXIT_CODES: &str = "Exit codes:
  0  success
  1  internal error
  2  invalid command line
  3  unusable data folder, database or input file
  4  address in use or not available
  5  unusable scene or split
  6  failed run, check or request
  7  intact run log without proof of completeness";

const DATA_FOLDER: &str = "avln-data";

/// Option `--data` in the help for commands with a data folder.
pub(crate) fn data_option() -> Arg {
    Arg::new("data")
        .long("data")
        .global(true)
        .env("AVLN_DATA")
        .default_value(DATA_FOLDER)
        .value_name("FOLDER")
        .value_parser(value_parser!(PathBuf))
        .help("Folder of the database, splits and caches")
}

/// The top-level commands and groups.
#[derive(Debug, Subcommand)]
pub(crate) enum TopCommand {
    /// Build houses and missions, run two agents over gRPC, show the leaderboard
    #[command(arg(data_option()))]
    Demo(demo::DemoArgs),
    /// Host the data folder's phases for remote agents
    #[command(arg(data_option()))]
    Serve(serve::ServeArgs),
    /// Inspect, notify or drain a running server
    #[command(subcommand)]
    Admin(serve::AdminCommand),
    /// Run one of the bundled agents against a server
    #[command(subcommand)]
    Agent(agents::AgentCommand),
    /// Manage a challenge: phases, teams, tokens, rulings, leaderboards
    #[command(subcommand, arg(data_option()))]
    Challenge(ChallengeCommand),
    /// Make splits and data sets, and maintain the data folder
    #[command(subcommand, arg(data_option()))]
    Data(DataCommand),
    /// Verify and rescore runs
    #[command(subcommand, arg(data_option()))]
    Run(RunCommand),
    /// Evaluate bundled agents, record demonstrations, check servers and clients
    #[command(subcommand)]
    Lab(LabCommand),
    /// Inspect, measure, draw, import and export scenes
    #[command(subcommand)]
    Scene(scene::SceneCommand),
    /// Compute distances, paths, pictures and sounds in a scene, as Habitat would
    #[command(subcommand)]
    Sim(sim::SimCommand),
    /// Write man pages, and completions for Bash, Zsh and Fish
    #[command(hide = true)]
    Manual(ManualArgs),
    /// A spelling of version 0.1
    #[command(flatten)]
    Old(OldCommand),
}

/// Commands for organisers of a challenge.
#[derive(Debug, Subcommand)]
pub(crate) enum ChallengeCommand {
    #[command(flatten)]
    File(challenge::ChallengeFileCommand),
    /// Open, pause, resume and close phases
    #[command(subcommand)]
    Phase(phase::PhaseCommand),
    /// Admit teams, enter members, grant runs
    #[command(subcommand)]
    Team(team::TeamCommand),
    /// Issue, list and revoke tokens
    #[command(subcommand)]
    Token(team::TokenCommand),
    /// Verify or disqualify runs
    #[command(subcommand)]
    Ruling(challenge::RulingCommand),
    /// Run an agent in a sandbox that reaches only the server
    #[command(subcommand)]
    Sealed(sealed::SealedCommand),
    /// Freeze leaderboards as static pages, check a frozen copy, add the oracle
    #[command(subcommand)]
    Leaderboard(leaderboard::LeaderboardCommand),
}

#[derive(Debug, Subcommand)]
pub(crate) enum DataCommand {
    /// Make, prepare, export and seal splits
    #[command(subcommand)]
    Split(split::SplitCommand),
    /// Build, import, count and check data sets
    #[command(subcommand)]
    Dataset(data::DatasetCommand),
    /// Back up, restore and prune the data folder
    #[command(subcommand)]
    Db(data::DbCommand),
}

#[derive(Debug, Subcommand)]
pub(crate) enum RunCommand {
    /// Verify a run log: its hash chain, its replay, and its score
    Verify(run::VerifyArgs),
    /// Score runs again with the scorer of this build, keep both scores, show the differences
    Rescore(run::RescoreArgs),
}

/// Commands that use the arena for experiments and checks.
#[derive(Debug, Subcommand)]
pub(crate) enum LabCommand {
    /// Run the baseline suite: all bundled agents on the tracks main, hard and quick, with a report
    #[command(subcommand)]
    Baselines(agents::BaselinesCommand),
    /// Prove that a server scores like the published one, bit for bit
    #[command(arg(data_option()))]
    Calibrate(checks::CalibrateArgs),
    /// Record demonstrations of the oracle on a training split
    #[command(arg(data_option()))]
    Rollout(agents::RolloutArgs),
    /// Check before a run that it will succeed: token, clock, versions, speed, and practice episodes
    Doctor(checks::DoctorArgs),
    /// Check that a server or a client follows the protocol
    Conformance(checks::ConformanceArgs),
}

/// Hidden spellings from version 0.1; they will be removed after one version.
#[derive(Debug, Subcommand)]
pub(crate) enum OldCommand {
    /// Same as avln challenge phase
    #[command(subcommand, hide = true)]
    Phase(phase::PhaseCommand),
    /// Same as avln challenge team
    #[command(subcommand, hide = true)]
    Team(team::TeamCommand),
    /// Same as avln challenge token
    #[command(subcommand, hide = true)]
    Token(team::TokenCommand),
    /// Same as avln challenge ruling
    #[command(subcommand, hide = true)]
    Ruling(challenge::RulingCommand),
    /// Same as avln challenge sealed
    #[command(subcommand, hide = true)]
    Sealed(sealed::SealedCommand),
    /// Same as avln challenge leaderboard
    #[command(subcommand, hide = true)]
    Board(leaderboard::LeaderboardCommand),
    /// Same as avln data split
    #[command(subcommand, hide = true)]
    Split(split::SplitCommand),
    /// Same as avln data dataset
    #[command(subcommand, hide = true)]
    Dataset(data::DatasetCommand),
    /// Same as avln data db
    #[command(subcommand, hide = true)]
    Db(data::DbCommand),
    /// Same as avln run verify
    #[command(hide = true)]
    Verify(run::VerifyArgs),
    /// Same as avln run rescore
    #[command(hide = true)]
    Rescore(run::RescoreArgs),
    /// Same as avln lab baselines
    #[command(subcommand, hide = true)]
    Ladder(agents::BaselinesCommand),
    /// Same as avln lab calibrate
    #[command(hide = true)]
    Calibrate(checks::CalibrateArgs),
    /// Same as avln lab rollout
    #[command(hide = true)]
    Rollout(agents::RolloutArgs),
    /// Same as avln lab doctor
    #[command(hide = true)]
    Doctor(checks::DoctorArgs),
    /// Same as avln lab conformance
    #[command(hide = true)]
    Conformance(checks::ConformanceArgs),
}

impl From<OldCommand> for TopCommand {
    fn from(old: OldCommand) -> Self {
        match old {
            OldCommand::Phase(command) => Self::Challenge(ChallengeCommand::Phase(command)),
            OldCommand::Team(command) => Self::Challenge(ChallengeCommand::Team(command)),
            OldCommand::Token(command) => Self::Challenge(ChallengeCommand::Token(command)),
            OldCommand::Ruling(command) => Self::Challenge(ChallengeCommand::Ruling(command)),
            OldCommand::Sealed(command) => Self::Challenge(ChallengeCommand::Sealed(command)),
            OldCommand::Board(command) => Self::Challenge(ChallengeCommand::Leaderboard(command)),
            OldCommand::Split(command) => Self::Data(DataCommand::Split(command)),
            OldCommand::Dataset(command) => Self::Data(DataCommand::Dataset(command)),
            OldCommand::Db(command) => Self::Data(DataCommand::Db(command)),
            OldCommand::Verify(args) => Self::Run(RunCommand::Verify(args)),
            OldCommand::Rescore(args) => Self::Run(RunCommand::Rescore(args)),
            OldCommand::Ladder(command) => Self::Lab(LabCommand::Baselines(command)),
            OldCommand::Calibrate(args) => Self::Lab(LabCommand::Calibrate(args)),
            OldCommand::Rollout(args) => Self::Lab(LabCommand::Rollout(args)),
            OldCommand::Doctor(args) => Self::Lab(LabCommand::Doctor(args)),
            OldCommand::Conformance(args) => Self::Lab(LabCommand::Conformance(args)),
        }
    }
}

/// Runs the process's command line and prints a failure to standard error.
pub fn main() -> ExitCode {
    match run(Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("error: {failure}");
            failure.exit_code()
        }
    }
}

/// Runs a command line; a failure contains exit code and hint.
pub fn run(cli: Cli) -> Result<(), Failure> {
    start_log(&cli.log, cli.log_format)?;
    let data = cli.data.as_path();
    match cli.command {
        TopCommand::Demo(args) => block_on(demo::run(data, args)),
        TopCommand::Serve(args) => block_on(serve::run(data, args)),
        TopCommand::Admin(command) => block_on(serve::administer(command)),
        TopCommand::Agent(agent) => run_for(agent.slots(), agents::play(agent)).map_err(no_threads)?,
        TopCommand::Challenge(command) => run_challenge(data, command),
        TopCommand::Data(DataCommand::Split(command)) => block_on(split::run(data, command)),
        TopCommand::Data(DataCommand::Dataset(command)) => data::run(data, command),
        TopCommand::Data(DataCommand::Db(command)) => block_on(data::maintain(data, command)),
        TopCommand::Run(RunCommand::Verify(args)) => block_on(run::verify(data, args)),
        TopCommand::Run(RunCommand::Rescore(args)) => block_on(run::rescore_runs(data, args)),
        TopCommand::Lab(command) => block_on(run_lab(data, command)),
        TopCommand::Scene(command) => scene::run(data, command),
        TopCommand::Sim(command) => sim::run(data, command),
        TopCommand::Manual(args) => write_manual(&args),
        TopCommand::Old(old) => run(Cli { command: old.into(), ..cli }),
    }
}

/// Returns the documents of this build, for the web pages.
pub fn documents() -> Documents {
    Documents::new(avln_docs::SUMMARY, avln_docs::FILES)
}

fn run_challenge(data: &Path, command: ChallengeCommand) -> Result<(), Failure> {
    match command {
        ChallengeCommand::File(command) => block_on(challenge::run(data, command)),
        ChallengeCommand::Phase(command) => block_on(phase::run(data, command)),
        ChallengeCommand::Team(command) => block_on(team::run(data, command)),
        ChallengeCommand::Token(command) => block_on(team::run_token(data, command)),
        ChallengeCommand::Ruling(command) => block_on(challenge::rule(data, command)),
        // The sandbox is entered before any thread starts: namespaces apply to the calling thread only.
        ChallengeCommand::Sealed(sealed::SealedCommand::Enter(step)) => step.take(),
        ChallengeCommand::Sealed(command) => block_on(sealed::run(data, command)),
        ChallengeCommand::Leaderboard(command) => block_on(leaderboard::run(data, command)),
    }
}

async fn run_lab(data: &Path, command: LabCommand) -> Result<(), Failure> {
    match command {
        LabCommand::Baselines(command) => agents::run(command).await,
        LabCommand::Calibrate(args) => checks::calibrate(data, args).await,
        LabCommand::Rollout(args) => agents::roll_out(data, args).await,
        LabCommand::Doctor(args) => checks::diagnose(args).await,
        LabCommand::Conformance(args) => checks::check_conformance(args).await,
    }
}

/// Blocking tasks write logs and score episodes: more at once would wait for the disk, and tokio's default of 512 threads would
/// let a burst of ending episodes hold their memory. Agents in process need a thread per core besides.
const BLOCKING_THREADS: usize = 8;

fn block_on(command: impl Future<Output = Result<(), Failure>>) -> Result<(), Failure> {
    let threads = BLOCKING_THREADS.max(2 * processors());
    let runtime = Builder::new_multi_thread().max_blocking_threads(threads).enable_all().build();
    runtime.map_err(no_threads)?.block_on(command)
}

fn no_threads(error: io::Error) -> Failure {
    Failure::internal(format!("cannot start threads: {error}"))
}

#[derive(Clone, Debug, Args)]
pub(crate) struct ManualArgs {
    /// Folder; man1 and completions are created in it
    #[arg(value_name = "FOLDER")]
    out: PathBuf,
}

pub(crate) fn write_manual(args: &ManualArgs) -> Result<(), Failure> {
    let out = &args.out;
    write_pages(out)
        .map_err(|error| Failure::data(format!("cannot write into {}: {error}", out.display())))?;
    say!("{}/man1 and {}/completions are written", out.display(), out.display());
    Ok(())
}

fn write_pages(out: &Path) -> io::Result<()> {
    let [pages, completions] = ["man1", "completions"].map(|name| out.join(name));
    fs::create_dir_all(&pages)?;
    fs::create_dir_all(&completions)?;
    clap_mangen::generate_to(Cli::command(), &pages)?;
    for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
        clap_complete::generate_to(shell, &mut Cli::command(), "avln", &completions)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(words: &str) -> Cli {
        Cli::try_parse_from(words.split_whitespace()).unwrap_or_else(|error| panic!("{words}: {error}"))
    }

    fn current(command: TopCommand) -> String {
        match command {
            TopCommand::Old(old) => format!("{:?}", TopCommand::from(old)),
            command => format!("{command:?}"),
        }
    }

    #[test]
    fn old_spellings_mean_the_new_commands() {
        for (old, new) in [
            ("phase open p --split s", "challenge phase open p --split s"),
            ("phase close p", "challenge phase close p"),
            ("team add A", "challenge team add A"),
            ("team member list A", "challenge team member list A"),
            ("token list --json", "challenge token list --json"),
            ("ruling verified r --reason x", "challenge ruling verified r --reason x"),
            (
                "sealed run --phase p --team t --method m -- x",
                "challenge sealed run --phase p --team t --method m -- x",
            ),
            ("sealed enter plan", "challenge sealed enter plan"),
            ("board freeze --out x", "challenge leaderboard freeze --out x"),
            ("board oracle --phase p", "challenge leaderboard oracle --phase p"),
            ("split make val", "data split make val"),
            ("dataset build mini", "data dataset build mini"),
            ("db prune --older-than 90d", "data db prune --older-than 90d"),
            ("verify x.log --log-only", "run verify x.log --log-only"),
            ("rescore --phase p", "run rescore --phase p"),
            ("ladder run --out x", "lab baselines run --out x"),
            ("calibrate", "lab calibrate"),
            ("rollout --split s --out x", "lab rollout --split s --out x"),
            ("doctor --token t", "lab doctor --token t"),
            ("conformance --client 127.0.0.1:0", "lab conformance --client 127.0.0.1:0"),
        ] {
            let before = parsed(&format!("avln --data there {old}"));
            let after = parsed(
                &format!("avln {new} --data there").replace(" -- x --data there", " --data there -- x"),
            );
            assert_eq!(before.data, after.data, "{old}");
            assert_eq!(current(before.command), current(after.command), "{old}");
        }
    }

    #[test]
    fn data_folder_is_accepted_at_every_level() {
        for words in [
            "avln --data there challenge team add A",
            "avln challenge --data there team add A",
            "avln challenge team --data there add A",
            "avln challenge team add A --data there",
            "avln --data there serve",
            "avln serve --data there",
            "avln --data elsewhere serve --data there",
            "avln --data there admin health",
            "avln lab rollout --split s --out x --data there",
        ] {
            assert_eq!(parsed(words).data, Path::new("there"), "{words}");
        }
    }

    #[test]
    fn log_format_is_text_or_json() {
        assert_eq!(parsed("avln serve").log_format, LogFormat::Text);
        assert_eq!(parsed("avln serve --log-format json").log_format, LogFormat::Json);
        let refused = Cli::try_parse_from(["avln", "serve", "--log-format", "xml"]).unwrap_err();
        assert_eq!(refused.exit_code(), 2);
        assert!(refused.to_string().contains("[possible values: text, json]"), "{refused}");
    }

    #[test]
    fn help_hides_old_spellings() {
        let help = Cli::command().render_long_help().to_string();
        for word in ["  team ", "  board ", "  ladder ", "--data"] {
            assert!(!help.contains(word), "{word} in {help}");
        }
    }
}
