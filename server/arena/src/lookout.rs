//! Live status for visitors.

use avln_grpc::{Control, SessionState, SlotState};
use avln_web::{Lookout, SessionNow, SlotNow};
use std::time::Duration;

/// Live status of the gRPC server.
#[derive(Clone, Debug)]
pub(super) struct DoorLookout(pub(super) Control);

impl Lookout for DoorLookout {
    fn session(&self, run: &str) -> Option<SessionNow> {
        let SessionState { is_there, slots } = self.0.session(run)?;
        Some(SessionNow { is_there, slots: slots.iter().map(slot_now).collect() })
    }

    fn draining(&self) -> Option<String> {
        self.0.draining().map(|drain| drain.reason)
    }
}

fn slot_now(slot: &SlotState) -> SlotNow {
    SlotNow {
        slot: slot.slot,
        step: slot.step,
        last_step_s: slot.last_step.as_ref().map(Duration::as_secs_f64),
        mean_step_s: slot.mean_step.as_ref().map(Duration::as_secs_f64),
        since_unix_ms: slot.at_unix_ms,
    }
}
