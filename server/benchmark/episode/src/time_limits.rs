use serde::{Deserialize, Serialize};

/// Wall time that agents have. Zero stands for unlimited, but in `bank_ms`, where it means none.
///
/// An action may take `step_ms`; what it takes beyond comes off the `bank_ms` of its episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TimeLimits {
    /// Thinking time of one action that costs nothing, milliseconds.
    pub step_ms: u32,
    /// Thinking time of one episode beyond `step_ms`, milliseconds.
    pub bank_ms: u32,
    /// From the start of a run to its end at the latest, seconds; 0: it ends with its phase.
    pub run_s: u32,
    /// For how long one lost connection may be away, seconds; 0: lost episodes end at once.
    pub disconnect_s: u32,
    /// For how long the lost connections of a run may be away in all, seconds.
    pub disconnect_total_s: u32,
}

impl Default for TimeLimits {
    /// A minute an action, for people who try things out; two minutes away, ten in all.
    fn default() -> Self {
        Self { step_ms: 60_000, bank_ms: 0, run_s: 0, disconnect_s: 120, disconnect_total_s: 600 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_that_are_left_out_are_the_defaults_and_unknown_ones_are_refused() {
        let limits: TimeLimits = serde_json::from_str(r#"{"step_ms": 5000, "bank_ms": 60000}"#).unwrap();
        assert_eq!(limits, TimeLimits { step_ms: 5000, bank_ms: 60_000, ..TimeLimits::default() });
        assert!(serde_json::from_str::<TimeLimits>(r#"{"steps_ms": 5000}"#).is_err());
    }
}
