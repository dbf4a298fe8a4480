//! LRU cache with a byte budget.

use crate::lock;
use std::{
    collections::VecDeque,
    sync::{Arc, Mutex, TryLockError},
};

/// An LRU cache of shared values with a byte budget. Values in use are never evicted.
pub(crate) struct LruCache<K, T> {
    budget_bytes: usize,
    bytes_of: fn(&T) -> usize,
    /// Most recently used first.
    entries: Mutex<VecDeque<CacheEntry<K, T>>>,
}

/// A value, created by the first user while others wait.
type SharedSlot<T> = Arc<Mutex<Option<Arc<T>>>>;

struct CacheEntry<K, T> {
    key: K,
    slot: SharedSlot<T>,
}

impl<K: PartialEq, T> LruCache<K, T> {
    /// Creates a cache with `budget_bytes`; `bytes_of` is evaluated on every access, because values grow.
    pub(crate) fn new(budget_bytes: usize, bytes_of: fn(&T) -> usize) -> Self {
        Self { budget_bytes, bytes_of, entries: Mutex::default() }
    }

    /// Returns the value for `key`, and true if it was created now. The last value always stays.
    pub(crate) fn get<E>(&self, key: K, make: impl FnOnce() -> Result<T, E>) -> Result<(Arc<T>, bool), E> {
        let slot = self.to_front(key);
        // Only the slot is locked meanwhile: creation takes seconds, and other keys stay available.
        let found = fill(&mut lock(&slot), make);
        drop(slot);
        self.make_room();
        found
    }

    /// Returns the total size, bytes, without values in creation.
    pub(crate) fn bytes(&self) -> usize {
        lock(&self.entries).iter().map(|entry| entry.bytes(self.bytes_of)).sum()
    }

    fn to_front(&self, key: K) -> SharedSlot<T> {
        let mut entries = lock(&self.entries);
        let found = entries.iter().position(|entry| entry.key == key).and_then(|index| entries.remove(index));
        let entry = found.unwrap_or_else(|| CacheEntry { key, slot: Arc::default() });
        let slot = entry.slot.clone();
        entries.push_front(entry);
        slot
    }

    fn make_room(&self) {
        let mut entries = lock(&self.entries);
        // Entries without a value remain from failed creations.
        entries.retain(|entry| !entry.is_empty());
        let mut sum: usize = entries.iter().map(|entry| entry.bytes(self.bytes_of)).sum();
        // Index 0 is the most recent request, whose value always stays.
        for index in (1..entries.len()).rev() {
            if sum <= self.budget_bytes {
                break;
            }
            if entries[index].is_idle() {
                sum -= entries[index].bytes(self.bytes_of);
                entries.remove(index);
            }
        }
    }
}

impl<K, T> CacheEntry<K, T> {
    /// Returns true if creation failed and no thread is retrying.
    fn is_empty(&self) -> bool {
        Arc::strong_count(&self.slot) == 1 && lock(&self.slot).is_none()
    }

    /// Returns true if only the cache references the value.
    fn is_idle(&self) -> bool {
        let unused = |slot: &Arc<T>| Arc::strong_count(slot) == 1;
        Arc::strong_count(&self.slot) == 1 && lock(&self.slot).as_ref().is_none_or(unused)
    }

    /// Returns the value's size; 0 during creation.
    fn bytes(&self, bytes_of: fn(&T) -> usize) -> usize {
        let slot = match self.slot.try_lock() {
            Ok(slot) => slot,
            Err(TryLockError::Poisoned(broken)) => broken.into_inner(),
            Err(TryLockError::WouldBlock) => return 0,
        };
        slot.as_deref().map_or(0, bytes_of)
    }
}

fn fill<T, E>(slot: &mut Option<Arc<T>>, make: impl FnOnce() -> Result<T, E>) -> Result<(Arc<T>, bool), E> {
    if let Some(ready) = slot {
        return Ok((ready.clone(), false));
    }
    let made = Arc::new(make()?);
    *slot = Some(made.clone());
    Ok((made, true))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::{
        convert::Infallible,
        sync::{
            Barrier,
            atomic::{AtomicUsize, Ordering},
        },
    };

    type Sizes = LruCache<&'static str, AtomicUsize>;

    fn sizes(budget_bytes: usize) -> Sizes {
        LruCache::new(budget_bytes, |size| size.load(Ordering::Relaxed))
    }

    /// Requests a value with `bytes`; returns true if it was created.
    fn request(cache: &Sizes, key: &'static str, bytes: usize) -> (Arc<AtomicUsize>, bool) {
        let made: Result<_, Infallible> = cache.get(key, || Ok(AtomicUsize::new(bytes)));
        made.unwrap_or_else(|never| match never {})
    }

    fn keys(cache: &Sizes) -> Vec<&'static str> {
        lock(&cache.entries).iter().map(|entry| entry.key).collect()
    }

    #[test]
    fn least_recently_used_value_is_evicted_first() {
        let cache = sizes(10);
        for key in ["a", "b", "c"] {
            request(&cache, key, 3);
        }
        assert!(!request(&cache, "a", 3).1);
        request(&cache, "d", 3);
        assert_eq!(keys(&cache), ["d", "a", "c"]);
        assert!(request(&cache, "b", 3).1);
        assert_eq!(keys(&cache), ["b", "d", "a"]);
    }

    #[test]
    fn newest_value_stays_at_any_size() {
        for budget_bytes in [0, 10] {
            let cache = sizes(budget_bytes);
            request(&cache, "small", 1);
            request(&cache, "large", 100);
            assert_eq!(keys(&cache), ["large"]);
            assert!(!request(&cache, "large", 100).1 && request(&cache, "small", 1).1);
            assert_eq!(keys(&cache), ["small"]);
        }
    }

    #[test]
    fn values_in_use_count_and_stay() {
        let cache = sizes(10);
        let (used, _) = request(&cache, "used", 8);
        request(&cache, "b", 2);
        assert_eq!(keys(&cache), ["b", "used"]);
        request(&cache, "c", 2);
        assert_eq!(keys(&cache), ["c", "used"]);
        drop(used);
        request(&cache, "d", 2);
        assert_eq!(keys(&cache), ["d", "c"]);
    }

    #[test]
    fn grown_values_count_with_their_present_size() {
        let cache = sizes(10);
        request(&cache, "a", 1);
        request(&cache, "b", 1).0.store(10, Ordering::Relaxed);
        assert_eq!(keys(&cache), ["b", "a"]);
        request(&cache, "b", 1);
        assert_eq!(keys(&cache), ["b"]);
    }

    #[test]
    fn failed_creation_leaves_no_entry() {
        let cache = sizes(10);
        assert_eq!(cache.get("broken", || Err("no file")).err(), Some("no file"));
        assert!(keys(&cache).is_empty());
    }

    #[test]
    fn concurrent_requests_create_a_value_once() {
        let (cache, made, start) = (sizes(0), AtomicUsize::new(0), Barrier::new(4));
        let make = || {
            made.fetch_add(1, Ordering::Relaxed);
            std::thread::sleep(std::time::Duration::from_millis(30));
            Ok::<_, Infallible>(AtomicUsize::new(5))
        };
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    start.wait();
                    cache.get("one", make).is_ok()
                });
            }
        });
        assert_eq!(made.into_inner(), 1);
    }
}
