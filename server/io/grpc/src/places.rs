use std::{
    collections::BTreeMap,
    net::IpAddr,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};
use tokio::time::Instant;

/// How many connections are open, in all and from each address.
#[derive(Debug)]
pub(crate) struct Places {
    taken: Mutex<BTreeMap<IpAddr, usize>>,
    limit: usize,
    limit_per_address: usize,
    /// Addresses from which a connection had to be cut, and until when new ones wait.
    kept_waiting: Mutex<BTreeMap<IpAddr, Instant>>,
}

/// One open connection, until it is dropped.
#[derive(Debug)]
pub(crate) struct Place {
    places: Arc<Places>,
    address: IpAddr,
}

impl Places {
    pub(crate) fn new(limit: usize, limit_per_address: usize) -> Arc<Self> {
        Arc::new(Self { taken: Mutex::default(), limit, limit_per_address, kept_waiting: Mutex::default() })
    }

    /// A place for a connection from `address`; `None` when all are taken.
    pub(crate) fn take(self: &Arc<Self>, address: IpAddr) -> Option<Place> {
        let mut taken = self.taken();
        let here = taken.get(&address).copied().unwrap_or(0);
        if taken.values().sum::<usize>() >= self.limit || here >= self.limit_per_address {
            return None;
        }
        taken.insert(address, here + 1);
        Some(Place { places: self.clone(), address })
    }

    fn kept_waiting(&self) -> MutexGuard<'_, BTreeMap<IpAddr, Instant>> {
        self.kept_waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn taken(&self) -> MutexGuard<'_, BTreeMap<IpAddr, usize>> {
        self.taken.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Place {
    /// Until when this connection waits because of others from its address.
    pub(crate) fn waits_until(&self) -> Option<Instant> {
        let mut waiting = self.places.kept_waiting();
        waiting.retain(|_, until| *until > Instant::now());
        waiting.get(&self.address).copied()
    }

    /// This connection had to be cut: new ones from its address wait.
    pub(crate) fn keep_waiting(&self, until: Instant) {
        self.places.kept_waiting().insert(self.address, until);
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut taken = self.places.taken();
        match taken.get_mut(&self.address) {
            Some(count) if *count > 1 => *count -= 1,
            _ => drop(taken.remove(&self.address)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_limited_in_all_and_by_address_and_come_back() {
        let places = Places::new(3, 2);
        let address = |last| IpAddr::from([127, 0, 0, last]);
        let first = places.take(address(1)).unwrap();
        let _second = places.take(address(1)).unwrap();
        assert!(places.take(address(1)).is_none(), "two from one address are enough");
        let _third = places.take(address(2)).unwrap();
        assert!(places.take(address(3)).is_none(), "three in all are enough");
        drop(first);
        assert!(places.take(address(3)).is_some());
    }

    #[tokio::test(start_paused = true)]
    async fn who_had_to_be_cut_waits_and_nobody_else_does() {
        let places = Places::new(9, 9);
        let [first, second] = [1, 2].map(|last| IpAddr::from([127, 0, 0, last]));
        let place = places.take(first).unwrap();
        assert_eq!(place.waits_until(), None);
        let until = Instant::now() + std::time::Duration::from_secs(1);
        place.keep_waiting(until);
        assert_eq!(places.take(first).unwrap().waits_until(), Some(until));
        assert_eq!(places.take(second).unwrap().waits_until(), None);
        tokio::time::advance(std::time::Duration::from_secs(1)).await;
        assert_eq!(places.take(first).unwrap().waits_until(), None);
    }
}
