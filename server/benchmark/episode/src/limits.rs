//! Time limits.

use serde::{Deserialize, Serialize};

/// Wall time limits for agents. 0 means unlimited, except for `bank_ms`.
///
/// An action beyond `step_ms` uses up the episode's `bank_ms`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TimeLimits {
    /// Free thinking time per action, milliseconds.
    pub step_ms: u32,
    /// Extra thinking time per episode, milliseconds.
    pub bank_ms: u32,
    /// Longest run, seconds; 0: until the phase ends.
    pub run_s: u32,
    /// Longest single disconnection, seconds; 0: lost episodes end at once.
    pub disconnect_s: u32,
    /// Longest disconnection per run in total, seconds.
    pub disconnect_total_s: u32,
}

impl Default for TimeLimits {
    /// One minute per action, for first trials; two minutes per disconnection, ten in total.
    fn default() -> Self {
        Self { step_ms: 60_000, bank_ms: 0, run_s: 0, disconnect_s: 120, disconnect_total_s: 600 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_limits_default_and_unknown_are_rejected() {
        let limits: TimeLimits = serde_json::from_str(r#"{"step_ms": 5000, "bank_ms": 60000}"#).unwrap();
        assert_eq!(limits, TimeLimits { step_ms: 5000, bank_ms: 60_000, ..TimeLimits::default() });
        assert!(serde_json::from_str::<TimeLimits>(r#"{"steps_ms": 5000}"#).is_err());
    }
}
