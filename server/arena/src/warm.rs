use std::{
    collections::VecDeque,
    sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError},
};

/// An LRU cache of shared values with a byte budget. Values in use are never evicted.
pub(super) struct Warm<K, T> {
    budget_bytes: usize,
    bytes_of: fn(&T) -> usize,
    /// Most recently used first.
    shelf: Mutex<VecDeque<Seat<K, T>>>,
}

/// Filled by the first user while others wait.
type Thing<T> = Arc<Mutex<Option<Arc<T>>>>;

struct Seat<K, T> {
    key: K,
    thing: Thing<T>,
}

impl<K: PartialEq, T> Warm<K, T> {
    /// Creates a cache with `budget_bytes`; `bytes_of` is evaluated on every access, because values grow.
    pub(super) fn new(budget_bytes: usize, bytes_of: fn(&T) -> usize) -> Self {
        Self { budget_bytes, bytes_of, shelf: Mutex::default() }
    }

    /// Returns the value of `key`, and true if it was created now. The last value always stays; values in use
    /// stay and count.
    pub(super) fn get<E>(&self, key: K, make: impl FnOnce() -> Result<T, E>) -> Result<(Arc<T>, bool), E> {
        let thing = self.to_front(key);
        let found = fill(&mut lock(&thing), make);
        drop(thing);
        self.make_room();
        found
    }

    /// Total bytes; values in creation do not count yet.
    pub(super) fn bytes(&self) -> usize {
        lock(&self.shelf).iter().map(|seat| seat.bytes(self.bytes_of)).sum()
    }

    /// Takes the seat of `key` to the front of the shelf.
    fn to_front(&self, key: K) -> Thing<T> {
        let mut shelf = lock(&self.shelf);
        let found = shelf.iter().position(|seat| seat.key == key).and_then(|index| shelf.remove(index));
        let seat = found.unwrap_or_else(|| Seat { key, thing: Arc::default() });
        let thing = seat.thing.clone();
        shelf.push_front(seat);
        thing
    }

    fn make_room(&self) {
        let mut shelf = lock(&self.shelf);
        shelf.retain(|seat| !seat.is_empty());
        let mut sum: usize = shelf.iter().map(|seat| seat.bytes(self.bytes_of)).sum();
        for index in (1..shelf.len()).rev() {
            if sum <= self.budget_bytes {
                break;
            }
            if shelf[index].is_idle() {
                sum -= shelf[index].bytes(self.bytes_of);
                shelf.remove(index);
            }
        }
    }
}

impl<K, T> Seat<K, T> {
    /// Returns true if creation failed and no thread is retrying.
    fn is_empty(&self) -> bool {
        Arc::strong_count(&self.thing) == 1 && lock(&self.thing).is_none()
    }

    /// Returns true if only the cache references the value.
    fn is_idle(&self) -> bool {
        let unused = |thing: &Arc<T>| Arc::strong_count(thing) == 1;
        Arc::strong_count(&self.thing) == 1 && lock(&self.thing).as_ref().is_none_or(unused)
    }

    /// Bytes of the value; 0 during creation.
    fn bytes(&self, bytes_of: fn(&T) -> usize) -> usize {
        let thing = match self.thing.try_lock() {
            Ok(thing) => thing,
            Err(TryLockError::Poisoned(broken)) => broken.into_inner(),
            Err(TryLockError::WouldBlock) => return 0,
        };
        thing.as_deref().map_or(0, bytes_of)
    }
}

/// The existing value, or the result of `make`.
fn fill<T, E>(thing: &mut Option<Arc<T>>, make: impl FnOnce() -> Result<T, E>) -> Result<(Arc<T>, bool), E> {
    if let Some(ready) = thing {
        return Ok((ready.clone(), false));
    }
    let made = Arc::new(make()?);
    *thing = Some(made.clone());
    Ok((made, true))
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;
    use std::sync::Barrier;
    use std::sync::atomic::{AtomicUsize, Ordering};

    type Sizes = Warm<&'static str, AtomicUsize>;

    fn sizes(budget_bytes: usize) -> Sizes {
        Warm::new(budget_bytes, |size| size.load(Ordering::Relaxed))
    }

    /// Requests a value of `bytes`; returns true if it was created.
    fn ask(warm: &Sizes, key: &'static str, bytes: usize) -> (Arc<AtomicUsize>, bool) {
        let made: Result<_, Infallible> = warm.get(key, || Ok(AtomicUsize::new(bytes)));
        made.unwrap_or_else(|never| match never {})
    }

    fn keys(warm: &Sizes) -> Vec<&'static str> {
        lock(&warm.shelf).iter().map(|seat| seat.key).collect()
    }

    #[test]
    fn what_was_not_asked_for_longest_goes_first() {
        let warm = sizes(10);
        for key in ["a", "b", "c"] {
            ask(&warm, key, 3);
        }
        assert!(!ask(&warm, "a", 3).1);
        ask(&warm, "d", 3);
        assert_eq!(keys(&warm), ["d", "a", "c"]);
        assert!(ask(&warm, "b", 3).1);
        assert_eq!(keys(&warm), ["b", "d", "a"]);
    }

    #[test]
    fn the_last_one_stays_however_large_it_is() {
        for budget_bytes in [0, 10] {
            let warm = sizes(budget_bytes);
            ask(&warm, "small", 1);
            ask(&warm, "large", 100);
            assert_eq!(keys(&warm), ["large"]);
            assert!(!ask(&warm, "large", 100).1 && ask(&warm, "small", 1).1);
            assert_eq!(keys(&warm), ["small"]);
        }
    }

    #[test]
    fn what_is_in_use_counts_and_stays() {
        let warm = sizes(10);
        let (used, _) = ask(&warm, "used", 8);
        ask(&warm, "b", 2);
        assert_eq!(keys(&warm), ["b", "used"]);
        ask(&warm, "c", 2);
        assert_eq!(keys(&warm), ["c", "used"]);
        drop(used);
        ask(&warm, "d", 2);
        assert_eq!(keys(&warm), ["d", "c"]);
    }

    #[test]
    fn what_has_grown_counts_as_large_as_it_is_now() {
        let warm = sizes(10);
        ask(&warm, "a", 1);
        ask(&warm, "b", 1).0.store(10, Ordering::Relaxed);
        assert_eq!(keys(&warm), ["b", "a"]);
        ask(&warm, "b", 1);
        assert_eq!(keys(&warm), ["b"]);
    }

    #[test]
    fn what_cannot_be_made_leaves_no_seat() {
        let warm = sizes(10);
        assert_eq!(warm.get("broken", || Err("no file")).err(), Some("no file"));
        assert!(keys(&warm).is_empty());
    }

    #[test]
    fn threads_that_ask_together_make_it_once() {
        let (warm, made, start) = (sizes(0), AtomicUsize::new(0), Barrier::new(4));
        let make = || {
            made.fetch_add(1, Ordering::Relaxed);
            std::thread::sleep(std::time::Duration::from_millis(30));
            Ok::<_, Infallible>(AtomicUsize::new(5))
        };
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    start.wait();
                    warm.get("one", make).is_ok()
                });
            }
        });
        assert_eq!(made.into_inner(), 1);
    }
}
