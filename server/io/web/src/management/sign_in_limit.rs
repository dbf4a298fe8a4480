//! Rate limit for failed sign-ins.

use crate::proxy::ClientAddress;
use std::{
    collections::BTreeMap,
    sync::{Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

/// Consecutive failures before an address must wait; people do paste a wrong token a few times.
const MAX_FAILURES: u32 = 10;
/// Wait after the last failure.
const WAIT: Duration = Duration::from_secs(60);
/// Limit for remembered addresses. Beyond it, the oldest failure is forgotten.
const MAX_CLIENTS: usize = 4096;

/// Failed sign-ins by client address: count and last time. `None` stands for requests without an address.
#[derive(Debug, Default)]
pub(crate) struct SignInLimiter(Mutex<BTreeMap<Option<ClientAddress>, (u32, Instant)>>);

impl SignInLimiter {
    fn failures(&self) -> MutexGuard<'_, BTreeMap<Option<ClientAddress>, (u32, Instant)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns true if a client may try to sign in at `now`.
    pub(crate) fn may_try(&self, client: Option<ClientAddress>, now: Instant) -> bool {
        let failures = self.failures();
        let must_wait = |&(failed, last): &(u32, Instant)| {
            failed >= MAX_FAILURES && now.saturating_duration_since(last) < WAIT
        };
        !failures.get(&client).is_some_and(must_wait)
    }

    /// Records a failed sign-in.
    pub(crate) fn record_failure(&self, client: Option<ClientAddress>, now: Instant) {
        let mut failures = self.failures();
        failures.retain(|_, (_, last)| now.saturating_duration_since(*last) < WAIT);
        if failures.len() >= MAX_CLIENTS && !failures.contains_key(&client) {
            let oldest = failures.iter().min_by_key(|(_, (_, last))| *last).map(|(client, _)| *client);
            if let Some(oldest) = oldest {
                failures.remove(&oldest);
            }
        }
        let entry = failures.entry(client).or_insert((0, now));
        *entry = (entry.0.saturating_add(1), now);
    }

    /// Forgets a client's failures after a successful sign-in.
    pub(crate) fn record_success(&self, client: Option<ClientAddress>) {
        self.failures().remove(&client);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::IpAddr;

    fn client(text: &str) -> Option<ClientAddress> {
        Some(ClientAddress::new(text.parse().expect("an address")))
    }

    #[test]
    fn only_the_failing_client_waits() {
        let (limiter, start) = (SignInLimiter::default(), Instant::now());
        for _ in 0..MAX_FAILURES {
            assert!(limiter.may_try(client("192.0.2.1"), start));
            limiter.record_failure(client("192.0.2.1"), start);
        }
        assert!(!limiter.may_try(client("192.0.2.1"), start));
        assert!(!limiter.may_try(client("::ffff:192.0.2.1"), start), "the same address");
        assert!(limiter.may_try(client("192.0.2.2"), start) && limiter.may_try(None, start));
        assert!(limiter.may_try(client("192.0.2.1"), start + WAIT));
        limiter.record_success(client("192.0.2.1"));
        assert!(limiter.may_try(client("192.0.2.1"), start));
    }

    #[test]
    fn an_ipv6_network_is_one_client_and_memory_is_bounded() {
        assert_eq!(client("2001:db8::1"), client("2001:db8::ffff"));
        assert_ne!(client("2001:db8::1"), client("2001:db8:0:1::1"));
        let (limiter, start) = (SignInLimiter::default(), Instant::now());
        for index in 0..=MAX_CLIENTS as u32 {
            let address = ClientAddress::new(IpAddr::from(index.to_be_bytes()));
            limiter.record_failure(Some(address), start + Duration::from_micros(u64::from(index)));
        }
        assert_eq!(limiter.failures().len(), MAX_CLIENTS);
        assert!(!limiter.failures().contains_key(&client("0.0.0.0")), "the oldest was forgotten");
    }
}
