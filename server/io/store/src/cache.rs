use quick_cache::sync::Cache;
use std::{
    any::{Any, TypeId},
    fmt,
    sync::Arc,
};

/// A bounded cache for views that never change under their key, shared by a store's readers.
// Values are type-erased: the database module must not depend on the views, which depend on it.
#[derive(Clone)]
pub(crate) struct ViewCache(Arc<Cache<(TypeId, String), Arc<dyn Any + Send + Sync>>>);

impl ViewCache {
    pub(crate) fn get<T: Any + Send + Sync>(&self, key: &str) -> Option<Arc<T>> {
        self.0.get(&(TypeId::of::<T>(), key.to_owned()))?.downcast().ok()
    }

    pub(crate) fn insert<T: Any + Send + Sync>(&self, key: String, view: Arc<T>) {
        self.0.insert((TypeId::of::<T>(), key), view);
    }
}

impl Default for ViewCache {
    fn default() -> Self {
        // A run with 550 episodes takes about 0.3 MB, a leaderboard less.
        const VIEWS: usize = 96;
        Self(Arc::new(Cache::new(VIEWS)))
    }
}

impl fmt::Debug for ViewCache {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ViewCache({} views)", self.0.len())
    }
}
