//! Steps of a simulation, drawn at random.

use super::{
    agent::{Agent, Connection, sensors},
    database::FRAGILE_STATEMENTS,
    server::{Answer, Life, Subject, authorised},
    setting::{PHASES, SLOTS, TEAMS, pick},
    world::{Ending, World},
};
use avln_proto::v1::{self, Reason, end_request::Frame as Last, play_request::Frame as Up};
use std::{sync::atomic::Ordering, time::Duration};

/// Agents that play at the same time.
const PLAYERS: usize = 8;
/// Longest wait between two looks at the server, less than the time in which an agent must read.
const NAP: Duration = Duration::from_secs(5);

/// A kind of step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Play,
    Start,
    Look,
    Watch,
    Cancel,
    CancelOutside,
    SetClock,
    WaitBriefly,
    Wait,
    WaitLong,
    Reschedule,
    Grant,
    Stop,
    Drain,
    PanicInStep,
    HangInStep,
    PanicInStart,
    HangInStart,
    FailLog,
    FailDatabase,
    Crash,
    CrashSoon,
}

/// Steps with their frequency.
const STEPS: [(u32, Kind); 14] = [
    (2000, Kind::Play),
    (15, Kind::Start),
    (2, Kind::Look),
    (2, Kind::Watch),
    (4, Kind::Cancel),
    (2, Kind::CancelOutside),
    (6, Kind::SetClock),
    (40, Kind::WaitBriefly),
    (6, Kind::Wait),
    (1, Kind::WaitLong),
    (5, Kind::Reschedule),
    (3, Kind::Grant),
    (1, Kind::Stop),
    (1, Kind::Drain),
];

/// Faults with their frequency in a world of normal unrest.
const FAULTS: [(u32, Kind); 8] = [
    (10, Kind::PanicInStep),
    (6, Kind::HangInStep),
    (4, Kind::PanicInStart),
    (3, Kind::HangInStart),
    (8, Kind::FailLog),
    (6, Kind::FailDatabase),
    (1, Kind::Crash),
    (2, Kind::CrashSoon),
];

impl World {
    /// Takes a step. Returns how the server ends, if it does.
    pub(crate) async fn take_step(&mut self, life: &mut Life) -> Result<Option<Ending>, String> {
        if self.failing > 0 && self.random.chance(0.04) {
            self.heal(life);
        }
        // Between the failure and the repair, the database and the run logs differ.
        if self.failing > 0 && self.random.chance(0.005) {
            return Ok(Some(Ending::Crash));
        }
        if self.times.drained.is_some() && self.random.chance(0.03) {
            return Ok(Some(Ending::Stop));
        }
        let kind = self.draw();
        match kind {
            Kind::Play => self.play(life).await,
            Kind::Start => {
                let (team, phase) = (self.random.below(TEAMS.len()), self.random.below(PHASES.len()));
                let expected = self.forecast(life, team, phase);
                self.start(life, team, phase, expected);
            }
            Kind::Look => self.look(life),
            Kind::Watch => self.watch(life).await,
            Kind::Cancel => self.cancel(life),
            Kind::WaitBriefly => self.wait(life, &[100, 500, 1500, 3000]).await?,
            Kind::Wait => self.wait(life, &[6000, 12_000, 25_000, 45_000]).await?,
            Kind::WaitLong => self.wait(life, &[100_000, 200_000, 400_000]).await?,
            Kind::SetClock => self.set_clock(life.age()),
            Kind::Stop => return Ok(Some(Ending::Stop)),
            Kind::Crash => return Ok(Some(Ending::Crash)),
            Kind::CancelOutside | Kind::Reschedule | Kind::Grant | Kind::Drain => self.organise(kind, life),
            _ => self.disturb(kind, life),
        }
        Ok(None)
    }

    fn draw(&mut self) -> Kind {
        let unrest = (10.0 * self.unrest) as u32;
        let steps = STEPS.iter().map(|(weight, kind)| (10 * weight, *kind));
        let faults = FAULTS.iter().map(|(weight, kind)| (unrest * weight, *kind));
        let all: Vec<_> = steps.chain(faults).collect();
        let sum: u32 = all.iter().map(|(weight, _)| weight).sum();
        let mut drawn = self.random.below(sum as usize) as u32;
        for (weight, kind) in all {
            if drawn < weight {
                return kind;
            }
            drawn -= weight;
        }
        Kind::Play
    }

    /// Lets time pass.
    async fn wait(&mut self, life: &Life, choices_ms: &[u64]) -> Result<(), String> {
        let mut left = Duration::from_millis(*pick(&mut self.random, choices_ms));
        self.trace.add(life.age(), format_args!("wait {left:?}"));
        // Every watched run is looked up once per second.
        self.watches.truncate(1);
        while !left.is_zero() && !life.faults().has_crashed() {
            let nap = left.min(NAP);
            tokio::time::sleep(nap).await;
            left -= nap;
            self.settle(life).await?;
        }
        Ok(())
    }

