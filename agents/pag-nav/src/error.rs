use crate::{TraceError, WeightsError};
use avln_client::RunSummary;
use avln_onnx::ModelsError;

/// Why a run of the agent failed.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The run could not begin, or not go on.
    #[error(transparent)]
    Run(#[from] avln_client::Error),
    /// Its weights cannot be used; no run was begun.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// The models that it should see by cannot be used; no run was begun.
    #[error(transparent)]
    Models(#[from] ModelsError),
    /// Nothing can be written where traces should lie; no run was begun.
    #[error(transparent)]
    Trace(#[from] TraceError),
    /// The run was played to its end, and a model failed on the way: what it was shown then was not seen.
    #[error("{problem}. The run itself came to its end:\n{summary}")]
    Unseen {
        /// What failed first.
        problem: String,
        /// How the run ended.
        summary: Box<RunSummary>,
    },
    /// The run was played to its end, and traces of it are missing or end early.
    #[error("{problem}. The run itself came to its end:\n{summary}")]
    Untraced {
        /// The first thing that could not be written.
        problem: TraceError,
        /// How the run ended.
        summary: Box<RunSummary>,
    },
}
