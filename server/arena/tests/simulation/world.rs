//! A simulated world: servers in succession on one data folder, the agents, and everything known about their runs.

use crate::{
    agent::{Agent, reason},
    calls::{Answer, Calls, Subject},
    database::Rows,
    ledger::Ledger,
    model::RunFacts,
    server::{Estate, Life, Remains},
    setting::{Place, START_UNIX_MS, Setting, TEAMS},
    trace::Trace,
};
use avln_arena::clock::Clock;
use avln_geom::Rng;
use avln_proto::v1::{self, Reason, play_response::Frame as Down};
use std::{sync::Arc, time::Duration};
use tokio::runtime::{Builder, Runtime};
use tonic::{Code, Status, Streaming};

/// Steps between checks of all rows.
const CHECK_EVERY: u64 = 250;
/// Longest time of an idle simulation between two steps.
const SETTLE: Duration = Duration::from_millis(1);

/// The end of a server's life.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ending {
    Crash,
    Stop,
    /// All steps are done, and the server has proved that nothing is stuck.
    Finished,
}

pub(crate) struct World {
    pub(crate) random: Rng,
    pub(crate) setting: Setting,
    pub(crate) estate: Estate,
    pub(crate) trace: Trace,
    /// Steps done, and in all.
    pub(crate) step: u64,
    pub(crate) steps: u64,
    /// Frequency of faults; 0 for a world without.
    pub(crate) unrest: f64,
    pub(crate) runs: Vec<RunFacts>,
    pub(crate) agents: Vec<Agent>,
    pub(crate) calls: Calls,
    pub(crate) watches: Vec<Streaming<v1::WatchRunResponse>>,
    /// Failing statement of the database, and the last age at which one could fail.
    pub(crate) failing: usize,
    pub(crate) failed: Option<Duration>,
    /// Expected refusal of the run that is being started.
    pub(crate) expected: Option<Reason>,
    /// Refusal of a stream, not yet checked.
    pub(crate) refused: Option<Status>,
    /// True after the proof that nothing is stuck.
    pub(crate) is_proved: bool,
    pub(crate) times: Times,
}

/// Ages of the world and its servers.
#[derive(Default)]
pub(crate) struct Times {
    /// Age at the start of the present server.
    pub(crate) age: Duration,
    /// Uptime of all earlier servers.
    pub(crate) uptime: Duration,
    /// Time that runs may have gained by the rules: heartbeats lost in crashes, and announced drains.
    pub(crate) gained: Duration,
    /// True if the wall clock was set back unnoticed, which gives runs more time.
    pub(crate) is_generous: bool,
    /// Age of the last change of the wall clock to an earlier time.
    pub(crate) set_back: Option<Duration>,
    pub(crate) drained: Option<Duration>,
    pub(crate) lives: u32,
}

impl World {
    pub(crate) fn new(seed: u64, steps: u64) -> Self {
        let mut random = Rng::new(seed);
        let setting = Setting::draw(&mut random);
        let place = threads().block_on(Place::prepare(&setting));
        let estate = Estate {
            place,
            clock: Clock::simulated(START_UNIX_MS),
            limits: setting.limits.clone(),
            issued: Arc::default(),
            runs: Arc::default(),
        };
        let unrest = *crate::setting::pick(&mut random, &[0.0, 1.0, 1.0, 3.0]);
        Self {
            random,
            setting,
            estate,
            trace: Trace::default(),
            step: 0,
            steps,
            unrest,
            runs: vec![],
            agents: vec![],
            calls: Calls::default(),
            watches: vec![],
            failing: 0,
            failed: None,
            expected: None,
            refused: None,
            is_proved: false,
            times: Times::default(),
        }
    }

    /// Plays the world to its end.
    pub(crate) fn run(&mut self) -> Result<(), String> {
        loop {
            let threads = threads();
            let simulated =
                Builder::new_current_thread().enable_time().start_paused(true).build().expect("a runtime");
            let (ending, remains) = simulated.block_on(self.live(&threads));
            self.disconnect();
            {
                let _inside = threads.enter();
                drop(simulated);
            }
            threads.block_on(remains.close());
            if ending? == Ending::Finished {
                return self.check_rest(&threads);
            }
            self.pass_downtime();
        }
    }

    fn disconnect(&mut self) {
        self.agents.iter_mut().for_each(Agent::disconnect);
        self.calls = Calls::default();
        self.watches.clear();
        self.expected = None;
    }

    /// Lets time pass without a server.
    fn pass_downtime(&mut self) {
        let downtime_s = *crate::setting::pick(&mut self.random, &[0, 2, 30, 200]);
        self.times.age += Duration::from_secs(downtime_s);
        self.times.gained += Duration::from_secs(12) + self.estate.limits.overdue_interval;
        self.times.lives += 1;
        let recently = self.times.age.saturating_sub(self.estate.limits.overdue_interval * 2);
        self.times.is_generous |= self.times.set_back.is_some_and(|set_back| set_back >= recently);
        if self.random.chance(0.1) {
            self.set_clock(self.times.age);
        }
        self.estate.clock.set_age(self.times.age);
    }

    /// Sets the wall clock forwards or back.
    pub(crate) fn set_clock(&mut self, age: Duration) {
        const MINUTE_MS: i64 = 60_000;
        let by_min = *crate::setting::pick(&mut self.random, &[1_i64, 61, 600, 1440, 3 * 1440]);
        let by_ms = if self.random.chance(0.5) { by_min * MINUTE_MS } else { -by_min * MINUTE_MS };
        self.estate.clock.set_by(by_ms);
        if by_ms < 0 {
            self.times.set_back = Some(age);
        }
        self.trace.add(age, format_args!("the wall clock is set by {by_min} min, {by_ms} ms"));
    }