    /// Returns the reason for which a new run of a team would be refused now.
    fn forecast(&self, life: &mut Life, team: usize, phase: usize) -> Option<Reason> {
        let border = life.border().clone();
        let rows = border.cross(life.database.rows(Some((TEAMS[team], PHASES[phase]))));
        self.refusal(team, phase, &rows)
    }

    /// Sends StartRun, sometimes with the id of an earlier request.
    fn start(&mut self, life: &Life, team: usize, phase: usize, expected: Option<Reason>) {
        let known: Vec<_> = self.runs.iter().filter(|run| (run.team, run.phase) == (team, phase)).collect();
        let (repeats, fresh) = (self.random.chance(0.2), format!("request {}", self.step));
        let request_id = match known.last() {
            Some(run) if repeats => run.request_id.clone(),
            _ => fresh,
        };
        self.expected = expected;
        self.trace
            .add(life.age(), format_args!("{} starts '{request_id}' in {}", TEAMS[team], PHASES[phase]));
        self.send_start(life, team, phase, request_id);
    }

    pub(crate) fn send_start(&mut self, life: &Life, team: usize, phase: usize, request_id: String) {
        let request = v1::StartRunRequest {
            phase: PHASES[phase].to_owned(),
            order: v1::Order::Unordered.into(),
            method: Some(v1::MethodInfo { name: "agent".to_owned(), ..Default::default() }),
            client_request_id: request_id.clone(),
            client: None,
        };
        let request = authorised(request, &self.estate.place.tokens[team]);
        let mut runs = life.runs();
        let call = async move { runs.start_run(request).await };
        self.calls.begin(Subject::Start { team, phase, request_id }, life.age(), call, Answer::Start);
    }

    fn look(&mut self, life: &Life) {
        let team = self.random.below(TEAMS.len());
        let token = &self.estate.place.tokens[team];
        let (mut runs, age) = (life.runs(), life.age());
        let nothing = |_| Answer::Nothing;
        match self.random.below(2) {
            0 => {
                let request = authorised(v1::ListRunsRequest::default(), token);
                let call = async move { runs.list_runs(request).await };
                self.calls.begin(Subject::Look, age, call, nothing);
            }
            _ => {
                let request = authorised(v1::GetQuotaRequest::default(), token);
                let call = async move { runs.get_quota(request).await };
                self.calls.begin(Subject::Look, age, call, |_| Answer::Nothing);
            }
        }
    }

    /// Returns a recent run.
    pub(crate) fn recent_run(&mut self) -> Option<usize> {
        let recent = self.runs.len().min(PLAYERS);
        (recent > 0).then(|| self.runs.len() - 1 - self.random.below(recent))
    }

    async fn watch(&mut self, life: &Life) {
        let Some(run) = self.recent_run() else { return };
        let (id, team) = (self.runs[run].id.clone(), self.runs[run].team);
        self.trace.add(life.age(), format_args!("watch {id}"));
        let request = authorised(v1::WatchRunRequest { run: id }, &self.estate.place.tokens[team]);
        if self.random.chance(0.8) {
            self.watches.clear();
        }
        if let Ok(Ok(watch)) =
            tokio::time::timeout(super::server::AT_ONCE, life.runs().watch_run(request)).await
        {
            self.watches.push(watch.into_inner());
        }
    }

    fn cancel(&mut self, life: &Life) {
        let Some(run) = self.recent_run() else { return };
        let (id, team) = (self.runs[run].id.clone(), self.runs[run].team);
        self.trace.add(life.age(), format_args!("cancel {id}"));
        let request = authorised(v1::CancelRunRequest { run: id }, &self.estate.place.tokens[team]);
        let mut runs = life.runs();
        let call = async move { runs.cancel_run(request).await };
        self.calls.begin(Subject::Look, life.age(), call, |_| Answer::Nothing);
    }

    /// Acts as the organiser.
    fn organise(&mut self, kind: Kind, life: &Life) {
        let (team, phase) = (self.random.below(TEAMS.len()), self.random.below(PHASES.len()));
        let choice = self.random.below(6);
        match kind {
            Kind::CancelOutside => self.cancel_outside(life),
            Kind::Reschedule => self.reschedule(life, phase, choice),
            Kind::Grant => self.grant(life, team, phase, 1 + choice as u32),
            _ => self.drain(life),
        }
    }

