//! Phases: opening, pausing and closing.

use crate::output::say;
use avln_arena::{
    Failure, FailureKind, actions, challenge,
    data::DataFolder,
    now_unix_ms,
    setup::{NewPhase, open_phase},
};
use avln_episode::FeedbackRule;
use avln_store::{Phase, Schedule, Store, Visibility};
use clap::{Args, Subcommand, ValueEnum};
use std::path::{Path, PathBuf};

/// Commands on phases.
#[derive(Debug, Subcommand)]
pub enum PhaseCommand {
    /// Open a phase on a split, or change its settings
    Open(OpenPhaseArgs),
    /// Close a phase: no more runs can start
    Close {
        /// Id of the phase
        id: String,
    },
    /// Pause a phase: no runs can start, started runs continue
    Pause {
        /// Id of the phase
        id: String,
        /// Reason, public
        /// Reason, for the audit list
        #[arg(long, value_name = "TEXT")]
        reason: String,
    },
    /// Reopen a paused or closed phase, within its dates
    Resume {
        /// Id of the phase
        id: String,
    },
}

/// Arguments of `open`.
#[derive(Clone, Debug, Args)]
pub struct OpenPhaseArgs {
    /// Id of the phase, for URLs and agents
    pub id: String,
    /// Name of the split, in the data folder or in the data set of --dataset
    #[arg(long)]
    pub split: String,
    /// Folder of a data set made by avln data dataset build
    #[arg(long, value_name = "DIR")]
    pub dataset: Option<PathBuf>,
    /// Title on pages; the id by default
    #[arg(long)]
    pub title: Option<String>,
    /// Visibility of scores
    #[arg(long, value_enum, default_value_t = VisibleTo::Public)]
    pub scores: VisibleTo,
    /// Visibility of paths, maps and targets
    #[arg(long, value_enum, default_value_t = VisibleTo::Public)]
    pub replays: VisibleTo,
    /// Rule set; that of the split by default. It may differ only in noise and clips: a split for lh-avln-v1 can be played with
    /// lh-avln-noisy-v1 and lh-avln-distinct-v1
    #[arg(long)]
    pub rules: Option<String>,
    /// Sound clips of targets: a share of the synthetic clips (all, train, validation or test), or a folder of WAV and FLAC files
    /// of 1 to 60 s, which are copied to the data folder. By default the share of the houses' furniture pool; all clips for
    /// scenes from files
    #[arg(long, value_name = "WHAT")]
    pub sounds: Option<String>,
    /// SOFA file of a measured head, instead of a sphere; it is copied to the data folder
    #[arg(long, value_name = "FILE.sofa")]
    pub head: Option<PathBuf>,
    /// Feedback to a Submit; that of the rule set by default
    #[arg(long, value_enum)]
    pub feedback: Option<FeedbackLevel>,
    /// Largest number of runs per team; unlimited by default
    #[arg(long, value_name = "RUNS")]
    pub quota: Option<u32>,
    /// Largest number of parallel episodes per run
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=64))]
    pub max_slots: u32,
    /// Largest side of pictures in pixels
    #[arg(long, default_value_t = 512, value_parser = clap::value_parser!(u32).range(64..=1024))]
    pub max_side: u32,
}

/// The audience of scores or replays.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum VisibleTo {
    /// Everyone.
    Public,
    /// The run's team.
    Team,
    /// The organiser.
    Organiser,
}

/// Feedback to a Submit.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum FeedbackLevel {
    /// Nothing.
    None,
    /// Confirmation that it was counted.
    Accepted,
    /// Success or failure.
    Verdict,
}

/// Runs a command on phases.
///
/// # Errors
/// If the split is unknown or the database fails.
pub async fn run(data: &Path, command: PhaseCommand) -> Result<(), Failure> {
    let data = DataFolder::open(data)?;
    let store = data.store().await?;
    match command {
        PhaseCommand::Open(args) => {
            let phase = open_phase(&data, &store, &args.into()).await?;
            say!("phase {} is open: {} episodes under {}", phase.id, phase.episodes.len(), phase.rules.name);
            if let Some(leak) = phase.rules.leaks() {
                say!("its sound leaks: {leak}");
            }
            say!("host it with: avln serve");
        }
        PhaseCommand::Close { id } => {
            reschedule(&store, &id, "", |schedule| schedule.closed = true).await?;
            say!("phase {id} is closed; its results remain");
        }
        PhaseCommand::Pause { id, reason } => {
            let words = reason.trim().to_owned();
            if words.is_empty() {
                return Err(Failure::new(FailureKind::Data, "--reason is empty")
                    .hinted("say why; visitors can read it: --reason \"the server moves\""));
            }
            reschedule(&store, &id, &reason, |schedule| schedule.paused = Some(words)).await?;
            say!("phase {id} is paused; started runs continue");
        }
        PhaseCommand::Resume { id } => {
            let phase = reschedule(&store, &id, "", |schedule| {
                (schedule.paused, schedule.closed) = (None, false);
            });
            let state = phase.await?.schedule.state(now_unix_ms());
            say!("phase {id} is {}", actions::state_word(state));
        }
    }
    Ok(())
}

/// Changes the schedule of a phase, with an entry in the audit list.
async fn reschedule(
    store: &Store,
    id: &str,
    reason: &str,
    change: impl FnOnce(&mut Schedule),
) -> Result<Phase, Failure> {
    Ok(actions::reschedule(store, id, (&challenge::actor(), reason), change).await?)
}

impl From<OpenPhaseArgs> for NewPhase {
    fn from(open: OpenPhaseArgs) -> Self {
        Self {
            id: open.id,
            split: open.split,
            dataset: open.dataset,
            title: open.title,
            scores: open.scores.into(),
            replays: open.replays.into(),
            rules: open.rules,
            sounds: open.sounds,
            head: open.head,
            feedback: open.feedback.map(FeedbackRule::from),
            quota: open.quota,
            max_slots: open.max_slots,
            max_side: open.max_side,
        }
    }
}

impl From<VisibleTo> for Visibility {
    fn from(who: VisibleTo) -> Self {
        match who {
            VisibleTo::Public => Self::Public,
            VisibleTo::Team => Self::Team,
            VisibleTo::Organiser => Self::Organiser,
        }
    }
}

impl From<FeedbackLevel> for FeedbackRule {
    fn from(told: FeedbackLevel) -> Self {
        match told {
            FeedbackLevel::None => Self::None,
            FeedbackLevel::Accepted => Self::Accepted,
            FeedbackLevel::Verdict => Self::Verdict,
        }
    }
}
