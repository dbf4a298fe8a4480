use super::warm::Warm;
use avln_dataset::{DatasetError, SceneSpec};
use avln_episode::Rules;
use avln_world::Cache;
use avln_world::SceneAssets;
use std::sync::Arc;

/// Prepared scenes that running episodes share, by digest and rules.
pub(super) struct SceneCache {
    warm: Warm<(String, String), SceneAssets>,
    cache: Arc<dyn Cache>,
}

impl SceneCache {
    /// Creates a cache with `budget_bytes` of memory; render data is stored in `cache`.
    pub(super) fn new(budget_bytes: usize, cache: Arc<dyn Cache>) -> Self {
        Self { warm: Warm::new(budget_bytes, SceneAssets::resident_bytes), cache }
    }

    /// Bytes of the scenes that are ready.
    pub(super) fn bytes(&self) -> usize {
        self.warm.bytes()
    }

    /// The scene, prepared for the rules' body, and whether it was made now because it was not ready: heavy on the
    /// processor then.
    ///
    /// # Errors
    /// When the scene cannot be read, has changed, or no body can move in it.
    pub(super) fn get(
        &self,
        scene: &SceneSpec,
        rules: &Rules,
    ) -> Result<(Arc<SceneAssets>, bool), DatasetError> {
        let key = (scene.digest.clone(), rules.name.clone());
        self.warm.get(key, || scene.open_with(rules, Some(&self.cache)))
    }
}
