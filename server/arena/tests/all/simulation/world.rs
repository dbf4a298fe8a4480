//! A simulated world: servers in succession on one data folder, the agents, the organiser, everything known about their runs, and
//! a trace of all events.

use super::{
    agent::{Agent, RunFacts},
    database::Rows,
    ledger::Ledger,
    server::{Calls, Estate, Life, Remains},
    setting::{PHASES, Place, START_UNIX_MS, Setting, TEAMS, pick},
};
use avln_arena::{
    actions::{Attribution, reschedule},
    clock::Clock,
};
use avln_geom::Rng;
use avln_proto::v1::{self, Reason};
use avln_store::{AuditNote, NewGrant, Schedule};
use std::{
    collections::VecDeque,
    fmt::{self, Display, Write},
    sync::Arc,
    time::Duration,
};
use tokio::runtime::{Builder, Runtime};
use tonic::{Status, Streaming};

/// Steps between checks of all rows.
const CHECK_EVERY: u64 = 500;
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
        let unrest = *pick(&mut random, &[0.0, 1.0, 1.0, 2.0]);
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
        let downtime_s = *pick(&mut self.random, &[0, 2, 30, 200]);
        self.times.age += Duration::from_secs(downtime_s);
        self.times.gained += Duration::from_secs(12) + self.estate.limits.overdue_interval;
        self.times.lives += 1;
        let recently = self.times.age.saturating_sub(self.estate.limits.overdue_interval * 2);
        if self.random.chance(0.1) {
            self.set_clock(self.times.age);
        }
        self.times.is_generous |= self.times.set_back.is_some_and(|set_back| set_back >= recently);
        self.estate.clock.set_age(self.times.age);
    }

    /// Sets the wall clock forwards or back.
    pub(crate) fn set_clock(&mut self, age: Duration) {
        const MINUTE_MS: i64 = 60_000;
        let by_min = *pick(&mut self.random, &[1_i64, 61, 600, 1440, 3 * 1440]);
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
        self.trace.add(life.age(), format_args!("the server ends: {ending:?}"));
        let ending = match ending {
            Ok(Ending::Stop) => life.stop().await.map(|()| Ending::Stop),
            other => other,
        };
        let age = life.age();
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

/// Events shown after a failure.
const SHOWN: usize = 50;
/// Environment variable that prints all events.
const PRINT: &str = "AVLN_SIMULATION_TRACE";

/// The events of a simulation.
pub(crate) struct Trace {
    hasher: blake3::Hasher,
    last: VecDeque<String>,
    prints: bool,
}

impl Default for Trace {
    fn default() -> Self {
        let prints = std::env::var_os(PRINT).is_some();
        Self { hasher: blake3::Hasher::new(), last: VecDeque::new(), prints }
    }
}

impl Trace {
    pub(crate) fn add(&mut self, age: Duration, event: impl Display) {
        let mut line =
            if self.last.len() < SHOWN { String::new() } else { self.last.pop_front().unwrap_or_default() };
        line.clear();
        let _ = write!(line, "{:>10.3} s  {event}", age.as_secs_f64());
        self.hasher.update(line.as_bytes()).update(b"\n");
        if self.prints {
            println!("{line}");
        }
        self.last.push_back(line);
    }

    pub(crate) fn digest(&self) -> String {
        self.hasher.finalize().to_hex()[..16].to_owned()
    }
}

impl Display for Trace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.last.iter().try_for_each(|line| writeln!(f, "{line}"))
    }
}
