use avln_dataset::{DatasetError, SceneSpec};
use avln_episode::Rules;
use avln_world::SceneAssets;
use std::{
    collections::VecDeque,
    sync::{Arc, Mutex, PoisonError},
};

/// Prepared scenes that running episodes share; the one that was not used for longest goes first.
#[derive(Default)]
pub(super) struct SceneCache {
    shelf: Mutex<VecDeque<Place>>,
}

struct Place {
    key: (String, String),
    /// Filled by the first who needs the scene while the others wait.
    assets: Arc<Mutex<Option<Arc<SceneAssets>>>>,
}

impl SceneCache {
    /// Scenes that are kept ready. A house takes some tens of megabytes.
    const CAPACITY: usize = 16;

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
        let place = self.place((scene.digest.clone(), rules.name.clone()));
        let mut assets = place.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(ready) = &*assets {
            return Ok((ready.clone(), false));
        }
        let made = Arc::new(scene.open(rules)?);
        *assets = Some(made.clone());
        Ok((made, true))
    }

    /// Takes the place of `key` to the front of the shelf.
    fn place(&self, key: (String, String)) -> Arc<Mutex<Option<Arc<SceneAssets>>>> {
        let mut shelf = self.shelf.lock().unwrap_or_else(PoisonError::into_inner);
        let found = shelf.iter().position(|place| place.key == key).and_then(|index| shelf.remove(index));
        let place = found.unwrap_or_else(|| Place { key, assets: Arc::default() });
        let assets = place.assets.clone();
        shelf.push_front(place);
        shelf.truncate(Self::CAPACITY);
        assets
    }
}
