//! PAG-Nav: the reference agent.
//!
//! Start reading at [`PagNav`] and [`run`]. The agent follows section 4 of the paper, with a small network
//! (`avln-perception`) in place of large encoders:
//!
//! | paper | here |
//! |---|---|
//! | object memory O_t | `avln_kit::map::ObjectMemory`: boxes, colours, looks, and compatibility with each goal |
//! | audio memories A_int, A_bear | `avln_kit::map::IntensityMemory` and `SourceBelief`, one of each per sounding target |
//! | spatial frame, occupancy | `avln_kit::map::Occupancy`, one per storey (`Storeys`); `Elevation` detects stairs |
//! | room memory R_t, P_room, P_obj, P_ctx | `ObjectMemory::context`: rooms inferred from typical objects |
//! | s_vis | `Recognition::fit`; by default probability of the category, colour, size and shape words; for image goals, similarity of embeddings and views |
//! | S_search, S_ground | `decide.rs`, `candidate::Evidence::score` |
//! | Search, Ground, Verify | `candidate::Stage` |
//! | V, Submit gate | `candidate::VerificationDemand` and the comparison of goals in `goals::GoalPairing`; `candidate::SubmitGate` |
//!
//! Three additions to the paper:
//! - V becomes less strict the longer a source has been sought, and near the end of the episode (`VerificationDemand::after`).
//! - After a long unsuccessful search on one storey the agent takes stairs (`stairs.rs`).
//! - If the phase returns no feedback to a Submit, the agent waits at an open gate until the target sounds again: only silence after the
//!   Submit is evidence. If found targets fall silent later (`SilenceRule`), it waits until a right Submit must have silenced the target.
//!
//! [`Weights`] are the tunable numbers, documented in `pag-nav.toml`. [`Ablation`] disables parts of the agent;
//! [`PagNav::hinted`] measures the value of perfect hearing, for privileged variants only.
//!
//! This crate links no server crate other than `avln-simd` and uses no information beyond observations (except [`PagNav::hinted`]).

mod agent;
mod candidate;
mod decide;
mod goals;
mod stairs;
mod trace;
mod weights;

pub use agent::PagNav;
pub use trace::{Recorder, TraceError};
pub use weights::{Ablation, Weights, WeightsError};

use avln_client::{RunSummary, Sensors};
use avln_kit::onnx::{ModelsError, OnnxRecognition, SharedFailure};
use avln_kit::run::{AgentArgs, Method, OnEnd, play};
use clap::Args;
use std::path::PathBuf;

/// Command-line arguments of the agent.
#[derive(Args, Clone, Debug)]
pub struct PagNavArgs {
    /// Run, image size and slots.
    #[command(flatten)]
    pub run: AgentArgs,
    /// Name of the method on the leaderboard
    #[arg(long, default_value = "PAG-Nav", value_name = "NAME")]
    pub method: String,
    /// TOML file with weights that override the defaults; agents/pag-nav/pag-nav.toml documents them
    #[arg(long, value_name = "FILE")]
    pub weights: Option<PathBuf>,
    /// TOML file of ONNX models to use instead of the bundled network; docs/models.md documents it
    #[arg(long, value_name = "FILE")]
    pub models: Option<PathBuf>,
    /// Folder for traces: a file per episode with observations, beliefs and actions step by step
    #[arg(long, value_name = "FOLDER")]
    pub trace: Option<PathBuf>,
}

/// Reasons for a failed run of the agent.
#[derive(Debug, thiserror::Error)]
pub enum PagNavError {
    /// The run could not begin or continue.
    #[error(transparent)]
    Run(#[from] avln_client::Error),
    /// The weights are invalid; no run was begun.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// The models are invalid; no run was begun.
    #[error(transparent)]
    Models(#[from] ModelsError),
    /// The trace folder is not writable; no run was begun.
    #[error(transparent)]
    Trace(#[from] TraceError),
    /// A model failed during the run; the agent did not see the affected images.
    #[error("{problem}. The run is complete:\n{summary}")]
    Unseen {
        /// First failure.
        problem: String,
        /// Summary of the run.
        summary: Box<RunSummary>,
    },
    /// Traces of the run are missing or incomplete.
    #[error("{problem}. The run is complete:\n{summary}")]
    Untraced {
        /// First failure.
        problem: TraceError,
        /// Summary of the run.
        summary: Box<RunSummary>,
    },
}

/// Plays one run with [`PagNav`]; fails if arguments are invalid, or the run, a model or a trace fails.
pub async fn run(args: PagNavArgs) -> Result<RunSummary, PagNavError> {
    run_with(args, &mut |_| {}).await
}

/// Plays one run with [`PagNav`] like [`run`], and calls `on_end` after each episode.
pub async fn run_with(args: PagNavArgs, on_end: OnEnd<'_>) -> Result<RunSummary, PagNavError> {
    // Agents are created first: invalid files must not use up a run.
    let mut failures = Vec::new();
    let mut agents = args.run.agents(|| agent(&args, &mut failures))?;
    let sensors = Sensors::square(args.run.size);
    let method = Method { name: args.method, version: env!("CARGO_PKG_VERSION"), sensors };
    let played = play(args.run, method, &mut agents, on_end).await;
    let traced = agents.iter_mut().try_for_each(PagNav::end_trace);
    let summary = played?;
    if let Some(problem) = failures.iter().find_map(|failure| failure.get()) {
        return Err(PagNavError::Unseen { problem: problem.to_string(), summary: Box::new(summary) });
    }
    match traced {
        Ok(()) => Ok(summary),
        Err(problem) => Err(PagNavError::Untraced { problem, summary: Box::new(summary) }),
    }
}

/// Creates an agent. Failures of its models appear in `failures`.
fn agent(args: &PagNavArgs, failures: &mut Vec<SharedFailure>) -> Result<PagNav, PagNavError> {
    let weights = args.weights.as_deref().map_or_else(|| Ok(Weights::default()), Weights::read)?;
    let mut agent = PagNav::new(weights);
    if let Some(file) = &args.models {
        let models = OnnxRecognition::load(file)?;
        failures.push(models.failure());
        agent = agent.seeing(models);
    }
    if let Some(folder) = &args.trace {
        agent = agent.traced(Recorder::new(folder)?);
    }
    Ok(agent)
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;
    use std::fs;

    #[derive(Parser)]
    struct Cli {
        #[command(flatten)]
        args: PagNavArgs,
    }

    #[tokio::test]
    async fn invalid_files_are_refused_before_the_run() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("my.toml");
        fs::write(&file, "submit_m = 99").unwrap();
        let path = file.to_str().unwrap();
        for (option, words) in [
            ("--weights", "my.toml: submit_m is 99, "),
            ("--models", "my.toml: "),
            ("--trace", "--trace a writable folder"),
        ] {
            // The address is unreachable: an attempt to begin a run would fail with another error.
            let command = ["agent", "--token", "t", "--server", "http://127.0.0.1:1", option, path];
            let refused = run(Cli::try_parse_from(command).unwrap().args).await;
            let error = refused.unwrap_err().to_string();
            assert!(error.contains(words), "{option}: {error}");
        }
    }
}
