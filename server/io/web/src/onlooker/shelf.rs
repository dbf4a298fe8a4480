use super::picture::Pictures;
use std::{
    collections::VecDeque,
    sync::{Arc, Mutex, PoisonError},
};

/// Pictures that were made. What nobody asked for longest goes first.
pub(super) struct Shelf {
    budget_bytes: usize,
    /// The one that was asked for last comes first.
    kept: Mutex<VecDeque<(String, Arc<Pictures>)>>,
}

impl Shelf {
    pub(super) fn new(budget_bytes: usize) -> Self {
        Self { budget_bytes, kept: Mutex::default() }
    }

    pub(super) fn find(&self, key: &str) -> Option<Arc<Pictures>> {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let place = kept.iter().position(|(other, _)| other == key)?;
        let found = kept.remove(place)?;
        let pictures = found.1.clone();
        kept.push_front(found);
        Some(pictures)
    }

    pub(super) fn keep(&self, key: String, pictures: Arc<Pictures>) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.retain(|(other, _)| *other != key);
        kept.push_front((key, pictures));
        let mut bytes: usize = kept.iter().map(|(_, pictures)| pictures.bytes()).sum();
        while bytes > self.budget_bytes {
            let Some((_, gone)) = kept.pop_back() else { return };
            bytes -= gone.bytes();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_not_asked_for_longest_goes_first() {
        let pictures = || Arc::new(Pictures { rgb: vec![0; 30], depth: vec![0; 10] });
        let shelf = Shelf::new(100);
        shelf.keep("a".to_owned(), pictures());
        shelf.keep("b".to_owned(), pictures());
        assert!(shelf.find("a").is_some());
        shelf.keep("c".to_owned(), pictures());
        assert!(shelf.find("b").is_none() && shelf.find("a").is_some() && shelf.find("c").is_some());
        Shelf::new(10).keep("too large".to_owned(), pictures());
    }
}
