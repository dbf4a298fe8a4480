//! Answers of the server: frames, statuses and answers to unary calls, compared with everything known before.

use super::{
    agent::{Agent, RunFacts, reason},
    server::{Answer, Life, Subject},
    world::World,
};
use avln_proto::v1::{self, Reason, play_response::Frame as Down};
use std::{
    pin::Pin,
    sync::atomic::Ordering,
    task::{Context, Poll, Waker},
    time::Duration,
};
use tokio_stream::Stream;
use tonic::{Code, Status};

impl World {
    /// Reads everything that has arrived for an agent.
    pub(crate) fn read(&mut self, index: usize, age: Duration) -> Result<(), String> {
        let mut streams = std::mem::take(&mut self.agents[index].streams);
        let mut closed = Vec::new();
        for (number, stream) in streams.iter_mut().enumerate() {
            if !stream.reads(age) {
                continue;
            }
            while let Some(arrived) = stream.next() {
                match arrived {
                    Some(Ok(frame)) => {
                        stream.follow(&frame, age);
                        let run = &self.runs[self.agents[index].run];
                        let fresh = stream.is_prompt && stream.attachment == run.attachments;
                        self.take_frame((index, number), &frame, fresh, age)?;
                    }
                    Some(Err(status)) => {
                        let reason = reason(&status);
                        self.trace.add(age, format_args!("agent {index}.{number} < {reason:?}"));
                        // Some agents ask for the summary.
                        self.agents[index].is_done |=
                            reason == Some(Reason::RunOver) && !index.is_multiple_of(3);
                        self.check_status(&status, age)?;
                        closed.push(number);
                        break;
                    }
                    None => {
                        self.trace.add(age, format_args!("agent {index}.{number} < end"));
                        closed.push(number);
                        break;
                    }
                }
            }
            if !closed.contains(&number) && !stream.is_half_closed() {
                stream.check_answers(age).map_err(|late| format!("agent {index}.{number}: {late}"))?;
            }
        }
        let mut number = 0;
        streams.retain(|_| {
            number += 1;
            !closed.contains(&(number - 1))
        });
        self.agents[index].streams = streams;
        Ok(())
    }

    fn take_frame(
        &mut self,
        (agent, stream): (usize, usize),
        frame: &Down,
        fresh: bool,
        age: Duration,
    ) -> Result<(), String> {
        if !matches!(frame, Down::Ping(_)) {
            self.trace.add(age, format_args!("agent {agent}.{stream} < {}", brief(frame)));
        }
        if let Down::Fault(fault) = frame {
            self.check_reason(fault.reason(), age).map_err(|wrong| format!("{wrong}: {fault:?}"))?;
        }
        self.agents[agent].is_done |= matches!(frame, Down::RunEnd(_));
        let run = self.agents[agent].run;
        self.runs[run].take(frame, fresh).map_err(|wrong| format!("{}: {wrong}", self.runs[run].id))
    }

    pub(crate) fn read_watches(&mut self) {
        let mut now = Context::from_waker(Waker::noop());
        self.watches.retain_mut(|watch| {
            loop {
                match Pin::new(&mut *watch).poll_next(&mut now) {
                    Poll::Pending => return true,
                    Poll::Ready(Some(Ok(_))) => {}
                    Poll::Ready(_) => return false,
                }
            }
        });
    }

    /// Checks that a refusal is one of `PROTOCOL.md`, and no failure of an undisturbed server.
    pub(crate) fn check_status(&self, status: &Status, age: Duration) -> Result<(), String> {
        let Some(reason) = reason(status) else {
            return Err(format!("a status without a reason: {status:?}"));
        };
        let has_code = status.code() == reason.code() && status.code() != Code::Ok;
        let checked = if has_code { self.check_reason(reason, age) } else { Err("a wrong code".to_owned()) };
        checked.map_err(|wrong| format!("{wrong}: {status:?}"))
    }

    fn check_reason(&self, reason: Reason, age: Duration) -> Result<(), String> {
        let failed = self.failed.is_some_and(|failed| age.saturating_sub(failed) < Duration::from_secs(60));
        match reason {
            Reason::Unspecified => Err("no reason".to_owned()),
            Reason::Internal if !failed => Err("a failure of an undisturbed server".to_owned()),
            Reason::SimFault if self.unrest == 0.0 => Err("a simulator fault without a cause".to_owned()),
            _ => Ok(()),
        }
    }

    pub(crate) fn take_answer(
        &mut self,
        subject: Subject,
        answer: Result<Answer, Status>,
        life: &Life,
    ) -> Result<(), String> {
        let age = life.age();
        match &answer {
            Ok(_) => self.trace.add(age, format_args!("{subject:?} < OK")),
            Err(status) => {
                self.trace.add(age, format_args!("{subject:?} < {:?}", reason(status)));
                self.check_status(status, age)?;
            }
        }
        match (subject, answer) {
            (Subject::Start { team, phase, request_id }, answer) => {
                self.take_run(team, phase, request_id, answer, life)
            }
            (Subject::Reset(agent), answer) => self.take_reset(agent, answer),
            (Subject::Step(agent), answer) => self.take_unary_step(agent, answer),
            (Subject::End(agent), answer) => self.take_unary_end(agent, answer),
            (Subject::Look, _) => Ok(()),
        }
    }

