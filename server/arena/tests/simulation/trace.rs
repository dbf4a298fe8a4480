//! Trace of a simulation: a digest of all events, and the last of them.

use std::{
    collections::VecDeque,
    fmt::{self, Display, Write},
    time::Duration,
};

/// Events shown after a failure.
const SHOWN: usize = 50;
/// Environment variable that prints all events.
const ALL: &str = "AVLN_SIMULATION_TRACE";

/// The events of a simulation.
pub(crate) struct Trace {
    hasher: blake3::Hasher,
    last: VecDeque<String>,
    prints: bool,
}

impl Default for Trace {
    fn default() -> Self {
        let prints = std::env::var_os(ALL).is_some();
        Self { hasher: blake3::Hasher::new(), last: VecDeque::new(), prints }
    }
}

impl Trace {
    pub(crate) fn add(&mut self, age: Duration, event: impl Display) {
        let mut line =
            if self.last.len() < SHOWN { String::new() } else { self.last.pop_front().unwrap_or_default() };
        line.clear();
        let _ = write!(line, "{:>10.3} s  {event}", age.as_secs_f64());
        self.hasher.update(line.as_bytes()).update(b"\n");
        if self.prints {
            println!("{line}");
        }
        self.last.push_back(line);
    }

    pub(crate) fn digest(&self) -> String {
        self.hasher.finalize().to_hex()[..16].to_owned()
    }
}

impl Display for Trace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.last.iter().try_for_each(|line| writeln!(f, "{line}"))
    }
}
