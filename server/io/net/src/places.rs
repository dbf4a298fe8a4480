//! Places shared between parties: teams or addresses.

use crate::share::fair_share;
use parking_lot::Mutex;
use std::{collections::BTreeMap, sync::Arc};

/// Places held per party `K`.
#[derive(Debug)]
pub struct Places<K> {
    /// All places, of which every party may hold its [`fair_share`]; `None` without shares.
    shared: Option<usize>,
    per_party: usize,
    held: Mutex<BTreeMap<K, usize>>,
}

/// A party's place, until it is dropped.
#[derive(Debug)]
pub struct HeldPlace<K: Ord> {
    places: Arc<Places<K>>,
    party: K,
}

impl<K: Ord + Clone> Places<K> {
    /// Creates at most `per_party` places per party and, with `shared`, at most the party's [`fair_share`] of so many.
    pub fn new(shared: Option<usize>, per_party: usize) -> Arc<Self> {
        Arc::new(Self { shared, per_party, held: Mutex::default() })
    }

    /// Takes a place. Fails with the party's limit if the party holds that many.
    pub fn take(self: &Arc<Self>, party: K) -> Result<HeldPlace<K>, usize> {
        let mut held = self.held.lock();
        let own = held.get(&party).copied().unwrap_or(0);
        let others = held.values().sum::<usize>() - own;
        let share = self.shared.map_or(usize::MAX, |all| fair_share(all, others));
        let limit = self.per_party.min(share);
        if own >= limit {
            return Err(limit);
        }
        held.insert(party.clone(), own + 1);
        Ok(HeldPlace { places: self.clone(), party })
    }
}

impl<K: Ord> HeldPlace<K> {
    /// Returns the party.
    pub fn party(&self) -> &K {
        &self.party
    }
}

impl<K: Ord> Drop for HeldPlace<K> {
    fn drop(&mut self) {
        let mut held = self.places.held.lock();
        match held.get_mut(&self.party) {
            Some(count) if *count > 1 => *count -= 1,
            _ => drop(held.remove(&self.party)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn new_parties_find_a_place() {
        let places = Places::new(Some(4), 4);
        let red = [places.take("red").unwrap(), places.take("red").unwrap()];
        assert_eq!(places.take("red").unwrap_err(), 2);
        let _blue = places.take("blue").unwrap();
        let _green = places.take("green").unwrap();
        assert_eq!(places.take("late").unwrap_err(), 0, "all are taken");
        drop(red);
        assert!(places.take("late").is_ok(), "dropped places are free");
    }

    #[test]
    fn places_are_limited_per_party() {
        for shared in [None, Some(16)] {
            let places = Places::new(shared, 2);
            let first = places.take(1).unwrap();
            let _second = places.take(1).unwrap();
            assert_eq!(places.take(1).unwrap_err(), 2);
            assert_eq!(places.take(2).unwrap().party(), &2);
            drop(first);
            assert!(places.take(1).is_ok(), "dropped places are free");
        }
    }

    #[test]
    fn unshared_places_may_go_to_one_party() {
        let places = Places::new(None, 5);
        let held: Vec<_> = std::iter::from_fn(|| places.take("proxy").ok()).collect();
        assert_eq!(held.len(), 5);
    }
}