    /// Prepares a fault.
    fn disturb(&mut self, kind: Kind, life: &mut Life) {
        self.trace.add(life.age(), format_args!("{kind:?}"));
        let count = 1 + self.random.below(3) as u32;
        let faults = life.faults();
        match kind {
            Kind::PanicInStep => faults.panicking_steps.store(count, Ordering::Relaxed),
            Kind::HangInStep => faults.hanging_steps.store(count, Ordering::Relaxed),
            Kind::PanicInStart => faults.panicking_starts.store(count, Ordering::Relaxed),
            Kind::HangInStart => faults.hanging_starts.store(count, Ordering::Relaxed),
            Kind::FailLog => faults.failing_lines.store(count, Ordering::Relaxed),
            Kind::CrashSoon => faults.crash_after(1 + self.random.below(40) as u32),
            _ => {
                let statement = 1 + self.random.below(FRAGILE_STATEMENTS);
                self.fail(life, statement);
            }
        }
    }

    /// Lets an agent do something.
    async fn play(&mut self, life: &mut Life) {
        let Some(agent) = self.draw_agent() else { return self.revive(life) };
        let streams = self.agents[agent].streams.len();
        let is_unary = self.agents[agent].unary.is_some() || self.agents[agent].is_calling;
        match streams {
            0 if is_unary && self.random.chance(0.9) => self.call(agent, life),
            0 if self.random.chance(0.3) => self.reset(agent, life),
            0 => self.connect(agent, life).await,
            _ if self.random.chance(0.004) => self.connect(agent, life).await,
            _ if self.random.chance(0.002) => self.reset(agent, life),
            _ => {
                let old = self.random.chance(0.05);
                let stream = if old { self.random.below(streams) } else { streams - 1 };
                self.send(agent, stream, life.age());
            }
        }
    }

    /// Starts a run, or makes that possible.
    fn revive(&mut self, life: &mut Life) {
        let (team, phase) = (self.random.below(TEAMS.len()), self.random.below(PHASES.len()));
        match self.forecast(life, team, phase) {
            None => self.start(life, team, phase, None),
            Some(Reason::PhaseClosed | Reason::PhasePaused) => self.reschedule(life, phase, 5),
            Some(Reason::QuotaConcurrent) => self.cancel_outside(life),
            Some(_) => self.grant(life, team, phase, 6),
        }
    }

    /// Returns an agent whose run goes on, and sometimes any.
    fn draw_agent(&mut self) -> Option<usize> {
        if !self.agents.is_empty() && self.random.chance(0.004) {
            return Some(self.random.below(self.agents.len()));
        }
        let all = (0..self.agents.len()).rev();
        let playing: Vec<_> = all.filter(|&agent| !self.agents[agent].is_done).take(PLAYERS).collect();
        let busy: Vec<_> =
            playing.iter().filter(|&&agent| self.agents[agent].has_episode()).copied().collect();
        let prefers_busy = !busy.is_empty() && self.random.chance(0.96);
        let drawn = if prefers_busy { busy } else { playing };
        (!drawn.is_empty()).then(|| *pick(&mut self.random, &drawn))
    }

    fn hello(&mut self, agent: usize) -> v1::Hello {
        let resume = self.random.chance(0.7);
        let run = &self.runs[self.agents[agent].run];
        let knows = resume && self.random.chance(0.9);
        v1::Hello {
            slots: 1 + self.random.below(SLOTS as usize + 1) as u32,
            sensors: Some(sensors()),
            resume,
            known: if knows { Agent::known(run) } else { vec![] },
            ..v1::Hello::default()
        }
    }

    /// Counts another attachment to an agent's run.
    fn attach(&mut self, agent: usize) -> u32 {
        let run = &mut self.runs[self.agents[agent].run];
        run.attachments += 1;
        run.attachments
    }

    async fn connect(&mut self, agent: usize, life: &Life) {
        let hello = self.hello(agent);
        let first = (!self.random.chance(0.02)).then_some(hello);
        let what = first.as_ref().map(|hello| (hello.resume, hello.slots));
        self.trace.add(life.age(), format_args!("agent {agent} connects: {what:?}"));
        match Connection::open(life, &self.agents[agent].token, first).await {
            Some(Ok(mut connection)) => {
                connection.attachment = self.attach(agent);
                self.agents[agent].streams.push(connection);
            }
            Some(Err(status)) => self.refused = Some(status),
            None => {}
        }
    }

    fn reset(&mut self, agent: usize, life: &Life) {
        if std::mem::replace(&mut self.agents[agent].is_calling, true) {
            return;
        }
        let hello = Some(v1::Hello { known: vec![], ..self.hello(agent) });
        self.trace.add(life.age(), format_args!("agent {agent} resets"));
        if self.agents[agent].unary.is_none() || !self.agents[agent].streams.is_empty() {
            self.agents[agent].attachment = self.attach(agent);
        }
        let request = v1::ResetRequest { hello, ready: None };
        let request = authorised(request, &self.agents[agent].token);
        let mut play = life.play();
        let call = async move { play.reset(request).await };
        self.calls.begin(Subject::Reset(agent), life.age(), call, Answer::Reset);
    }

