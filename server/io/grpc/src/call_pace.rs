//! Pace of the calls on a connection, so that a flood of cheap calls takes little processor time.

use avln_proto::v1::play_service_server::SERVICE_NAME as PLAY_SERVICE;
use hyper::header::HeaderMap;
use parking_lot::Mutex;
use std::time::Duration;
use tokio::time::{Instant, sleep_until};

/// Delays replies to a connection's calls above a rate. Calls that play pass: the simulation limits them.
#[derive(Debug)]
pub(crate) struct CallPace {
    gap: Duration,
    /// Time at which the next reply is due at the permitted rate.
    due: Mutex<Instant>,
}

impl CallPace {
    /// Permits `calls_per_s` calls per second, and as many at once.
    pub(crate) fn new(calls_per_s: u32, now: Instant) -> Self {
        Self { gap: Duration::from_secs(1) / calls_per_s.max(1), due: Mutex::new(now) }
    }

    /// Waits before the reply to a call of `path`, which has these headers.
    pub(crate) async fn wait(&self, path: &str, reply: &HeaderMap) {
        let plays = path.split('/').nth(1) == Some(PLAY_SERVICE);
        if plays && !is_refused(reply) {
            return;
        }
        let now = Instant::now();
        let turn = self.turn(now);
        if turn > now {
            sleep_until(turn).await;
        }
    }

    /// Counts a call, and returns the time of its reply.
    fn turn(&self, now: Instant) -> Instant {
        let mut due = self.due.lock();
        *due = (*due).max(now) + self.gap;
        // A second earlier: as many calls as are permitted per second may come at once.
        (*due).checked_sub(Duration::from_secs(1)).map_or(now, |turn| turn.max(now))
    }
}

/// Returns whether a call failed at once: then its status is in the headers.
fn is_refused(headers: &HeaderMap) -> bool {
    headers.get("grpc-status").is_some_and(|status| status != "0")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replies_keep_the_rate_after_a_burst() {
        let now = Instant::now();
        let pace = CallPace::new(10, now);
        let turns: Vec<_> = (0..30).map(|_| pace.turn(now) - now).collect();
        assert!(turns[..10].iter().all(Duration::is_zero), "{turns:?}");
        assert_eq!(turns[10], Duration::from_millis(100));
        assert_eq!(turns[29], Duration::from_secs(2));
        let later = now + Duration::from_secs(4);
        assert_eq!(pace.turn(later), later);
    }

    #[tokio::test(start_paused = true)]
    async fn only_refused_play_calls_wait() {
        let pace = CallPace::new(1, Instant::now());
        let (plays, mut refused) = (HeaderMap::new(), HeaderMap::new());
        refused.insert("grpc-status", "16".parse().unwrap());
        let begun = Instant::now();
        for _ in 0..100 {
            pace.wait("/avln.v1.PlayService/Step", &plays).await;
        }
        assert_eq!(begun.elapsed(), Duration::ZERO);
        for _ in 0..4 {
            pace.wait("/avln.v1.PlayService/Step", &refused).await;
        }
        assert_eq!(begun.elapsed(), Duration::from_secs(3));
        pace.wait("/avln.v1.InfoService/GetServerInfo", &plays).await;
        assert_eq!(begun.elapsed(), Duration::from_secs(4));
    }
}
