//! Accept loop: TLS handshakes, orderly shutdown, and limits of connections; places shared between parties.

use crate::listener::{Listener, Stream};
use parking_lot::Mutex;
use std::{
    collections::BTreeMap,
    io,
    net::{IpAddr, SocketAddr},
    sync::Arc,
    time::Duration,
};
use tokio::{
    net::TcpStream,
    sync::{OwnedSemaphorePermit, Semaphore, watch},
    task::JoinSet,
    time::{Instant, sleep, sleep_until},
};

/// Accept loop limits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AcceptLimits {
    /// Open connections.
    pub max_connections: usize,
    /// Open connections per address.
    pub max_connections_per_address: usize,
    /// True if an address may also hold no more than its [`fair_share`] of `max_connections`. False
    /// behind a proxy, whose address is that of all clients.
    pub shares_by_address: bool,
    /// True if connections beyond the limit wait in the system's queue instead of being closed.
    pub waits_when_full: bool,
    /// Time for a TLS handshake.
    pub handshake: Duration,
    /// Pause after a failed accept.
    pub failure_pause: Duration,
    /// Consecutive failed accepts before the loop ends; `None` if it never does.
    pub max_failures: Option<u32>,
}

/// An accept loop.
#[derive(Debug)]
pub struct AcceptLoop {
    listener: Listener,
    limits: AcceptLimits,
    limiter: Arc<ConnectionLimiter>,
    connections: Connections,
}

/// Open connections.
#[derive(Debug)]
pub struct Connections {
    closing: watch::Sender<bool>,
    tasks: JoinSet<()>,
}

/// An accepted connection, after the handshake.
#[derive(Debug)]
pub struct Connection {
    /// Byte stream.
    pub stream: Stream,
    /// Address of the peer.
    pub peer: SocketAddr,
    /// Start of the handshake.
    pub opened: Instant,
    /// Permit of the connection limits.
    pub permit: Arc<ConnectionPermit>,
    /// Signal that the server stops.
    pub closing: Closing,
}

/// Signal that a connection should close.
#[derive(Debug)]
pub struct Closing(watch::Receiver<bool>);

impl Closing {
    /// Waits until the server stops.
    pub async fn wait(&mut self) {
        // A dropped sender means that the server has stopped.
        let _ = self.0.wait_for(|closing| *closing).await;
    }
}

impl AcceptLoop {
    /// Creates a loop for [`AcceptLoop::run`].
    pub fn new(listener: impl Into<Listener>, limits: AcceptLimits) -> Self {
        let limiter = ConnectionLimiter::new(&limits);
        let connections = Connections { closing: watch::Sender::new(false), tasks: JoinSet::new() };
        Self { listener: listener.into(), limits, limiter, connections }
    }

    /// Accepts connections and spawns `handle` for each. Returns after too many failed accepts.
    pub async fn run<F, T>(&mut self, handle: F) -> io::Error
    where
        F: Fn(Connection) -> T + Clone + Send + 'static,
        T: Future<Output = ()> + Send + 'static,
    {
        let mut failures = 0;
        loop {
            let slot = if self.limits.waits_when_full { self.limiter.wait().await } else { None };
            while self.connections.tasks.try_join_next().is_some() {}
            match self.listener.accept().await {
                Ok((tcp, peer)) => {
                    failures = 0;
                    match self.limiter.take(peer.ip(), slot) {
                        Some(permit) => self.spawn(tcp, peer, permit, handle.clone()),
                        // Closing at once is a clearer answer than a connection that never replies.
                        None => tracing::warn!(%peer, "connection refused: the connection limit is reached"),
                    }
                }
                Err(error) if self.limits.max_failures.is_none_or(|limit| failures < limit) => {
                    failures += 1;
                    tracing::warn!(%error, "cannot accept a connection");
                    // Without file descriptors every accept fails at once: a loop without a pause would burn a core.
                    sleep(self.limits.failure_pause).await;
                }
                Err(error) => return error,
            }
        }
    }

    fn spawn<F, T>(&mut self, tcp: TcpStream, peer: SocketAddr, permit: ConnectionPermit, handle: F)
    where
        F: Fn(Connection) -> T + Send + 'static,
        T: Future<Output = ()> + Send + 'static,
    {
        let handshaker = self.listener.handshaker();
        let limit = self.limits.handshake;
        let closing = Closing(self.connections.closing.subscribe());
        self.connections.tasks.spawn(async move {
            // Without it small frames wait for acknowledgements. A socket that refuses the option still works.
            let _ = tcp.set_nodelay(true);
            if let Some(until) = permit.delayed_until() {
                sleep_until(until).await;
            }
            let opened = Instant::now();
            match handshaker.handshake(tcp, limit).await {
                Ok(stream) => {
                    // Kept here as well: a handler that moves only the stream out of the connection must not free the permit.
                    let kept = Arc::new(permit);
                    let permit = kept.clone();
                    handle(Connection { stream, peer, opened, permit, closing }).await;
                    drop(kept);
                }
                Err(refused) => tracing::debug!(%peer, %refused, "connection closed"),
            }
        });
    }

    /// Closes the listener. Open connections continue.
    pub fn stop_listening(self) -> Connections {
        self.connections
    }
}

impl Connections {
    /// Signals all connections to close and waits for their end.
    pub async fn close(mut self) {
        self.closing.send_replace(true);
        while self.tasks.join_next().await.is_some() {}
    }
}

