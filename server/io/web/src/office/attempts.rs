use std::{
    collections::BTreeMap,
    net::{IpAddr, Ipv6Addr},
    sync::{Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

/// Attempts to sign in that may fail in a row: somebody who copies the wrong token some times.
const MOST_FAILED: u32 = 10;
/// How long an address that failed so often waits.
const WAIT: Duration = Duration::from_secs(60);
/// Addresses that are remembered. The one that failed longest ago gives way.
const MOST_PEERS: usize = 4096;

/// Where a visitor comes from, as far as one person can choose it: an address, or the network of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Peer(IpAddr);

impl Peer {
    pub(crate) fn of(address: IpAddr) -> Self {
        match address.to_canonical() {
            IpAddr::V6(address) => {
                let network = u128::from(address) >> 64 << 64;
                Self(IpAddr::V6(Ipv6Addr::from(network)))
            }
            v4 => Self(v4),
        }
    }
}

/// Who failed to sign in, how often, and when last.
#[derive(Debug, Default)]
pub(crate) struct Attempts(Mutex<BTreeMap<Option<Peer>, (u32, Instant)>>);

impl Attempts {
    fn all(&self) -> MutexGuard<'_, BTreeMap<Option<Peer>, (u32, Instant)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether a visitor may try to sign in at `now`.
    pub(crate) fn may_try(&self, peer: Option<Peer>, now: Instant) -> bool {
        let all = self.all();
        let waits = |&(failed, last): &(u32, Instant)| {
            failed >= MOST_FAILED && now.saturating_duration_since(last) < WAIT
        };
        !all.get(&peer).is_some_and(waits)
    }

    /// Notes that a visitor failed.
    pub(crate) fn failed(&self, peer: Option<Peer>, now: Instant) {
        let mut all = self.all();
        all.retain(|_, (_, last)| now.saturating_duration_since(*last) < WAIT);
        if all.len() >= MOST_PEERS && !all.contains_key(&peer) {
            let oldest = all.iter().min_by_key(|(_, (_, last))| *last).map(|(peer, _)| *peer);
            if let Some(oldest) = oldest {
                all.remove(&oldest);
            }
        }
        let entry = all.entry(peer).or_insert((0, now));
        *entry = (entry.0.saturating_add(1), now);
    }

    /// Forgets the failures of a visitor who signed in.
    pub(crate) fn succeeded(&self, peer: Option<Peer>) {
        self.all().remove(&peer);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn peer(text: &str) -> Option<Peer> {
        Some(Peer::of(text.parse().expect("an address")))
    }

    #[test]
    fn who_fails_often_waits_and_others_do_not() {
        let (attempts, start) = (Attempts::default(), Instant::now());
        for _ in 0..MOST_FAILED {
            assert!(attempts.may_try(peer("192.0.2.1"), start));
            attempts.failed(peer("192.0.2.1"), start);
        }
        assert!(!attempts.may_try(peer("192.0.2.1"), start));
        assert!(!attempts.may_try(peer("::ffff:192.0.2.1"), start), "it is the same address");
        assert!(attempts.may_try(peer("192.0.2.2"), start) && attempts.may_try(None, start));
        assert!(attempts.may_try(peer("192.0.2.1"), start + WAIT));
        attempts.succeeded(peer("192.0.2.1"));
        assert!(attempts.may_try(peer("192.0.2.1"), start));
    }

    #[test]
    fn one_network_is_one_visitor_and_memory_has_an_end() {
        assert_eq!(peer("2001:db8::1"), peer("2001:db8::ffff"));
        assert_ne!(peer("2001:db8::1"), peer("2001:db8:0:1::1"));
        let (attempts, start) = (Attempts::default(), Instant::now());
        for index in 0..=MOST_PEERS as u32 {
            let address = IpAddr::from(index.to_be_bytes());
            attempts.failed(Some(Peer::of(address)), start + Duration::from_micros(u64::from(index)));
        }
        assert_eq!(attempts.all().len(), MOST_PEERS);
        assert!(!attempts.all().contains_key(&peer("0.0.0.0")), "the oldest gave way");
    }
}
