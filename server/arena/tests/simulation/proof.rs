//! Proof at the end of a world that nothing is stuck or lost.

use crate::{
    agent::{Connection, sensors},
    database::Database,
    model::RunFacts,
    server::{AT_ONCE, Life, authorised},
    setting::{PHASES, TEAMS},
    world::{Ending, World},
};
use avln_arena::{
    actions::{Attribution, reschedule},
    runlog::{Entry, RunLogs},
};
use avln_proto::v1::{self, play_request::Frame as Up};
use avln_store::{AuditNote, NewGrant};
use std::{collections::BTreeMap, time::Duration};
use tokio::{runtime::Runtime, time::timeout};

type Checked = Result<(), String>;

impl World {
    /// Lets all agents leave, and proves that the server is free of them. Then restarts it once, and proves it again.
    pub(crate) async fn prove(&mut self, life: &mut Life) -> Result<Ending, String> {
        life.faults().clear();
        self.heal(life);
        self.agents.iter_mut().for_each(|agent| agent.streams.clear());
        self.watches.clear();
        if self.times.drained.is_some() {
            return Ok(Ending::Stop);
        }
        if !self.is_proved {
            self.wait_for_leases(life).await?;
        }
        self.check_freedom(life)?;
        self.check(life).await?;
        for (team, name) in TEAMS.iter().enumerate() {
            self.play_a_run(team, life).await.map_err(|stuck| format!("team {name}: {stuck}"))?;
        }
        self.check(life).await?;
        let is_proved = std::mem::replace(&mut self.is_proved, true);
        Ok(if is_proved { Ending::Finished } else { Ending::Stop })
    }

    /// Waits longer than any session may.
    async fn wait_for_leases(&mut self, life: &Life) -> Checked {
        let disconnect_s = self.setting.phases.iter().map(|phase| phase.time.disconnect_s).max();
        let limits = &self.estate.limits;
        let away = Duration::from_secs(u64::from(disconnect_s.unwrap_or_default())).max(limits.unary_idle);
        let longest = away + 2 * limits.handover + limits.reader_stall + 2 * limits.overdue_interval;
        self.trace.add(life.age(), format_args!("all leave"));
        let end = life.age() + longest;
        while life.age() < end {
            tokio::time::sleep(Duration::from_secs(5)).await;
            self.settle(life).await?;
        }
        Ok(())
    }

    /// Checks that no call, slot, session or running episode is left.
    fn check_freedom(&mut self, life: &mut Life) -> Checked {
        let border = life.border().clone();
        let episodes = border.cross(life.database.episodes(None));
        let running = episodes.iter().find(|episode| episode.state == "running");
        let session = self.runs.iter().find(|run| life.control().session(&run.id).is_some());
        let slots = life.control().snapshot().slots;
        if self.calls.count() == 0 && running.is_none() && session.is_none() && slots.is_empty() {
            return Ok(());
        }
        let session = session.map(|run| &run.id);
        Err(format!("stuck: {} calls, {running:?}, session {session:?}, {slots:?}", self.calls.count()))
    }

    /// Ends a team's runs, and plays another.
    async fn play_a_run(&mut self, team: usize, life: &mut Life) -> Checked {
        self.end_runs(team, life).await?;
        let before = self.agents.len();
        self.send_start(life, team, 0, format!("proof {}", self.times.lives));
        self.settle(life).await?;
        let agent = self.agents.len() - 1;
        if agent < before {
            return Err("no run starts".to_owned());
        }
        self.watch_run(self.agents[agent].run, life).await?;
        let hello = v1::Hello { slots: 1, sensors: Some(sensors()), ..v1::Hello::default() };
        let opened = Connection::open(life, &self.agents[agent].token, Some(hello)).await;
        let Some(Ok(stream)) = opened else { return Err("no stream opens".to_owned()) };
        self.agents[agent].streams.push(stream);
        self.exchange(agent, Up::Ready(v1::Ready { slot: 0 }), life).await?;
        let Some((episode, 0)) = self.agents[agent].streams.first().and_then(|s| s.playing.get(&0).cloned())
        else {
            return Err("no episode starts".to_owned());
        };
        self.runs[self.agents[agent].run].episode(&episode).sent = 1;
        let stop = v1::Act { slot: 0, episode: episode.clone(), step: 1, action: v1::Action::Stop.into() };
        self.exchange(agent, Up::Act(stop), life).await?;
        if !self.runs[self.agents[agent].run].episode(&episode).has_result() {
            return Err("no episode ends".to_owned());
        }
        self.exchange(agent, Up::Goodbye(v1::Goodbye { pause: false }), life).await?;
        if self.agents[agent].is_done { Ok(()) } else { Err("no run ends".to_owned()) }
    }

