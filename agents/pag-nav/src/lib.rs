//! PAG-Nav: the reference agent, with options and two presets.
//!
//! Start reading at [`PagNav`] and [`run`]. [`Preset::PagNav`], the default, implements the formulas of section 4.1 of the paper, with a
//! small network (`avln-perception`) and a parser of words in place of large encoders:
//!
//! | formula of the paper | function or type |
//! |---|---|
//! | Psi_t = P(o_t, G), s_vis | `Recognition::see` and `Recognition::fit` of `avln_kit`: by default probability of the category, colour, size and shape words; for goal images, similarity of embeddings and views |
//! | z_i = phi(q_i) | `Query::new` of `avln_kit`: category, size, colours, neighbours and room by words, without an embedding; for images layout and colours of the view, and the embedding and category of the central object if there is one |
//! | Psi_aud | `avln_kit::hearing::Ear::hear` and `bearings_rad` |
//! | M_t = U(M_{t-1}, Psi_t, p_t, S_t) | `PagNav::perceive` in `agent.rs`; `StoreyMemory` in `memory.rs` is M_t of one storey |
//! | R_t, Psi_room, r(x) | `avln_kit::map::RoomMemory`: `see` adds the room cue of a frame, `around` returns r(x) |
//! | O_t, O_t(g) | `avln_kit::map::ObjectMemory::recognise`; `PagNav::select` filters by `associate` |
//! | A_int(l, x) = max(A_int(l, x), rho) | `avln_kit::map::IntensityMemory::hear`, cells of 0.5 m; l, not defined in the paper, is the storey |
//! | A_bear(g) = A_bear(g) ∪ {(p, beta, rho)} | `avln_kit::map::BearingMemory::hear`, re-weighted by `weigh` |
//! | F_t, reachable | `Occupancy::frontiers` and `avln_kit::path::ReachField`, in `PagNav::best_frontier` |
//! | S_search, x* | `PagNav::search_score`, `PagNav::best_frontier` in `search.rs` |
//! | P_room, P_obj, P_ctx | `avln_kit::map::GoalPrior::room`, `objects`, `context` |
//! | s_aud | `avln_kit::map::BearingMemory::alignment` |
//! | S_ground, o* | `candidate::Evidence::score`, `candidate::best` |
//! | s_int | `avln_kit::map::IntensityMemory::nearness`, in `PagNav::intensity` |
//! | viewpoint that improves the grounding | `PagNav::best_viewpoint` in `ground.rs` |
//! | pi_t: Search, Ground, Verify | `PagNav::decide`, `PagNav::stage` in `search.rs` |
//! | V_t(o*, g) | `verify::Verification::of`, from a `FreshLook` of the current frame |
//! | Submit_t = 1[V and distance and angle] | `verify::SubmitGate::warrant` |
//! | S_t | `mission::MissionState` |
//!
//! Choices and deviations:
//! - Network and models skip a frame within 0.45 m and 0.8 rad of the last recognised one, unless it may show the candidate from near.
//! - A sound does not identify its goal: A_bear receives each sound for all open goals, and older ones weigh less, since sources
//!   alternate. s_aud uses the direction from the place of hearing, for the current sound the agent, to the frontier. Two ears do not
//!   separate front from back: the better of both directions counts.
//! - In an unordered mission, the candidates of all open goals compete by S_ground. S_search is for the first open goal.
//! - The frontier stays the target for `keep_steps`. Ties are decided by the shorter way. When everything is explored, the map
//!   restarts.
//! - Frontiers behind unknown cells count only if no others are reachable. The gate also demands a free line of sight on the map. A
//!   frame that should show the candidate from near but does not lowers its s_vis.
//! - The bundled network sees images with much colour noise denoised. s_vis is a mean over about four views, in which older ones fade;
//!   after the first, views of the network that two image borders cut off count a quarter. A_bear merges similar bearings; the limit is
//!   200.
//! - Frontiers that were visited, or are nearer than 0.4 m, are skipped. The current o* has a bonus in S_ground, `loyalty`. A candidate
//!   that was viewed without success, with a mean s_vis below the floor, is set aside until its s_vis rises; one that was sought for too
//!   long, until the rest was searched or the last `hurry_steps` begin.
//! - lambda_a has a value for each formula, `search_audio` and `ground_audio`. s_int is the intensity memory near the candidate, equal
//!   for all goals. If a cue names a room, P_room is the probability of this room, otherwise that of the category in such a room.
//! - Psi_room is a table of room types by the objects in the frame, with their categories merged over all frames, P_ctx the mean of the
//!   priors of rooms and objects. Bearings through explored space without a candidate weigh as little as a fifth, and s_aud also weighs
//!   by level.
//! - If a cue names a neighbour, only this neighbour counts in P_obj. Without evidence P_obj is 0.3, more than that of unlikely pairs;
//!   P_room is then the mean over the room types, 0.1 for a named room, and 0.3 without a known category. Frontiers with fewer than
//!   four border cells in a block of ten by ten are dropped.
//! - The gate measures distance, bearing and sight to the nearest point of the candidate's box, or to the centre from within 0.3 m of
//!   the box; with an estimated source to the point of the box nearest to the source. The box is merged from all detections of the
//!   object: the part in the current frame, which V verifies, may be farther away.
//! - V also needs `verify_looks` near views at least 0.2 m apart, fewer after a long search or near the end; stage Verify needs these
//!   views and a mean s_vis of at least the floor. Only candidates with S_ground of at least `plausible` are compared. A candidate
//!   without another viewpoint is set aside if none was reached at the end of the path to it.
//! - Without a verdict, a goal counts as completed after its Submit. The object of a completed goal or a wrong verdict is no candidate any
//!   more.
//! - With one open goal, or without a remaining Submit, the verified claim is a Stop: an N-th Submit is never sent. Without a
//!   verified candidate the episode ends at the step limit.
//!
//! [`Preset::PagNavPlus`] adds the extensions in [`Switches`] and has other weights: `search_tie`, `ground_vis`, `ground_context`,
//! `ground_audio`, `plausible`, `verify_floor`, `submit_m`, `hurry_steps` and `source_steps`. In both presets, every Submit and Stop
//! follows a verification in the current frame, with s_vis of this look at or above `verify_floor`: only `verify::Warrant::claim`
//! creates these actions, and only an open gate creates a `Warrant`, or the ablation `no_gate`. Patience and hurry lower the number of
//! looks, never the floor. Without a located source at the candidate, the floor is the higher `verify_unheard`. Sound never completes a
//! goal by itself.
//!
//! With `silence_outcomes`, if found targets fall silent, an open gate also waits for sound:
//! - A located source that supports the candidate suffices, at the start of its turn only after three steps. Otherwise the current
//!   source must be within `look_range_m` by its mean level over three steps, possibly at the candidate, with two more steps of sound.
//! - Meanwhile the agent turns to and fro. It sets the candidate aside if every open source is faint there or certainly elsewhere, or
//!   after waiting for a cycle of the sounding windows and 5 steps.
//! - The candidate returns once everything reachable is explored; set aside only once, also when a located source supports it.
//! - The last `hurry_steps` of the episode, 80 in PAG-Nav+, need no sound: the agent stops waiting, and these candidates return.
//!
//! The files in `presets/` document all [`Weights`]. [`Ablation`] disables parts of the agent; [`PagNav::hinted`] measures the value
//! of perfect hearing, for privileged variants only. The agent is *learnt perception*: its network was trained on training houses.
//! With `avln_kit::perception::ClassicalRecognition` it is training-free; it then predicts no category for a goal image, whose priors
//! are neutral.
//!
//! This crate links no server crate other than `avln-simd` and uses no information beyond observations (except [`PagNav::hinted`]).

