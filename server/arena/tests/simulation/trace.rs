//! Trace of a simulation: a digest of all events, and the last of them.

use std::{
    collections::VecDeque,
    fmt::{self, Display, Write},
    time::Duration,
};

/// Events shown after a failure.
const SHOWN: usize = 50;

/// The events of a simulation.
#[derive(Default)]
pub(crate) struct Trace {
    hasher: blake3::Hasher,
    last: VecDeque<String>,
}

impl Trace {
    pub(crate) fn add(&mut self, age: Duration, event: impl Display) {
        let mut line =
            if self.last.len() < SHOWN { String::new() } else { self.last.pop_front().unwrap_or_default() };
        line.clear();
        let _ = write!(line, "{:>10.3} s  {event}", age.as_secs_f64());
        self.hasher.update(line.as_bytes()).update(b"\n");
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
