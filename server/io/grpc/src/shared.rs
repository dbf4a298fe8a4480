//! A shared value with waiters, served in the order of their arrival.

use parking_lot::Mutex;
use tokio::sync::Notify;

/// A shared value. After a change, waiters look at it in the order in which they began to wait.
// tokio's `watch` wakes them in random order: of two connections that wait for a session, either could be first, and a simulation
// of the server could not be repeated.
#[derive(Debug, Default)]
pub(crate) struct Shared<T> {
    value: Mutex<T>,
    changed: Notify,
}

impl<T> Shared<T> {
    pub(crate) fn read<R>(&self, look: impl FnOnce(&T) -> R) -> R {
        look(&self.value.lock())
    }

    pub(crate) fn set(&self, value: T) {
        self.modify(|held| *held = value);
    }

    pub(crate) fn modify(&self, change: impl FnOnce(&mut T)) {
        change(&mut self.value.lock());
        self.changed.notify_waiters();
    }

    /// Waits until `find` returns something for the value.
    pub(crate) async fn wait_for<R>(&self, mut find: impl FnMut(&T) -> Option<R>) -> R {
        loop {
            // Before the look: a change after it wakes this waiter.
            let changed = self.changed.notified();
            if let Some(found) = self.read(&mut find) {
                return found;
            }
            changed.await;
        }
    }

    /// Waits until `is_met` holds for the value.
    pub(crate) async fn wait_until(&self, is_met: impl Fn(&T) -> bool) {
        self.wait_for(|value| is_met(value).then_some(())).await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use tokio::task::{JoinSet, yield_now};

    #[tokio::test]
    async fn waiters_proceed_in_order_of_arrival() {
        let shared = Arc::<Shared<u32>>::default();
        let order = Arc::new(Mutex::new(Vec::new()));
        let mut waiters = JoinSet::new();
        for number in 0..20 {
            let (shared, order) = (shared.clone(), order.clone());
            waiters.spawn(async move {
                shared.wait_until(|value| *value > 1).await;
                order.lock().push(number);
            });
        }
        yield_now().await;
        shared.set(1);
        yield_now().await;
        shared.modify(|value| *value += 1);
        waiters.join_all().await;
        assert_eq!(*order.lock(), (0..20).collect::<Vec<_>>());
    }
}