    /// Makes a unary call.
    fn call(&mut self, agent: usize, life: &Life) {
        let Some((episode, step)) = self.agents[agent].unary.clone() else { return };
        if std::mem::replace(&mut self.agents[agent].is_calling, true) {
            return;
        }
        let (mut play, age) = (life.play(), life.age());
        let token = self.agents[agent].token.clone();
        if self.random.chance(0.03) {
            let abandon = v1::Abandon { slot: 0, episode, step };
            let goodbye = v1::Goodbye { pause: false };
            let last = if self.random.chance(0.7) { Last::Abandon(abandon) } else { Last::Goodbye(goodbye) };
            self.trace.add(age, format_args!("agent {agent} ends: {last:?}"));
            let request = authorised(v1::EndRequest { frame: Some(last) }, &token);
            let call = async move { play.end(request).await };
            return self.calls.begin(Subject::End(agent), age, call, Answer::End);
        }
        let act = self.act(agent, 0, episode, step);
        self.trace.add(age, format_args!("agent {agent} steps: {act:?}"));
        let request = authorised(v1::StepRequest { act: Some(act) }, &token);
        let call = async move { play.step(request).await };
        self.calls.begin(Subject::Step(agent), age, call, Answer::Step);
    }

    /// Returns an action, mostly the next one.
    fn act(&mut self, agent: usize, slot: u32, episode: String, seen: u32) -> v1::Act {
        let step = match self.random.below(40) {
            0 => seen,
            1 => seen + 2,
            2 => seen.saturating_sub(1),
            _ => seen + 1,
        };
        let is_foreign = self.random.chance(0.01);
        let episode = if is_foreign { "ep_0".to_owned() } else { episode };
        let action = match self.random.below(600) {
            0..2 => 5,
            2..6 => 4,
            6 => 9,
            other => 1 + (other % 3) as i32,
        };
        if !is_foreign {
            let facts = self.runs[self.agents[agent].run].episode(&episode);
            facts.sent = facts.sent.max(step);
        }
        v1::Act { slot, episode, step, action }
    }

    /// Sends a frame, or closes the stream in some way.
    fn send(&mut self, agent: usize, stream: usize, age: Duration) {
        let playing: Vec<_> = self.agents[agent].streams[stream].playing.clone().into_iter().collect();
        let slots = self.agents[agent].streams[stream].slots.max(1);
        let slot = self.random.below(slots as usize + 1) as u32;
        let held = if playing.is_empty() { None } else { Some(pick(&mut self.random, &playing).clone()) };
        let frame = match (self.random.below(4000), held) {
            (0..7, _) => return self.lose(agent, stream, age),
            (7..11, _) => return self.deafen(agent, stream, age),
            (11..14, _) => {
                self.trace.add(age, format_args!("agent {agent}.{stream} closes its half"));
                return self.agents[agent].streams[stream].close_half();
            }
            (14..22, _) => Up::Goodbye(v1::Goodbye { pause: self.random.chance(0.5) }),
            (22..24, _) => Up::Hello(self.hello(agent)),
            (24..50, _) => Up::Pong(v1::Pong { nonce: 1 + self.random.below(4) as u64 }),
            (50..90, _) | (_, None) => Up::Ready(v1::Ready { slot: slot.min(slots) }),
            (90..97, Some((slot, (episode, step)))) => Up::Abandon(v1::Abandon { slot, episode, step }),
            (97..160, Some((slot, (episode, step)))) => {
                // An action before the observation of the last one.
                let first = self.act(agent, slot, episode.clone(), step);
                self.trace.add(age, format_args!("agent {agent}.{stream} > {first:?}"));
                self.agents[agent].streams[stream].send(Up::Act(first), age);
                Up::Act(self.act(agent, slot, episode, step + 1))
            }
            (_, Some((slot, (episode, step)))) => Up::Act(self.act(agent, slot, episode, step)),
        };
        self.trace.add(age, format_args!("agent {agent}.{stream} > {frame:?}"));
        self.agents[agent].streams[stream].send(frame, age);
    }

    fn lose(&mut self, agent: usize, stream: usize, age: Duration) {
        self.trace.add(age, format_args!("agent {agent}.{stream} loses the connection"));
        self.agents[agent].streams.remove(stream);
    }

    fn deafen(&mut self, agent: usize, stream: usize, age: Duration) {
        let deaf = Duration::from_secs(*pick(&mut self.random, &[2, 20, 40]));
        self.trace.add(age, format_args!("agent {agent}.{stream} does not read for {deaf:?}"));
        let stream = &mut self.agents[agent].streams[stream];
        (stream.deaf_until, stream.is_prompt) = (age + deaf, false);
    }
}
