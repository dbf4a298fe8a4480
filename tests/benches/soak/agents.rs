//! An agent process: run after run in eight slots. The standard output reports runs, steps, ends and errors.

use crate::{resume, tally::RunAccess};
use avln_client::{Action, Client, EndReason, Episode, Error, Order, Play, RunOptions, Sensors};
use avln_tests::PHASE;
use std::{
    sync::Arc,
    sync::atomic::{AtomicU64, Ordering},
    time::Duration,
};
use tokio::{
    task::JoinSet,
    time::{Instant, sleep, timeout_at},
};

pub(crate) const SLOTS: u32 = 8;
pub(crate) const SENSORS: Sensors =
    Sensors { rgb: true, depth: true, audio: true, width: 64, height: 64, hfov_rad: 1.57 };
const REPORT_INTERVAL: Duration = Duration::from_secs(1);
const PAUSE_AFTER_ERROR: Duration = Duration::from_secs(1);

/// Settings and state of an agent process.
#[derive(Debug)]
pub(crate) struct Agent {
    pub(crate) url: String,
    token: String,
    /// Thinking time per step.
    pub(crate) pause: Duration,
    until: Instant,
    steps: AtomicU64,
    /// The run of the predecessor.
    resumed: Option<RunAccess>,
}

impl Agent {
    /// Returns the agent of the arguments; `None` for other arguments.
    pub(crate) fn parse(words: &[String]) -> Option<Self> {
        let [word, url, token, pause_ms, seconds, run @ ..] = words else { return None };
        if word != "agent" {
            return None;
        }
        let length = Duration::from_secs(seconds.parse().ok()?);
        Some(Self {
            url: url.clone(),
            token: token.clone(),
            pause: Duration::from_millis(pause_ms.parse().ok()?),
            until: Instant::now() + length,
            steps: AtomicU64::new(0),
            resumed: run.to_vec().try_into().ok(),
        })
    }

    pub(crate) fn is_over(&self) -> bool {
        Instant::now() >= self.until
    }

    pub(crate) fn count_step(&self) {
        self.steps.fetch_add(1, Ordering::Relaxed);
    }

    fn report_steps(&self) {
        println!("steps {}", self.steps.swap(0, Ordering::Relaxed));
    }
}

/// Chooses the same action for the same step of an episode, in every process.
pub(crate) fn action(episode: &str, step: u32) -> Action {
    let last = 100 + episode.bytes().map(u32::from).sum::<u32>() % 200;
    match step.wrapping_mul(0x9e37_79b9) >> 28 {
        _ if step >= last => Action::Stop,
        0..4 => Action::TurnLeft,
        _ if step % 64 == 63 => Action::Submit,
        _ => Action::MoveForward,
    }
}

/// Reports an error on a single line.
pub(crate) fn report_error(error: &str) {
    println!("error {}", error.replace('\n', " "));
}

/// Reports the end of an episode, which counts unless the server failed.
pub(crate) fn report_end(episode: &str, steps: u32, is_fault: bool) {
    match is_fault {
        true => report_error(&format!("the server lost episode {episode} at step {steps}")),
        false => println!("end {episode} {steps}"),
    }
}

/// Plays until the time is over.
pub(crate) async fn play(mut agent: Agent) {
    let resumed = agent.resumed.take();
    let agent = Arc::new(agent);
    let reporter = agent.clone();
    tokio::spawn(async move {
        loop {
            sleep(REPORT_INTERVAL).await;
            reporter.report_steps();
        }
    });
    let Some(client) = connect(&agent).await else { return };
    if let Some(run) = resumed
        && timeout_at(agent.until, resume::play_on(&agent, &run)).await.is_err()
    {
        cancel(&client, &run[0]).await;
    }
    while !agent.is_over() {
        if let Err(error) = play_run(&agent, &client).await {
            report_error(&error.to_string());
            sleep(PAUSE_AFTER_ERROR).await;
        }
    }
    agent.report_steps();
}

async fn connect(agent: &Agent) -> Option<Client> {
    while !agent.is_over() {
        match Client::connect(&agent.url, &agent.token).await {
            Ok(client) => return Some(client),
            Err(error) => report_error(&error.to_string()),
        }
        sleep(PAUSE_AFTER_ERROR).await;
    }
    None
}

async fn play_run(agent: &Arc<Agent>, client: &Client) -> Result<(), Error> {
    let options = RunOptions::new(PHASE, "soak").order(Order::Unordered);
    let run = client.start_run(options).await?;
    println!("run {} {}", run.id, run.token);
    let mut players = JoinSet::new();
    for play in client.play_slots(&run, SENSORS, SLOTS).await? {
        players.spawn(play_slot(play, agent.clone()));
    }
    // All slots are awaited before the first is dropped, because the stream ends with the last.
    let Ok(plays) = timeout_at(agent.until, players.join_all()).await else {
        cancel(client, &run.id).await;
        return Ok(());
    };
    let plays: Result<Vec<_>, Error> = plays.into_iter().collect();
    if let Some(play) = plays?.pop()
        && play.finish().await?.complete
    {
        println!("complete {}", run.id);
    }
    Ok(())
}

async fn cancel(client: &Client, run: &str) {
    if let Err(error) = client.cancel_run(run).await {
        report_error(&error.to_string());
    }
}

/// Plays a slot to the end of the run; returns it.
async fn play_slot(mut play: Play, agent: Arc<Agent>) -> Result<Play, Error> {
    while let Some(mut episode) = play.next_episode().await? {
        while !episode.is_over() {
            sleep(agent.pause).await;
            let action = action(episode.id(), episode.observation().step);
            episode.step(action).await?;
            agent.count_step();
        }
        report_episode(&episode);
    }
    Ok(play)
}

fn report_episode(episode: &Episode<'_>) {
    if let Some(end) = episode.end() {
        report_end(&end.episode, end.steps, end.reason == EndReason::ServerFault);
    }
}