mod agent;
mod candidate;
mod ground;
mod memory;
mod mission;
mod outcome;
mod preset;
#[cfg(test)]
mod proof;
mod search;
mod sources;
mod stairs;
mod trace;
mod verify;
mod weights;

pub use agent::PagNav;
pub use preset::{Ablation, Preset, Switch, Switches};
pub use trace::{Recorder, TraceError, TraceSummary, summarise};
pub use weights::{Weights, WeightsError};

use avln_client::{MethodType, RunSummary, Sensors};
use avln_kit::onnx::{ModelsError, OnnxRecognition, SharedFailure};
use avln_kit::perception::ClassicalRecognition;
use avln_kit::run::{AgentArgs, Method, OnEnd, play};
use clap::Args;
use std::path::PathBuf;

/// Command-line arguments of the agent.
#[derive(Args, Clone, Debug)]
pub struct PagNavArgs {
    /// Run, image size and slots.
    #[command(flatten)]
    pub run: AgentArgs,
    /// Weights and extensions
    #[arg(long, value_enum, default_value_t, value_name = "NAME")]
    pub preset: Preset,
    /// Name of the method on the leaderboard; default: PAG-Nav or PAG-Nav+, followed by `classical` with --classical
    #[arg(long, value_name = "NAME")]
    pub method: Option<String>,
    /// Recognise objects by depth and colours, without a network: the training-free variant
    #[arg(long, conflicts_with = "models")]
    pub classical: bool,
    /// TOML file with weights and switches that override the preset; agents/pag-nav/presets documents them
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
    let method = method(&args, agents.first());
    let played = play(args.run, method, &mut agents, on_end).await;
    // All of them, also after an error of one.
    let traced: Vec<_> = agents.iter_mut().map(PagNav::end_trace).collect();
    let summary = played?;
    if let Some(problem) = failures.iter().find_map(|failure| failure.get()) {
        return Err(PagNavError::Unseen { problem: problem.to_string(), summary: Box::new(summary) });
    }
    match traced.into_iter().collect::<Result<(), _>>() {
        Ok(()) => Ok(summary),
        Err(problem) => Err(PagNavError::Untraced { problem, summary: Box::new(summary) }),
    }
}

