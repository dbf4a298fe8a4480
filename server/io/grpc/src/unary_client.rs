//! A client of unary calls: its session, and the calls in progress.

use avln_proto::v1;
use std::{sync::Arc, time::Duration};
use tokio::{
    sync::watch,
    time::{Instant, sleep_until},
};

pub(crate) struct UnaryClient<S> {
    pub(crate) session: Arc<S>,
    pub(crate) welcome: v1::Welcome,
    pub(crate) calls: watch::Sender<CallTimes>,
}

/// Calls of a unary client.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CallTimes {
    /// Calls in progress.
    pub(crate) open: u32,
    /// Time of the last beginning or end.
    pub(crate) last: Instant,
}

impl<S> UnaryClient<S> {
    /// Counts a call in progress until the guard is dropped, with the call if its client cancels it.
    pub(crate) fn begin_call(&self) -> impl Drop + '_ {
        self.calls.send_modify(|calls| *calls = CallTimes { open: calls.open + 1, last: Instant::now() });
        CallInProgress(&self.calls)
    }

    /// Waits until no call has been in progress for `limit`.
    pub(crate) async fn idle(&self, limit: Duration) {
        let mut calls = self.calls.subscribe();
        loop {
            // The sender lives as long as this client.
            let Ok(CallTimes { last, .. }) =
                calls.wait_for(|calls| calls.open == 0).await.map(|calls| *calls)
            else {
                return;
            };
            let end = last + limit;
            if end <= Instant::now() {
                return;
            }
            sleep_until(end).await;
        }
    }
}

struct CallInProgress<'a>(&'a watch::Sender<CallTimes>);

impl Drop for CallInProgress<'_> {
    fn drop(&mut self) {
        self.0.send_modify(|calls| {
            *calls = CallTimes { open: calls.open.saturating_sub(1), last: Instant::now() };
        });
    }
}
