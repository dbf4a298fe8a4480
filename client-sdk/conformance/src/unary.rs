//! Unary calls of the test server, with lost and late answers.

use crate::frames;
use crate::host::{Fake, OBSERVATION_DELAY, REFUSED_CALLS};
use crate::scenario::InjectedFault;
use crate::trials::{FAULT_STEP, Transport, TrialRun, UnaryCall};
use avln_proto::v1::{self, end_request, end_response, reset_response::Outcome};
use tokio::time::sleep;
use tonic::Status;

impl Fake {
    /// Handles Reset: Hello and Ready in a single call.
    pub(crate) async fn reset_slot(&self, request: v1::ResetRequest) -> Result<v1::ResetResponse, Status> {
        let hello = request.hello.unwrap_or_default();
        let slot = request.ready.unwrap_or_default().slot;
        let mut run = self.run.lock().await;
        // A client that lost RunEnd repeats Reset.
        if run.is_unary() && run.is_over() {
            return Ok(no_episode(&run));
        }
        self.admit(&mut run, Transport::Unary)?;
        compare_repeated(&mut run, &UnaryCall::Reset { slot });
        run.agree(&hello);
        let welcome = frames::welcome(&run);
        if !is_repeated(&run, slot, hello.resume) {
            run.ready(slot).map_err(|reason| frames::refusal(reason, None))?;
            if !run.has_next(slot) {
                self.finish(&mut run);
                return Ok(no_episode(&run));
            }
            run.begin(slot);
        }
        if run.fault(slot) == InjectedFault::LostStart && run.inject_at(slot, 0) {
            return Err(lost_answer(&mut run, UnaryCall::Reset { slot }));
        }
        run.observation_sent(slot);
        let start = run.open.get(&slot).map(|open| Outcome::EpisodeStart(frames::start(&run, open)));
        Ok(v1::ResetResponse { welcome: Some(welcome), outcome: start })
    }

    /// Handles Step: an action and its observation.
    pub(crate) async fn step_slot(&self, request: v1::StepRequest) -> Result<v1::StepResponse, Status> {
        let act = request.act.unwrap_or_default();
        let mut run = self.run.lock().await;
        self.admit(&mut run, Transport::Unary)?;
        compare_repeated(&mut run, &UnaryCall::Step(act.clone()));
        if run.report_loss(act.slot, &act.episode) {
            return Err(frames::refusal(v1::Reason::EpisodeUnknown, None));
        }
        run.act(&act).map_err(|reason| frames::refusal(reason, None))?;
        let fault = run.fault(act.slot);
        let is_due = fault.needs_steps() && run.inject_at(act.slot, FAULT_STEP);
        if is_due && let Some(response) = self.before_answer(&mut run, &act, fault).await? {
            return Ok(response);
        }
        let response = answer(&mut run, &act)?;
        match fault {
            InjectedFault::Unreachable if is_due => run.refuse = REFUSED_CALLS,
            InjectedFault::Reissued if is_due => run.drop_episode(act.slot),
            _ => {}
        }
        Ok(response)
    }

    /// Injects a fault; returns the answer if it replaces the observation.
    async fn before_answer(
        &self,
        run: &mut TrialRun,
        act: &v1::Act,
        fault: InjectedFault,
    ) -> Result<Option<v1::StepResponse>, Status> {
        match fault {
            InjectedFault::LateObservation => sleep(OBSERVATION_DELAY).await,
            InjectedFault::LostObservation => return Err(lost_answer(run, UnaryCall::Step(act.clone()))),
            InjectedFault::Superseded => {
                run.supersede(act.slot);
                self.count_frame();
                return Err(frames::refusal(v1::Reason::Superseded, None));
            }
            InjectedFault::SimulatorFault => {
                let ended = run.close(act.slot);
                let end = ended.map(|open| frames::end(run, &open, v1::EndReason::ServerFault));
                return Ok(Some(v1::StepResponse { observation: None, episode_end: end }));
            }
            _ => {}
        }
        Ok(None)
    }

    /// Handles End: Abandon or Goodbye.
    pub(crate) async fn end_slot(&self, request: v1::EndRequest) -> Result<v1::EndResponse, Status> {
        let mut run = self.run.lock().await;
        let is_goodbye = matches!(request.frame, Some(end_request::Frame::Goodbye(_)));
        if !(is_goodbye && run.is_unary() && run.is_over()) {
            self.admit(&mut run, Transport::Unary)?;
        }
        compare_repeated(&mut run, &UnaryCall::End);
        let frame = match request.frame {
            Some(end_request::Frame::Abandon(abandon)) => {
                run.violation(Some(abandon.slot), "the client abandoned the episode");
                let ended = run.close(abandon.slot);
                let open = ended.ok_or_else(|| frames::refusal(v1::Reason::EpisodeUnknown, None))?;
                let end = frames::end(&run, &open, v1::EndReason::Abandoned);
                end_response::Frame::EpisodeEnd(end)
            }
            Some(end_request::Frame::Goodbye(_)) => {
                self.finish(&mut run);
                end_response::Frame::RunEnd(frames::run_end(&run))
            }
            None => return Err(frames::refusal(v1::Reason::BadRequest, None)),
        };
        Ok(v1::EndResponse { frame: Some(frame) })
    }
}

fn no_episode(run: &TrialRun) -> v1::ResetResponse {
    let outcome = Some(Outcome::RunEnd(frames::run_end(run)));
    v1::ResetResponse { welcome: Some(frames::welcome(run)), outcome }
}

/// Returns true for a Reset that returns the open episode: with `resume`, or again before the first step.
fn is_repeated(run: &TrialRun, slot: u32, resumes: bool) -> bool {
    run.open.get(&slot).is_some_and(|open| resumes || open.step() == 0)
}

fn compare_repeated(run: &mut TrialRun, call: &UnaryCall) {
    let Some(lost) = run.lost_call.take().filter(|lost| lost != call) else { return };
    let slot = match &lost {
        UnaryCall::Reset { slot } => Some(*slot),
        UnaryCall::Step(act) => Some(act.slot),
        UnaryCall::End => None,
    };
    run.violation(slot, format!("after a lost answer: expected the same {lost:?}, got {call:?}"));
}

fn lost_answer(run: &mut TrialRun, call: UnaryCall) -> Status {
    run.lost_call = Some(call);
    Status::unavailable("the conformance kit lost the answer")
}

/// Returns the observation after an action, and the end of the episode.
fn answer(run: &mut TrialRun, act: &v1::Act) -> Result<v1::StepResponse, Status> {
    let open = run.open.get(&act.slot).cloned();
    let open = open.ok_or_else(|| frames::refusal(v1::Reason::EpisodeUnknown, None))?;
    let is_lost = run.fault(act.slot) == InjectedFault::LostEnd && open.over.is_some();
    if is_lost && run.inject_at(act.slot, open.step()) {
        return Err(lost_answer(run, UnaryCall::Step(act.clone())));
    }
    let observation = Some(frames::observation(run, &open));
    run.observation_sent(act.slot);
    let ended = open.over.and_then(|reason| Some((run.close(act.slot)?, reason)));
    let episode_end = ended.map(|(open, reason)| frames::end(run, &open, reason));
    Ok(v1::StepResponse { observation, episode_end })
}
