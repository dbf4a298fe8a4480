//! Live status for visitors.

use avln_grpc::{Control, SessionState, SlotState};
use avln_web::{LiveSession, LiveSlot, LiveStatus};
use std::time::Duration;

/// Live status of the gRPC server.
#[derive(Clone, Debug)]
pub(super) struct ControlStatus(pub(super) Control);

impl LiveStatus for ControlStatus {
    fn session(&self, run: &str) -> Option<LiveSession> {
        let SessionState { is_there, slots } = self.0.session(run)?;
        Some(LiveSession { is_connected: is_there, slots: slots.iter().map(live_slot).collect() })
    }

    fn draining(&self) -> Option<String> {
        self.0.draining().map(|drain| drain.reason)
    }

    fn announcement(&self) -> String {
        self.0.announcement()
    }
}

fn live_slot(slot: &SlotState) -> LiveSlot {
    LiveSlot {
        slot: slot.slot,
        step: slot.step,
        last_step_s: slot.last_step.as_ref().map(Duration::as_secs_f64),
        mean_step_s: slot.mean_step.as_ref().map(Duration::as_secs_f64),
        since_unix_ms: slot.at_unix_ms,
    }
}
