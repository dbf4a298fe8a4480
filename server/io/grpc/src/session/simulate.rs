use crate::{
    crew::Crew,
    limits::Limits,
    refusal::ServerFault,
    seat::Seat,
    watchdog::{Leash, words},
};
use avln_episode::EndReason;
use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    time::{Duration, Instant},
};

/// The right of one team to simulate, among others.
pub(super) struct Share {
    pub(super) crew: Crew,
    pub(super) team: String,
    /// Longest first observation: it may have to prepare what the scene is seen and heard by.
    pub(super) longest_start: Duration,
    pub(super) longest_step: Duration,
}

impl Share {
    pub(super) fn new(crew: Crew, team: &str, limits: &Limits) -> Self {
        let (longest_start, longest_step) = (limits.preparation, limits.step);
        Self { crew, team: team.to_owned(), longest_start, longest_step }
    }

    /// Does simulator work on a thread of the crew. A panic in it is caught: the seat comes back with the fault.
    ///
    /// # Errors
    /// When the work hangs: then the seat hangs with it.
    pub(super) async fn simulate<T: Send + 'static>(
        &self,
        mut seat: Seat,
        limit: Duration,
        work: impl FnOnce(&mut Seat, &Leash) -> T + Send + 'static,
    ) -> Result<(Seat, Result<T, ServerFault>), ServerFault> {
        let asked = Instant::now();
        let done = self.crew.run(&self.team, limit, move |leash| {
            let begun = Instant::now();
            let result = catch_unwind(AssertUnwindSafe(|| work(&mut seat, leash)));
            let result = result.map_err(|panic| ServerFault::simulator("simulate", words(&*panic)));
            seat.time.queue += begun - asked;
            seat.time.simulation += begun.elapsed();
            (seat, result)
        });
        done.await.map_err(|lost| ServerFault::simulator("simulate", lost))
    }
}

/// Ends the episode from outside, even when its simulator is in pieces.
pub(super) fn truncate(seat: &mut Seat, reason: EndReason) {
    if let Err(panic) = catch_unwind(AssertUnwindSafe(|| seat.referee.truncate(reason))) {
        ServerFault::simulator("truncate", words(&*panic));
    }
}