    /// Runs a server from its start to its end.
    async fn live(&mut self, threads: &Runtime) -> (Result<Ending, String>, Remains) {
        let fuse = if self.random.chance(0.1 * self.unrest) { 1 + self.random.below(12) as u32 } else { 0 };
        let opened = Life::open(&self.estate, threads.handle(), self.times.age, fuse).await;
        self.trace.add(self.times.age, format_args!("server {} starts", self.times.lives + 1));
        let mut life = match opened {
            Ok(life) => life,
            Err(remains) => return (Ok(Ending::Crash), remains),
        };
        let ending = self.serve(&mut life).await;
        let age = life.age();
        if ending == Ok(Ending::Stop) {
            life.stop().await;
        }
        self.trace.add(age, format_args!("the server ends: {ending:?}"));
        if let Some(since) = self.times.drained.take() {
            self.times.gained += age - since;
        }
        self.times.uptime += age - self.times.age;
        self.times.age = age;
        (ending, life.into_remains())
    }

    async fn serve(&mut self, life: &mut Life) -> Result<Ending, String> {
        self.failing = 0;
        while self.step < self.steps {
            self.step += 1;
            if let Some(ending) = self.take_step(life).await? {
                return Ok(ending);
            }
            self.settle(life).await?;
            if self.step.is_multiple_of(CHECK_EVERY) && !life.faults().has_crashed() {
                self.check(life).await?;
            }
            if life.faults().has_crashed() {
                return Ok(Ending::Crash);
            }
        }
        self.prove(life).await
    }

    /// Lets the server do everything that it can do now, and follows its answers.
    pub(crate) async fn settle(&mut self, life: &Life) -> Result<(), String> {
        tokio::time::sleep(SETTLE).await;
        let age = life.age();
        if self.failing > 0 {
            self.failed = Some(age);
        }
        if let Some(status) = self.refused.take() {
            self.check_status(&status, age)?;
        }
        while let Some((subject, answer)) = self.calls.next() {
            self.take_answer(subject, answer, life)?;
        }
        for agent in 0..self.agents.len() {
            self.read(agent, age)?;
        }
        self.read_watches();
        if life.faults().has_crashed() {
            return Ok(());
        }
        self.calls.check_answers(age)
    }

    /// Reads everything that has arrived for an agent.
    fn read(&mut self, index: usize, age: Duration) -> Result<(), String> {
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
                        self.agents[index].is_done |= reason == Some(Reason::RunOver) && index % 3 != 0;
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

    fn read_watches(&mut self) {
        use tokio_stream::Stream;
        let mut now = std::task::Context::from_waker(std::task::Waker::noop());
        self.watches.retain_mut(|watch| {
            loop {
                match std::pin::Pin::new(&mut *watch).poll_next(&mut now) {
                    std::task::Poll::Pending => return true,
                    std::task::Poll::Ready(Some(Ok(_))) => {}
                    std::task::Poll::Ready(_) => return false,
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

    fn take_answer(
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
        let started = match answer {
            Ok(Answer::Start(started)) => started,
            Ok(_) => return Err("an answer to another call".to_owned()),
            Err(status) => {
                let reason = reason(&status);
                let is_expected = reason == expected
                    || matches!(reason, Some(Reason::Internal | Reason::Draining | Reason::NoCapacity));
                return if is_expected { Ok(()) } else { Err(format!("{status:?} instead of {expected:?}")) };
            }
        };
        let id = started.run.clone().unwrap_or_default().id;
        let same = |run: &RunFacts| (run.team, &run.request_id) == (team, &request_id);
        let earlier = self.runs.iter().position(same);
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
        let named = self.estate.runs.load(std::sync::atomic::Ordering::Relaxed);
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

    /// Returns the world's numbers.
    pub(crate) fn summary(&self) -> String {
        let ends =
            self.runs.iter().flat_map(|run| run.episodes.values()).filter(|episode| episode.has_result());
        let (step, runs, ends) = (self.step, self.runs.len(), ends.count());
        let (lives, hours) = (self.times.lives + 1, self.times.age.as_secs_f64() / 3600.0);
        format!("{step} steps, {runs} runs, {ends} results, {lives} servers, {hours:.1} h")
    }

    /// Returns the uptime of all servers.
    pub(crate) fn uptime(&self, life: &Life) -> Duration {
        self.times.uptime + (life.age() - life.began)
    }

    /// Returns the reason for which a new run of a team would be refused now.
    pub(crate) fn refusal(&self, team: usize, phase: usize, rows: &Rows) -> Option<Reason> {
        let now_unix_ms = self.estate.clock.now_unix_ms();
        Ledger::new(TEAMS[team], &self.setting.phases[phase], rows, now_unix_ms).refusal()
    }

    /// Repairs the database.
    pub(crate) fn heal(&mut self, life: &mut Life) {
        self.fail(life, 0);
    }

    /// Lets a statement of the database fail.
    pub(crate) fn fail(&mut self, life: &mut Life, statement: usize) {
        let border = life.border().clone();
        border.cross(life.database.fail(statement));
        self.failing = statement;
        if statement > 0 {
            self.failed = Some(life.age());
        }
    }
}

/// A runtime with real threads for the arena.
fn threads() -> Runtime {
    Builder::new_multi_thread().worker_threads(1).enable_all().build().expect("a runtime")
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