/// Connection counts, in total and per address.
#[derive(Debug)]
struct ConnectionLimiter {
    total: Arc<Semaphore>,
    by_address: Arc<Places<IpAddr>>,
    /// Ends of penalties by address.
    delayed: Mutex<BTreeMap<IpAddr, Instant>>,
}

/// An open connection's permit, until it is dropped.
#[derive(Debug)]
pub struct ConnectionPermit {
    limiter: Arc<ConnectionLimiter>,
    place: HeldPlace<IpAddr>,
    _slot: OwnedSemaphorePermit,
}

impl ConnectionLimiter {
    fn new(limits: &AcceptLimits) -> Arc<Self> {
        let limit = limits.max_connections.min(Semaphore::MAX_PERMITS);
        let per_address = limits.max_connections_per_address.min(limit);
        Arc::new(Self {
            total: Arc::new(Semaphore::new(limit)),
            by_address: Places::new(limits.shares_by_address.then_some(limit), per_address),
            delayed: Mutex::default(),
        })
    }

    async fn wait(&self) -> Option<OwnedSemaphorePermit> {
        self.total.clone().acquire_owned().await.ok()
    }

    /// Returns a permit for a connection from `address`; `None` if a limit is reached.
    fn take(
        self: &Arc<Self>,
        address: IpAddr,
        slot: Option<OwnedSemaphorePermit>,
    ) -> Option<ConnectionPermit> {
        let slot = slot.or_else(|| self.total.clone().try_acquire_owned().ok())?;
        let place = self.by_address.take(address).ok()?;
        Some(ConnectionPermit { limiter: self.clone(), place, _slot: slot })
    }
}

impl ConnectionPermit {
    /// Delays new connections from this address.
    pub fn delay_others(&self, until: Instant) {
        self.limiter.delayed.lock().insert(*self.place.party(), until);
    }

    /// Returns the end of this connection's delay.
    fn delayed_until(&self) -> Option<Instant> {
        let mut delayed = self.limiter.delayed.lock();
        delayed.retain(|_, until| *until > Instant::now());
        delayed.get(self.place.party()).copied()
    }
}

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

/// Returns the number of places that a party may occupy: half of those that the others leave, rounded up.
///
/// A party alone has half of all places, so a second one always finds some; the last free place is always left to a newcomer.
pub fn fair_share(places: usize, held_by_others: usize) -> usize {
    places.saturating_sub(held_by_others).div_ceil(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn limiter(max_connections: usize, max_connections_per_address: usize) -> Arc<ConnectionLimiter> {
        ConnectionLimiter::new(&AcceptLimits {
            max_connections,
            max_connections_per_address,
            shares_by_address: true,
            waits_when_full: false,
            handshake: Duration::ZERO,
            failure_pause: Duration::ZERO,
            max_failures: None,
        })
    }

    fn address(last: u8) -> IpAddr {
        IpAddr::from([127, 0, 0, last])
    }

    #[test]
    fn permits_are_limited_in_total_and_per_address() {
        let limiter = limiter(3, 2);
        let first = limiter.take(address(1), None).unwrap();
        let _second = limiter.take(address(1), None).unwrap();
        assert!(limiter.take(address(1), None).is_none(), "two per address");
        let _third = limiter.take(address(2), None).unwrap();
        assert!(limiter.take(address(3), None).is_none(), "three in total");
        drop(first);
        assert!(limiter.take(address(3), None).is_some());
    }

    #[test]
    fn addresses_leave_half_of_the_places() {
        let limiter = limiter(16, 16);
        let fill = |from: IpAddr| std::iter::from_fn(|| limiter.take(from, None)).collect::<Vec<_>>();
        let mut held: Vec<_> = (1..=4).map(|last| fill(address(last))).collect();
        assert_eq!(held.iter().map(Vec::len).collect::<Vec<_>>(), [8, 4, 2, 1]);
        held.push(fill(address(5)));
        assert_eq!(held[4].len(), 1, "the last place is left to a newcomer");
        assert!(fill(address(6)).is_empty());
        drop(held);
        let alone = fill(address(6));
        assert_eq!(alone.len(), 8, "closed connections no longer count");
    }

    #[tokio::test(start_paused = true)]
    async fn a_penalty_delays_only_its_address() {
        let limiter = limiter(9, 9);
        let [first, second] = [1, 2].map(address);
        let permit = limiter.take(first, None).unwrap();
        assert_eq!(permit.delayed_until(), None);
        let until = Instant::now() + Duration::from_secs(1);
        permit.delay_others(until);
        assert_eq!(limiter.take(first, None).unwrap().delayed_until(), Some(until));
        assert_eq!(limiter.take(second, None).unwrap().delayed_until(), None);
        tokio::time::advance(Duration::from_secs(1)).await;
        assert_eq!(limiter.take(first, None).unwrap().delayed_until(), None);
    }

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

    #[test]
    fn last_place_is_left_to_newcomers() {
        for places in 1..40 {
            let mut held = Vec::new();
            while held.iter().sum::<usize>() < places {
                let share = fair_share(places, held.iter().sum());
                assert!(share >= 1, "{places} places, {held:?}");
                held.push(share);
            }
            assert_eq!(held.iter().sum::<usize>(), places);
        }
        assert_eq!(fair_share(256, 0), 128);
        assert_eq!(fair_share(256, 300), 0);
    }
}