/// Returns the method's name, type and sensors.
fn method(args: &PagNavArgs, agent: Option<&PagNav>) -> Method {
    let method_type = agent.map_or(MethodType::LearntPerception, PagNav::method_type);
    let suffix = if args.classical { " classical" } else { "" };
    let name = args.method.clone().unwrap_or_else(|| format!("{}{suffix}", args.preset.method()));
    Method { name, version: env!("CARGO_PKG_VERSION"), method_type, sensors: Sensors::square(args.run.size) }
}

/// Creates an agent. Failures of its models appear in `failures`.
fn agent(args: &PagNavArgs, failures: &mut Vec<SharedFailure>) -> Result<PagNav, PagNavError> {
    let weights = match &args.weights {
        Some(file) => Weights::read(args.preset, file)?,
        None => args.preset.weights(),
    };
    let mut agent = PagNav::new(weights);
    if let Some(file) = &args.models {
        let models = OnnxRecognition::load(file)?;
        failures.push(models.failure());
        agent = agent.seeing(models);
    }
    if args.classical {
        agent = agent.seeing(ClassicalRecognition::default());
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

    #[test]
    fn classical_variant_is_training_free() {
        let parsed = |options: &[&str]| Cli::try_parse_from([&["agent", "--token", "t"], options].concat());
        let method = |options: &[&str]| {
            let args = parsed(options).unwrap().args;
            let Method { name, method_type, .. } = method(&args, agent(&args, &mut Vec::new()).ok().as_ref());
            (name, method_type)
        };
        assert_eq!(method(&["--classical"]), ("PAG-Nav classical".to_owned(), MethodType::TrainingFree));
        let plus = method(&["--preset", "pag-nav-plus"]);
        assert_eq!(plus, ("PAG-Nav+".to_owned(), MethodType::LearntPerception));
        assert!(parsed(&["--classical", "--models", "m.toml"]).is_err());
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
