//! Pace of the calls on a connection, so that a flood of cheap calls takes little processor time.

use avln_proto::v1::play_service_server::SERVICE_NAME as PLAY_SERVICE;
use hyper::header::HeaderMap;
use parking_lot::Mutex;
use std::time::Duration;
use tokio::time::{Instant, sleep_until};

/// Delays a connection's calls above a rate. Unary calls that play pass, unless they are refused: most of them simulate, in the
/// share of their team.
#[derive(Debug)]
pub(crate) struct CallPace {
    gap: Duration,
    /// Time at which the next call is due at the permitted rate.
    due: Mutex<Instant>,
}

impl CallPace {
    /// Permits `calls_per_s` calls per second, and as many at once.
    pub(crate) fn new(calls_per_s: u32, now: Instant) -> Self {
        Self { gap: Duration::from_secs(1) / calls_per_s.max(1), due: Mutex::new(now) }
    }

    /// Waits before a call of `path`. A call that is cancelled meanwhile counts: otherwise, cancelled calls would have no limit.
    pub(crate) async fn wait(&self, path: &str) {
        let now = Instant::now();
        let gap = if plays(path) { Duration::ZERO } else { self.gap };
        let turn = self.turn(now, gap);
        if turn > now {
            sleep_until(turn).await;
        }
    }

    /// Counts a call of `path` that plays, if its reply is a refusal.
    pub(crate) fn answered(&self, path: &str, reply: &HeaderMap) {
        if plays(path) && is_refused(reply) {
            self.turn(Instant::now(), self.gap);
        }
    }

    /// Moves the due time by `gap`, and returns the time of the call.
    fn turn(&self, now: Instant, gap: Duration) -> Instant {
        let mut due = self.due.lock();
        *due = (*due).max(now) + gap;
        // A second earlier: as many calls as are permitted per second may come at once.
        (*due).checked_sub(Duration::from_secs(1)).map_or(now, |turn| turn.max(now))
    }
}

/// Returns whether a call steps, begins or ends an episode. `Play` only opens a stream.
fn plays(path: &str) -> bool {
    let mut names = path.split('/').skip(1);
    names.next() == Some(PLAY_SERVICE) && names.next() != Some("Play")
}

/// Returns whether a call failed at once: then its status is in the headers.
fn is_refused(headers: &HeaderMap) -> bool {
    headers.get("grpc-status").is_some_and(|status| status != "0")
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: &str = "/avln.v1.PlayService/Step";

    #[test]
    fn calls_keep_the_rate_after_a_burst() {
        let now = Instant::now();
        let pace = CallPace::new(10, now);
        let turns: Vec<_> = (0..30).map(|_| pace.turn(now, pace.gap) - now).collect();
        assert!(turns[..10].iter().all(Duration::is_zero), "{turns:?}");
        assert_eq!(turns[10], Duration::from_millis(100));
        assert_eq!(turns[29], Duration::from_secs(2));
        let later = now + Duration::from_secs(4);
        assert_eq!(pace.turn(later, pace.gap), later);
    }

    #[tokio::test(start_paused = true)]
    async fn steps_pass_until_one_is_refused_often() {
        let pace = CallPace::new(1, Instant::now());
        let mut refusal = HeaderMap::new();
        refusal.insert("grpc-status", "16".parse().unwrap());
        let begun = Instant::now();
        for _ in 0..100 {
            pace.wait(STEP).await;
            pace.answered(STEP, &HeaderMap::new());
        }
        assert_eq!(begun.elapsed(), Duration::ZERO);
        for _ in 0..4 {
            pace.answered(STEP, &refusal);
        }
        pace.wait(STEP).await;
        assert_eq!(begun.elapsed(), Duration::from_secs(3));
        for path in ["/avln.v1.InfoService/GetServerInfo", "/avln.v1.PlayService/Play"] {
            pace.wait(path).await;
        }
        assert_eq!(begun.elapsed(), Duration::from_secs(5));
    }

    #[tokio::test(start_paused = true)]
    async fn cancelled_calls_count() {
        let pace = CallPace::new(1, Instant::now());
        let begun = Instant::now();
        for _ in 0..3 {
            let _ = tokio::time::timeout(Duration::from_millis(1), pace.wait("/grpc.health.v1.Health/Check"))
                .await;
        }
        pace.wait("/grpc.health.v1.Health/Check").await;
        assert_eq!(begun.elapsed(), Duration::from_secs(3));
    }
}
