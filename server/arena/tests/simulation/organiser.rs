//! The organiser and the operator, who act beside the gRPC server.

use crate::{
    server::Life,
    setting::{PHASES, TEAMS},
    world::World,
};
use avln_arena::actions::{Attribution, reschedule};
use avln_store::{AuditNote, NewGrant, Schedule};
use std::time::Duration;

impl World {
    /// Cancels a run as pages do, beside the gRPC server.
    pub(crate) fn cancel_outside(&mut self, life: &Life) {
        let Some(run) = self.recent_run() else { return };
        let run = self.runs[run].id.clone();
        self.trace.add(life.age(), format_args!("the organiser cancels {run}"));
        let now_unix_ms = self.estate.clock.now_unix_ms();
        if life.border().cross(life.store.cancel_run(&run, now_unix_ms)).is_ok() {
            life.control().leave(&run);
        }
    }

    /// Closes, pauses or opens a phase.
    pub(crate) fn reschedule(&mut self, life: &Life, phase: usize, choice: usize) {
        let phase = PHASES[phase];
        self.trace.add(life.age(), format_args!("change {choice} of phase {phase}"));
        let by = Attribution { actor: "organiser", reason: "" };
        let changed = reschedule(&life.store, phase, by, |schedule| match choice {
            0 => schedule.closed = true,
            1 => schedule.paused = Some("a pause".to_owned()),
            5 => *schedule = Schedule::default(),
            _ => (schedule.closed, schedule.paused) = (false, None),
        });
        life.border().cross(changed).expect("a change of the phase");
    }

    pub(crate) fn grant(&mut self, life: &Life, team: usize, phase: usize, runs: u32) {
        let (team, phase) = (TEAMS[team], PHASES[phase]);
        self.trace.add(life.age(), format_args!("{runs} more runs for {team} in {phase}"));
        let grant = NewGrant { phase, team, runs, reason: "" };
        let granted = life.store.grant(&grant, AuditNote::default(), self.estate.clock.now_unix_ms());
        life.border().cross(granted).expect("granted runs");
    }

    pub(crate) fn drain(&mut self, life: &Life) {
        self.trace.add(life.age(), "drain");
        let drained = life.arena().drain("maintenance", Duration::from_secs(60));
        // A failing database refuses it.
        if life.border().cross(drained).is_err() {
            return;
        }
        self.times.drained.get_or_insert(life.age());
    }
}
