//! Phases: opening, pausing and closing.

use crate::output::say;
use avln_arena::{
    Failure,
    actions::{self, Attribution},
    challenge,
    data::DataFolder,
    now_unix_ms,
    setup::{NewPhase, open_phase},
};
use avln_episode::FeedbackRule;
use avln_store::{Phase, QuotaLimits, Schedule, Store, Visibility};
use clap::{Args, Subcommand, ValueEnum};
use std::path::{Path, PathBuf};

#[derive(Debug, Subcommand)]
pub(crate) enum PhaseCommand {
    /// Open a phase on a split, or change settings
    Open(OpenPhaseArgs),
    /// Close a phase: no more runs can start
    Close {
        /// Phase id
        id: String,
    },
    /// Pause a phase: no runs can start, started runs continue
    Pause {
        /// Phase id
        id: String,
        /// Reason, public
        #[arg(long, value_name = "TEXT")]
        reason: String,
    },
    /// Reopen a paused or closed phase, within the phase's dates
    Resume {
        /// Phase id
        id: String,
    },
}

#[derive(Clone, Debug, Args)]
pub(crate) struct OpenPhaseArgs {
    /// Phase id, for URLs and agents
    id: String,
    /// Split name, in the data folder or in the data set of --dataset
    #[arg(long)]
    split: String,
    /// Data set folder made by avln data dataset build
    #[arg(long, value_name = "DIR")]
    dataset: Option<PathBuf>,
    /// Title on pages; the id by default
    #[arg(long)]
    title: Option<String>,
    /// Score visibility
    #[arg(long, value_enum, default_value_t = VisibleTo::Public)]
    scores: VisibleTo,
    /// Visibility for paths, maps and targets
    #[arg(long, value_enum, default_value_t = VisibleTo::Public)]
    replays: VisibleTo,
    /// Rule set; the split's by default. It may differ only in noise, sounds and claims: a split for lh-avln-v1 can be
    /// played with lh-avln-noisy-v1, lh-avln-distinct-v1 and lh-avln-hard-v1
    #[arg(long)]
    rules: Option<String>,
    /// Sound clips for targets: a share of the synthetic clips (all, train, validation or test), or a folder
    /// with WAV and FLAC files of 1 to 60 s, which are copied to the data folder. By default the share for
    /// the houses' furniture pool; all clips for scenes from files
    #[arg(long, value_name = "WHAT")]
    sounds: Option<String>,
    /// SOFA file with a measured head, instead of a sphere; it is copied to the data folder
    #[arg(long, value_name = "FILE.sofa")]
    head: Option<PathBuf>,
    /// Feedback to a Submit; the rule set's by default
    #[arg(long, value_enum)]
    feedback: Option<FeedbackLevel>,
    /// Run limit per team; unlimited by default
    #[arg(long, value_name = "RUNS")]
    quota: Option<u32>,
    /// Limit for concurrent runs per team; 1 by default if scores or replays are not public, otherwise unlimited
    #[arg(long, value_name = "RUNS", value_parser = clap::value_parser!(u32).range(1..))]
    concurrent: Option<u32>,
    /// Limit for uncharged runs per team; 20 by default with `--quota`, or if scores or replays are not public, otherwise unlimited
    #[arg(long, value_name = "RUNS", value_parser = clap::value_parser!(u32).range(1..))]
    uncharged: Option<u32>,
    /// Limit for parallel episodes per run
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=64))]
    max_slots: u32,
    /// Largest image side in pixels
    #[arg(long, default_value_t = 512, value_parser = clap::value_parser!(u32).range(64..=1024))]
    max_side: u32,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum VisibleTo {
    /// Everyone.
    Public,
    /// The run's team.
    Team,
    /// The organiser.
    Organiser,
}

/// Feedback to a Submit.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum FeedbackLevel {
    /// Nothing.
    None,
    /// Confirmation that it was counted.
    Accepted,
    /// Success or failure.
    Verdict,
}

pub(crate) async fn run(data: &Path, command: PhaseCommand) -> Result<(), Failure> {
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
                return Err(Failure::data("--reason is empty")
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

async fn reschedule(
    store: &Store,
    id: &str,
    reason: &str,
    change: impl FnOnce(&mut Schedule),
) -> Result<Phase, Failure> {
    Ok(actions::reschedule(store, id, Attribution { actor: &challenge::actor(), reason }, change).await?)
}

/// Default of `--concurrent` for hidden phases: parallel runs would show a mission several times before the first result.
const HIDDEN_CONCURRENT: u32 = 1;

impl From<OpenPhaseArgs> for NewPhase {
    fn from(open: OpenPhaseArgs) -> Self {
        let (scores, replays): (Visibility, Visibility) = (open.scores.into(), open.replays.into());
        let is_hidden = [scores, replays] != [Visibility::Public; 2];
        Self {
            id: open.id,
            split: open.split,
            dataset: open.dataset,
            title: open.title,
            scores,
            replays,
            rules: open.rules,
            sounds: open.sounds,
            head: open.head,
            feedback: open.feedback.map(FeedbackRule::from),
            quota: open.quota,
            concurrent: open.concurrent.or(is_hidden.then_some(HIDDEN_CONCURRENT)),
            uncharged: open.uncharged.or(is_hidden.then_some(QuotaLimits::DEFAULT_UNCHARGED)),
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
