//! Facts of a split that may be published: measured agents must not know them before.

use avln_arena::{Failure, FailureKind, data::DataFolder, dataset::SplitFolder};
use avln_dataset::{SceneLine, SceneSource};
use avln_houses::Pool;
use avln_store::{Phase, Visibility};

/// Extent of a publication.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Openness {
    /// Missions and ground truth: it is there to learn from.
    Training,
    /// Facts that agents receive in any case: agents are measured by the split, or no phase excludes it.
    Public,
}

impl Openness {
    /// Openness of a split, if `phases` is the complete list; `is_training` is the owner's statement about scenes that were
    /// read from files, which nothing else tells.
    ///
    /// # Errors
    /// When it is hidden: sealed, furnished from the test pool, or played by a phase whose targets not everybody may see.
    pub fn of(split: &SplitFolder, phases: &[Phase], is_training: bool) -> Result<Self, Failure> {
        if let Some(why) = hidden(split, phases) {
            let message = format!("split '{}' is hidden: {why}", split.name());
            return Err(Failure::new(FailureKind::Scene, message)
                .hinted("nothing of it is handed out; take one that agents may learn from or know of"));
        }
        let learnt_from = |scene: &SceneLine| match scene.source {
            SceneSource::Procedural { pool, .. } => pool == Pool::Train,
            SceneSource::File { .. } => is_training,
        };
        Ok(if split.scenes().iter().all(learnt_from) { Self::Training } else { Self::Public })
    }

    /// Refuses all but what is there to learn from.
    ///
    /// # Errors
    /// When the split is not.
    pub fn check_training(self, split: &SplitFolder) -> Result<(), Failure> {
        if self == Self::Training {
            return Ok(());
        }
        let message = format!("split '{}' is not for training", split.name());
        Err(Failure::new(FailureKind::Scene, message).hinted(
            "take one whose houses show furniture of the training pool; where scenes were read from files, --training says \
             that they are there to learn from",
        ))
    }
}

/// Why nothing of a split may be handed out.
fn hidden(split: &SplitFolder, phases: &[Phase]) -> Option<String> {
    if split.is_sealed() {
        return Some("its files are sealed".to_owned());
    }
    let is_of_tests =
        |scene: &SceneLine| matches!(scene.source, SceneSource::Procedural { pool: Pool::Test, .. });
    if split.scenes().iter().any(is_of_tests) {
        return Some("its houses show furniture of the test pool".to_owned());
    }
    let phase = phases.iter().find(|phase| phase.replays != Visibility::Public)?;
    Some(format!("phase '{}' plays it and does not show targets to everybody", phase.id))
}

/// Returns the phases of the data folder whose split has the digest of `split`; the name may differ.
///
/// # Errors
/// If the database cannot be read.
pub async fn phases_of(data: &DataFolder, split: &SplitFolder) -> Result<Vec<Phase>, Failure> {
    if !data.root().join("avln.db").is_file() {
        return Ok(Vec::new());
    }
    let store = data.store().await?;
    let mut phases = Vec::new();
    for phase in store.phases().await? {
        if store.split_digest(&phase.split).await?.as_deref() == Some(split.digest()) {
            phases.push(phase);
        }
    }
    store.close().await;
    Ok(phases)
}