    /// Watches a run: no place is occupied by calls that have ended.
    async fn watch_run(&mut self, run: usize, life: &Life) -> Checked {
        let RunFacts { id, team, .. } = &self.runs[run];
        let request = authorised(v1::WatchRunRequest { run: id.clone() }, &self.estate.place.tokens[*team]);
        let mut runs = life.runs();
        let watch =
            timeout(AT_ONCE, runs.watch_run(request)).await.map_err(|_| "no watch opens".to_owned())?;
        self.watches.push(watch.map_err(|status| format!("no watch opens: {status:?}"))?.into_inner());
        Ok(())
    }

    async fn exchange(&mut self, agent: usize, frame: Up, life: &Life) -> Checked {
        let age = life.age();
        let Some(stream) = self.agents[agent].streams.first_mut() else {
            return Err(format!("the stream has ended before {frame:?}"));
        };
        stream.send(frame, age);
        self.settle(life).await
    }

    /// Cancels the team's open runs, opens the phase and grants another run.
    async fn end_runs(&mut self, team: usize, life: &mut Life) -> Checked {
        let (border, now_unix_ms) = (life.border().clone(), self.estate.clock.now_unix_ms());
        let rows = border.cross(life.database.rows(None));
        let open = rows.runs.iter().filter(|run| run.team == TEAMS[team] && run.is_open());
        for run in open {
            border.cross(life.store.cancel_run(&run.id, now_unix_ms)).map_err(|error| error.to_string())?;
            life.control().leave(&run.id);
        }
        let by = Attribution { actor: "organiser", reason: "" };
        let opened = reschedule(&life.store, PHASES[0], by, |schedule| *schedule = Default::default());
        border.cross(opened).map_err(|error| error.to_string())?;
        // As many as all windows may count beyond their limits.
        let grant =
            NewGrant { phase: PHASES[0], team: TEAMS[team], runs: rows.runs.len() as u32 + 1, reason: "" };
        let granted = life.store.grant(&grant, AuditNote::default(), now_unix_ms);
        border.cross(granted).map_err(|error| error.to_string())?;
        self.settle(life).await
    }

    /// Checks the data folder without a server: rows and run logs agree.
    pub(crate) fn check_rest(&self, threads: &Runtime) -> Checked {
        let rows = threads.block_on(async {
            let mut database = Database::open(&self.estate.place.database()).await;
            let rows = database.rows(None).await;
            database.close().await;
            rows
        });
        self.check_rows(&rows)?;
        let logs = self.estate.place.data().run_logs();
        let scored = rows.episodes.iter().filter(|episode| episode.is_scored());
        let mut by_run: BTreeMap<&str, BTreeMap<String, u32>> = BTreeMap::new();
        for episode in scored {
            let (handle, steps) =
                (episode.handle.clone().unwrap_or_default(), episode.steps.unwrap_or_default());
            by_run.entry(&episode.run).or_default().insert(handle, steps);
        }
        by_run.iter().try_for_each(|(run, scored)| check_log(&logs, run, scored))
    }
}

/// Checks that the log of a run contains every scored episode, with its steps and a single end.
fn check_log(logs: &RunLogs, run: &str, scored: &BTreeMap<String, u32>) -> Checked {
    let history = logs.history(run).map_err(|error| error.to_string())?;
    let Some(history) = history else { return Err(format!("{run} has no log")) };
    let episodes =
        history.episodes().map_err(|(line, wrong)| format!("log of {run}, line {line}: {wrong}"))?;
    history.check_epochs().map_err(|(line, wrong)| format!("log of {run}, line {line}: {wrong}"))?;
    for (handle, steps) in scored {
        let is_end = |entry: &&Entry| matches!(entry, Entry::Ended { handle: ended, .. } if ended == handle);
        let ends = history.entries.iter().filter(is_end).count();
        let logged = episodes.get(handle).map(|episode| episode.actions.len() as u32);
        if (ends, logged) != (1, Some(*steps)) {
            return Err(format!(
                "log of {run}: {handle} has {steps} steps, but {logged:?} and {ends} ends in the log"
            ));
        }
    }
    Ok(())
}