    /// Takes the answer to StartRun: a repeated request has the same run, and any other the verdict of the ledger.
    fn take_run(
        &mut self,
        team: usize,
        phase: usize,
        request_id: String,
        answer: Result<Answer, Status>,
        life: &Life,
    ) -> Result<(), String> {
        let expected = self.expected.take();
        let same = |run: &RunFacts| (run.team, &run.request_id) == (team, &request_id);
        let earlier = self.runs.iter().position(same);
        let is_repeated = earlier.is_some();
        let started = match answer {
            Ok(Answer::Start(started)) => started,
            Ok(_) => return Err("an answer to another call".to_owned()),
            Err(status) => {
                let reason = reason(&status);
                let is_expected = (reason == expected && !is_repeated)
                    || matches!(reason, Some(Reason::Internal | Reason::Draining | Reason::NoCapacity));
                return if is_expected { Ok(()) } else { Err(format!("{status:?} instead of {expected:?}")) };
            }
        };
        let id = started.run.clone().unwrap_or_default().id;
        let run = match earlier {
            Some(run) if self.runs[run].id == id => run,
            Some(run) => return Err(format!("request {request_id} gave {} and {id}", self.runs[run].id)),
            // The answer to an earlier request may have been lost in a crash.
            None if expected.is_some() && !self.was_started(&id) => {
                return Err(format!("{id} started although {expected:?}"));
            }
            None => {
                let started = self.uptime(life);
                self.runs.push(RunFacts::new(id, (team, phase), request_id, started));
                self.runs.len() - 1
            }
        };
        self.agents.push(Agent::new(run, started.run_token));
        Ok(())
    }

    /// Returns whether the run was named before the last request.
    fn was_started(&self, id: &str) -> bool {
        let named = self.estate.runs.load(Ordering::Relaxed);
        id != format!("run_{:06}", named.saturating_sub(1))
    }

    fn take_reset(&mut self, agent: usize, answer: Result<Answer, Status>) -> Result<(), String> {
        self.agents[agent].is_calling = false;
        let Ok(Answer::Reset(answer)) = answer else { return Ok(()) };
        let run = &mut self.runs[self.agents[agent].run];
        let fresh = self.agents[agent].attachment == run.attachments;
        if let Some(welcome) = &answer.welcome {
            run.take_welcome(welcome)?;
            if !welcome.resumed.is_empty() {
                return Err(format!("a unary Welcome with positions: {welcome:?}"));
            }
        }
        match answer.outcome {
            Some(v1::reset_response::Outcome::EpisodeStart(start)) => {
                run.start(&start, fresh)?;
                let step = start.observation.map_or(0, |seen| seen.step);
                self.agents[agent].unary = Some((start.episode, step));
                Ok(())
            }
            Some(v1::reset_response::Outcome::RunEnd(end)) => {
                self.agents[agent].is_done = true;
                run.finish(&end)
            }
            None => Err("an empty answer to Reset".to_owned()),
        }
    }

    fn take_unary_step(&mut self, agent: usize, answer: Result<Answer, Status>) -> Result<(), String> {
        self.agents[agent].is_calling = false;
        let Ok(Answer::Step(answer)) = answer else { return Ok(()) };
        let run = &mut self.runs[self.agents[agent].run];
        if let Some(seen) = &answer.observation {
            run.take(&Down::Observation(seen.clone()), false)?;
            self.agents[agent].unary = Some((seen.episode.clone(), seen.step));
        }
        if let Some(end) = answer.episode_end {
            run.take(&Down::EpisodeEnd(end), false)?;
            self.agents[agent].unary = None;
        }
        Ok(())
    }

    fn take_unary_end(&mut self, agent: usize, answer: Result<Answer, Status>) -> Result<(), String> {
        self.agents[agent].is_calling = false;
        let Ok(Answer::End(answer)) = answer else { return Ok(()) };
        let run = &mut self.runs[self.agents[agent].run];
        self.agents[agent].unary = None;
        match answer.frame {
            Some(v1::end_response::Frame::EpisodeEnd(end)) => run.take(&Down::EpisodeEnd(end), false),
            Some(v1::end_response::Frame::RunEnd(end)) => {
                self.agents[agent].is_done = true;
                run.finish(&end)
            }
            None => Err("an empty answer to End".to_owned()),
        }
    }
}

/// Returns a frame without the parts that differ between two simulations with the same seed.
fn brief(frame: &Down) -> String {
    match frame {
        Down::Welcome(welcome) => format!("Welcome {} slots, resumed {:?}", welcome.slots, welcome.resumed),
        Down::EpisodeStart(start) => format!("EpisodeStart {} {}", start.slot, start.episode),
        Down::Observation(seen) => {
            format!("Observation {} {} {} {:?}", seen.slot, seen.episode, seen.step, seen.reason())
        }
        Down::EpisodeEnd(end) => {
            format!("EpisodeEnd {} {} {} {:?}", end.slot, end.episode, end.step, end.reason())
        }
        Down::Fault(fault) => {
            format!("Fault {:?} {} {} {:?}", fault.slot, fault.episode, fault.step, fault.reason())
        }
        Down::RunEnd(end) => format!("RunEnd complete {}", end.complete),
        Down::Notice(notice) => format!("Notice {:?}", notice.kind()),
        Down::Ping(_) => "Ping".to_owned(),
    }
}
