use std::{
    collections::VecDeque,
    sync::{Arc, Mutex, PoisonError},
};

/// What takes memory.
pub(super) trait Kept {
    /// How much.
    fn bytes(&self) -> usize;
}

/// What was made. What nobody asked for longest goes first.
pub(super) struct Shelf<T> {
    budget_bytes: usize,
    /// The one that was asked for last comes first.
    kept: Mutex<VecDeque<(String, Arc<T>)>>,
}

impl<T: Kept> Shelf<T> {
    pub(super) fn new(budget_bytes: usize) -> Self {
        Self { budget_bytes, kept: Mutex::default() }
    }

    pub(super) fn find(&self, key: &str) -> Option<Arc<T>> {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let place = kept.iter().position(|(other, _)| other == key)?;
        let found = kept.remove(place)?;
        let thing = found.1.clone();
        kept.push_front(found);
        Some(thing)
    }

    pub(super) fn keep(&self, key: String, thing: Arc<T>) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.retain(|(other, _)| *other != key);
        kept.push_front((key, thing));
        let mut bytes: usize = kept.iter().map(|(_, thing)| thing.bytes()).sum();
        while bytes > self.budget_bytes {
            let Some((_, gone)) = kept.pop_back() else { return };
            bytes -= gone.bytes();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Kept for [u8; 40] {
        fn bytes(&self) -> usize {
            self.len()
        }
    }

    #[test]
    fn what_was_not_asked_for_longest_goes_first() {
        let thing = || Arc::new([0_u8; 40]);
        let shelf = Shelf::new(100);
        shelf.keep("a".to_owned(), thing());
        shelf.keep("b".to_owned(), thing());
        assert!(shelf.find("a").is_some());
        shelf.keep("c".to_owned(), thing());
        assert!(shelf.find("b").is_none() && shelf.find("a").is_some() && shelf.find("c").is_some());
        Shelf::new(10).keep("too large".to_owned(), thing());
    }
}
