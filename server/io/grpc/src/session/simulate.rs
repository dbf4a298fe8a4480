use crate::{refusal::ServerFault, seat::Seat};
use avln_episode::EndReason;
use std::{
    any::Any,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::Arc,
    time::Instant,
};
use tokio::{sync::Semaphore, task::spawn_blocking};

/// The right to simulate, shared by all runs: first come, first served.
pub(super) struct Crew(pub(super) Arc<Semaphore>);

impl Crew {
    /// Runs simulator work on a blocking thread. A panic in it is caught: the seat comes back with the fault.
    /// The outer error means that the seat itself was lost, which happens only while the runtime stops.
    pub(super) async fn simulate<T: Send + 'static>(
        &self,
        mut seat: Seat,
        work: impl FnOnce(&mut Seat) -> T + Send + 'static,
    ) -> Result<(Seat, Result<T, ServerFault>), ServerFault> {
        // Nobody closes the semaphore; if it were closed, the work would merely run at once.
        let asked = Instant::now();
        let _place = self.0.acquire().await;
        let done = spawn_blocking(move || {
            let begun = Instant::now();
            let result = catch_unwind(AssertUnwindSafe(|| work(&mut seat)));
            let result = result.map_err(|panic| ServerFault::simulator("simulate", text(&*panic)));
            seat.time.queue += begun - asked;
            seat.time.simulation += begun.elapsed();
            (seat, result)
        });
        done.await.map_err(|broken| ServerFault::log("simulate", broken))
    }
}

/// Ends the episode from outside, even when its simulator is in pieces.
pub(super) fn truncate(seat: &mut Seat, reason: EndReason) {
    if let Err(panic) = catch_unwind(AssertUnwindSafe(|| seat.referee.truncate(reason))) {
        ServerFault::simulator("truncate", text(&*panic));
    }
}

fn text(panic: &(dyn Any + Send)) -> String {
    let words = panic.downcast_ref::<&str>().copied();
    let words = words.or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    words.unwrap_or("panic without words").to_owned()
}
