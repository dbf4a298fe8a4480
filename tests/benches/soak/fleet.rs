//! The agent processes: started, killed and replaced.

use crate::tally::{RunAccess, Tally};
use std::{
    io::{BufRead, BufReader},
    net::SocketAddr,
    process::{Child, ChildStdout, Command, ExitStatus, Stdio},
    sync::Arc,
    thread::{JoinHandle, sleep, spawn},
    time::{Duration, Instant},
};

pub(crate) const PROCESSES: usize = 8;
/// Time for the last steps and the cancellation of runs.
const LAST_STEPS: Duration = Duration::from_secs(60);

/// All agent processes.
#[derive(Debug)]
pub(crate) struct Fleet {
    launcher: Launcher,
    members: Vec<Member>,
}

#[derive(Debug)]
struct Launcher {
    url: String,
    /// Token of each process's team.
    tokens: Vec<String>,
    pause_ms: u64,
    until: Instant,
    tally: Arc<Tally>,
}

#[derive(Debug)]
struct Member {
    process: Child,
    reader: JoinHandle<()>,
}

impl Fleet {
    pub(crate) fn start(
        grpc: SocketAddr,
        tokens: Vec<String>,
        pause_ms: u64,
        until: Instant,
        tally: Arc<Tally>,
    ) -> Self {
        let launcher = Launcher { url: format!("http://{grpc}"), tokens, pause_ms, until, tally };
        let members = (0..PROCESSES).map(|number| launcher.launch(number, None)).collect();
        Self { launcher, members }
    }

    /// Kills a process in turn. Alternately its successor resumes the run or starts another.
    pub(crate) fn replace(&mut self, minute: u64) {
        let (turn, round) = (minute as usize % PROCESSES, minute as usize / PROCESSES);
        self.members[turn].kill();
        self.launcher.tally.agent_kills.add(1);
        let run = self.launcher.tally.current(turn);
        // The round shifts the alternation, so that every process does both.
        let run = run.filter(|_| (turn + round).is_multiple_of(2));
        self.members[turn] = self.launcher.launch(turn, run);
    }

    /// Starts processes that ended by themselves once more, and records an error for each.
    pub(crate) fn revive(&mut self) {
        for (number, member) in self.members.iter_mut().enumerate() {
            let ended = member.process.try_wait().expect("a state");
            if let Some(status) = ended.filter(|_| Instant::now() < self.launcher.until) {
                self.launcher.tally.finding(&format!("agent {number} ended early: {status}"));
                *member = self.launcher.launch(number, None);
            }
        }
    }

    /// Waits for the ends of all processes.
    pub(crate) fn finish(&mut self) {
        let until = Instant::now() + LAST_STEPS;
        for (number, member) in self.members.drain(..).enumerate() {
            match member.end(until) {
                Some(status) if status.success() => {}
                Some(status) => self.launcher.tally.finding(&format!("agent {number} failed: {status}")),
                None => self.launcher.tally.finding(&format!("agent {number} did not end")),
            }
        }
    }
}

impl Launcher {
    fn launch(&self, number: usize, run: Option<RunAccess>) -> Member {
        let left_s = self.until.saturating_duration_since(Instant::now()).as_secs();
        let mut play = Command::new(std::env::current_exe().expect("this program"));
        play.args(["agent", &self.url, &self.tokens[number]]);
        play.args([self.pause_ms, left_s].map(|number| number.to_string())).args(run.iter().flatten());
        let mut process = play.stdout(Stdio::piped()).spawn().expect("an agent starts");
        let output = process.stdout.take().expect("its output");
        let tally = self.tally.clone();
        Member { process, reader: spawn(move || read(output, number, &tally)) }
    }
}

impl Member {
    /// Kills the process and waits until its output is read.
    fn kill(&mut self) {
        self.process.kill().expect("it runs");
        self.process.wait().expect("it is gone");
        while !self.reader.is_finished() {
            sleep(Duration::from_millis(1));
        }
    }

    /// Returns the exit status; `None` if the process had to be killed.
    fn end(mut self, until: Instant) -> Option<ExitStatus> {
        let mut status = None;
        while status.is_none() && Instant::now() < until {
            status = self.process.try_wait().expect("a state");
            sleep(Duration::from_millis(100));
        }
        self.kill_if_running(status);
        self.reader.join().expect("the reader ends");
        status
    }

    fn kill_if_running(&mut self, status: Option<ExitStatus>) {
        if status.is_none() {
            let _ = self.process.kill();
            let _ = self.process.wait();
        }
    }
}

fn read(output: ChildStdout, number: usize, tally: &Tally) {
    for line in BufReader::new(output).lines().map_while(Result::ok) {
        tally.note(number, &line);
    }
}
