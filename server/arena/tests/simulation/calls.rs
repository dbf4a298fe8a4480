//! Unary calls in progress: each runs in a task, because it may wait for the end of a session.

use avln_proto::v1;
use std::{collections::BTreeMap, time::Duration};
use tokio::sync::mpsc;
use tonic::{Response, Status};

/// Simulated time in which every call has an answer, also if it ends a session first.
const PATIENCE: Duration = Duration::from_secs(3);

/// A call's subject.
#[derive(Clone, Debug)]
pub(crate) enum Subject {
    Start {
        team: usize,
        phase: usize,
        request_id: String,
    },
    /// Index of the agent.
    Reset(usize),
    Step(usize),
    End(usize),
    Look,
}

/// An answer.
pub(crate) enum Answer {
    Start(v1::StartRunResponse),
    Reset(v1::ResetResponse),
    Step(v1::StepResponse),
    End(v1::EndResponse),
    Nothing,
}

type Answered = (u64, Result<Answer, Status>);

pub(crate) struct Calls {
    next: u64,
    open: BTreeMap<u64, (Subject, Duration)>,
    answered: mpsc::UnboundedReceiver<Answered>,
    answers: mpsc::UnboundedSender<Answered>,
}

impl Default for Calls {
    fn default() -> Self {
        let (answers, answered) = mpsc::unbounded_channel();
        Self { next: 0, open: BTreeMap::new(), answered, answers }
    }
}

impl Calls {
    /// Begins a call.
    pub(crate) fn begin<T: Send + 'static>(
        &mut self,
        subject: Subject,
        age: Duration,
        call: impl Future<Output = Result<Response<T>, Status>> + Send + 'static,
        answer: impl FnOnce(T) -> Answer + Send + 'static,
    ) {
        self.next += 1;
        let (number, answers) = (self.next, self.answers.clone());
        self.open.insert(number, (subject, age));
        tokio::spawn(async move {
            let answered = call.await.map(|response| answer(response.into_inner()));
            let _ = answers.send((number, answered));
        });
    }

    /// Returns the next answer.
    pub(crate) fn next(&mut self) -> Option<(Subject, Result<Answer, Status>)> {
        let (number, answer) = self.answered.try_recv().ok()?;
        self.open.remove(&number).map(|(subject, _)| (subject, answer))
    }

    /// Fails if a call has no answer for too long.
    pub(crate) fn check_answers(&self, age: Duration) -> Result<(), String> {
        match self.open.values().find(|(_, since)| age.saturating_sub(*since) > PATIENCE) {
            Some((subject, since)) => Err(format!("{subject:?} has no answer since {since:?}")),
            None => Ok(()),
        }
    }

    pub(crate) fn count(&self) -> usize {
        self.open.len()
    }
}
