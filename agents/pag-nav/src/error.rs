use crate::WeightsError;

/// Why a run of the agent failed.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The run could not begin, or not go on.
    #[error(transparent)]
    Run(#[from] avln_client::Error),
    /// Its weights cannot be used; no run was begun.
    #[error(transparent)]
    Weights(#[from] WeightsError),
}
