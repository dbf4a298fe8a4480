//! Phases: what can be played, and who may see the results.

use crate::output::say;
use avln_arena::{
    Failure, FailureKind, challenge,
    data::DataFolder,
    now_unix_ms,
    office::deeds,
    setup::{NewPhase, open_phase},
};
use avln_episode::FeedbackRule;
use avln_store::{Phase, Schedule, Store, Visibility};
use clap::{Args, Subcommand, ValueEnum};
use std::path::{Path, PathBuf};

/// Commands about phases.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Open a phase on a split, or change one
    Open(Open),
    /// Let no more runs start in a phase
    Close {
        /// Id of the phase
        id: String,
    },
    /// Let no run start in a phase for now; runs that were started go on
    Pause {
        /// Id of the phase
        id: String,
        /// Why, for everybody to read
        #[arg(long, value_name = "TEXT")]
        reason: String,
    },
    /// Let runs start again in a phase that was paused or closed by hand; its dates still hold
    Resume {
        /// Id of the phase
        id: String,
    },
}

/// How a phase is set up.
#[derive(Clone, Debug, Args)]
pub struct Open {
    /// Id, used in URLs and by agents
    pub id: String,
    /// The split that is played: one of the data folder, or one of the data set of --dataset
    #[arg(long)]
    pub split: String,
    /// The folder of a data set, as avln data dataset build makes it
    #[arg(long, value_name = "DIR")]
    pub dataset: Option<PathBuf>,
    /// Heading on pages; the id by default
    #[arg(long)]
    pub title: Option<String>,
    /// Who may see scores
    #[arg(long, value_enum, default_value_t = Who::Public)]
    pub scores: Who,
    /// Who may see paths, maps and targets
    #[arg(long, value_enum, default_value_t = Who::Public)]
    pub replays: Who,
    /// The rule set that is played; the split's by default. Another must differ from it in noise and clips alone: a split
    /// made for lh-avln-v1 can be played by lh-avln-noisy-v1 and lh-avln-distinct-v1
    #[arg(long)]
    pub rules: Option<String>,
    /// What targets play: a share of the clips made by rule (all, train, validation or test), or a folder with WAV and FLAC
    /// files of 1 to 60 s, which the data folder keeps a copy of. By default the share of the pool that the split's houses
    /// are furnished from, and all clips in scenes that were read from files
    #[arg(long, value_name = "WHAT")]
    pub sounds: Option<String>,
    /// Hear with a measured head instead of a sphere: a SOFA file of head-related impulse responses, which the data folder
    /// keeps a copy of
    #[arg(long, value_name = "FILE.sofa")]
    pub head: Option<PathBuf>,
    /// What an agent learns from a Submit; the rule set says it by default
    #[arg(long, value_enum)]
    pub feedback: Option<Told>,
    /// Runs that a team may start; any number by default
    #[arg(long, value_name = "RUNS")]
    pub quota: Option<u32>,
    /// Episodes that a run may play side by side
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=64))]
    pub max_slots: u32,
    /// Largest side of a picture that an agent may ask for, pixels
    #[arg(long, default_value_t = 512, value_parser = clap::value_parser!(u32).range(64..=1024))]
    pub max_side: u32,
}

/// Who may see something.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Who {
    /// Everybody.
    Public,
    /// The team whose run it is.
    Team,
    /// The organiser alone.
    Organiser,
}

/// What an agent learns from a Submit.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Told {
    /// Nothing.
    None,
    /// That it was counted.
    Accepted,
    /// Whether it completed a goal.
    Verdict,
}

/// Carries out a command about phases.
///
/// # Errors
/// When the split is unknown or the database refuses.
pub async fn run(data: &Path, command: Command) -> Result<(), Failure> {
    let data = DataFolder::open(data)?;
    let store = data.store().await?;
    match command {
        Command::Open(options) => {
            let phase = open_phase(&data, &store, &options.into()).await?;
            say!("phase {} is open: {} episodes under {}", phase.id, phase.episodes.len(), phase.rules.name);
            if let Some(leak) = phase.rules.leaks() {
                say!("its sound leaks: {leak}");
            }
            say!("host it with: avln serve");
        }
        Command::Close { id } => {
            reschedule(&store, &id, "", |schedule| schedule.closed = true).await?;
            say!("phase {id} is closed; its results stay");
        }
        Command::Pause { id, reason } => {
            let words = reason.trim().to_owned();
            if words.is_empty() {
                return Err(Failure::new(FailureKind::Data, "--reason is empty")
                    .hinted("say why, for everybody to read: --reason \"the server moves\""));
            }
            reschedule(&store, &id, &reason, |schedule| schedule.paused = Some(words)).await?;
            say!("phase {id} is paused; runs that were started go on");
        }
        Command::Resume { id } => {
            let phase = reschedule(&store, &id, "", |schedule| {
                (schedule.paused, schedule.closed) = (None, false);
            });
            let state = phase.await?.schedule.state(now_unix_ms());
            say!("phase {id} is {}", deeds::state_word(state));
        }
    }
    Ok(())
}

/// Changes when runs may start in a phase, with a note in the audit list.
async fn reschedule(
    store: &Store,
    id: &str,
    reason: &str,
    change: impl FnOnce(&mut Schedule),
) -> Result<Phase, Failure> {
    Ok(deeds::reschedule(store, id, (&challenge::actor(), reason), change).await?)
}

impl From<Open> for NewPhase {
    fn from(open: Open) -> Self {
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

impl From<Who> for Visibility {
    fn from(who: Who) -> Self {
        match who {
            Who::Public => Self::Public,
            Who::Team => Self::Team,
            Who::Organiser => Self::Organiser,
        }
    }
}

impl From<Told> for FeedbackRule {
    fn from(told: Told) -> Self {
        match told {
            Told::None => Self::None,
            Told::Accepted => Self::Accepted,
            Told::Verdict => Self::Verdict,
        }
    }
}
