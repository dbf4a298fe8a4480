//! Exponential backoff with jitter.

use crate::Error;
use std::time::Duration;

/// Pause before the second attempt.
const FIRST: Duration = Duration::from_millis(50);
/// Longest pause without a delay requested by the server.
const LONGEST: Duration = Duration::from_secs(2);
/// Longest accepted delay, so that a wrong value cannot stop a client for hours.
const LONGEST_DELAY: Duration = Duration::from_secs(300);

/// Pauses between attempts to reach a server.
pub(crate) struct Backoff {
    pause: Duration,
}

impl Backoff {
    pub(crate) fn new() -> Self {
        Self { pause: FIRST }
    }

    /// Returns the pause after the failure `error`, and doubles the next pause.
    ///
    /// A delay requested by the server is a lower bound.
    pub(crate) fn after(&mut self, error: &Error) -> Duration {
        let delay = Duration::from_secs(error.retry_after_s().unwrap_or(0).into()).min(LONGEST_DELAY);
        // After a restart all clients lose their stream at the same moment. Without jitter they would return in
        // lockstep and overload the server again, also after an equal delay.
        let pause = delay + self.pause.mul_f64(0.5 + 0.5 * random_share());
        self.pause = (2 * self.pause).min(LONGEST);
        pause
    }
}

/// A random number in [0, 1); 0.5 without a random source.
fn random_share() -> f64 {
    let bits = getrandom::u64().unwrap_or(1 << 63);
    (bits >> 11) as f64 / (1_u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_proto::v1::Reason;
    use tonic::Code;

    fn lost() -> Error {
        Error::Lost { attempted: "ask", detail: "gone".to_owned() }
    }

    #[test]
    fn pauses_double_up_to_the_limit() {
        let mut backoff = Backoff::new();
        for expected in [50, 100, 200, 400, 800, 1600, 2000, 2000] {
            let pause = backoff.after(&lost()).as_millis();
            assert!((expected / 2..=expected).contains(&pause), "{pause} ms, expected up to {expected} ms");
        }
    }

    #[test]
    fn pauses_of_two_clients_differ() {
        let pauses: Vec<_> = (0..8).map(|_| Backoff::new().after(&lost())).collect();
        assert!(pauses.windows(2).any(|pair| pair[0] != pair[1]), "{pauses:?}");
    }

    #[test]
    fn requested_delay_is_a_lower_bound() {
        let draining = Error::refused("play", Code::Unavailable, Reason::Draining, "stopping", Some(5));
        assert!(Backoff::new().after(&draining) >= Duration::from_secs(5));
    }
}
