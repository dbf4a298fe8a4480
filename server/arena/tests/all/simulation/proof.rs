//! Properties of all rows: no episode is scored twice or lost, quotas equal the ledger, and runs end in time. Proof at the end of a
//! world that nothing is stuck or lost.

use super::{
    agent::{Checked, Connection, RunFacts, check, sensors},
    database::{Database, EpisodeRow, Rows, RunRow},
    ledger::Ledger,
    server::{AT_ONCE, Life, authorised},
    setting::{EPISODES, PHASES, TEAMS},
    world::{Ending, World},
};
use avln_arena::{
    actions::{Attribution, reschedule},
    runlog::{Entry, RunLogs},
};
use avln_proto::v1::{self, EndReason, play_request::Frame as Up};
use avln_store::{AuditNote, NewGrant};
use std::{collections::BTreeMap, time::Duration};
use tokio::{runtime::Runtime, time::timeout};

/// Attempts at an episode that the server may lose.
const ATTEMPTS: u32 = 3;
/// Deviation of deadlines: the search for expired runs, and times below a second.
const SLACK: Duration = Duration::from_secs(3);

impl World {
    /// Checks all properties that hold at any time.
    pub(crate) async fn check(&mut self, life: &mut Life) -> Checked {
        let border = life.border().clone();
        let rows = border.cross(life.database.rows(None));
        self.check_rows(&rows)?;
        self.check_deadlines(&rows, life)?;
        self.check_sessions(&rows, life)?;
        for team in 0..TEAMS.len() {
            for phase in 0..PHASES.len() {
                self.check_quota(team, phase, &rows, life).await?;
            }
        }
        Ok(())
    }

    /// Checks all properties that do not need a server.
    pub(crate) fn check_rows(&self, rows: &Rows) -> Checked {
        rows.episodes.iter().try_for_each(check_episode)?;
        rows.runs.iter().try_for_each(|run| check_run(run, rows.episodes_of(&run.id)))?;
        self.check_issued(rows)?;
        for facts in &self.runs {
            let run = rows.runs.iter().find(|run| run.id == facts.id);
            let Some(run) = run else { return Err(format!("{} is lost", facts.id)) };
            check_knowledge(facts, run, rows.episodes_of(&run.id))?;
        }
        Ok(())
    }

    /// Checks that a run scored only episodes that it was given.
    fn check_issued(&self, rows: &Rows) -> Checked {
        let issued = self.estate.issued.lock().expect("no panic");
        for episode in rows.episodes.iter().filter(|episode| episode.is_scored()) {
            let handle = episode.handle.as_deref().unwrap_or_default();
            check(issued.get(handle) == Some(&episode.run), || format!("{episode:?} was never played"))?;
        }
        Ok(())
    }

    /// Checks that runs have their wall time, and not more.
    fn check_deadlines(&self, rows: &Rows, life: &Life) -> Checked {
        let uptime = self.uptime(life);
        let drained = self.times.drained.map_or(Duration::ZERO, |since| life.age() - since);
        for facts in self.runs.iter().filter(|facts| facts.phase == 0) {
            let wall = Duration::from_secs(u64::from(self.setting.phases[0].time.run_s));
            let Some(run) = rows.runs.iter().find(|run| run.id == facts.id) else { continue };
            let passed = uptime - facts.started;
            let lost = SLACK + Duration::from_secs(u64::from(self.times.lives));
            let is_early = run.state == "expired" && passed + lost < wall;
            check(!is_early, || format!("{run:?} expired after {passed:?} of {wall:?}"))?;
            let most = wall + self.times.gained + drained + self.estate.limits.overdue_interval + SLACK;
            let is_late = run.is_open() && passed > most && !self.times.is_generous && self.failed.is_none();
            check(!is_late, || format!("{run:?} is open after {passed:?}, more than {most:?}"))?;
        }
        Ok(())
    }

    /// Checks that every running episode has a session, which plays it or waits for the agent.
    fn check_sessions(&self, rows: &Rows, life: &Life) -> Checked {
        let age = life.age();
        // The next search for expired runs returns episodes that the database could not return.
        let pause = 2 * self.estate.limits.overdue_interval;
        if self.failed.is_some_and(|failed| age < failed + pause) || age < life.began + pause {
            return Ok(());
        }
        let mut running = rows.episodes.iter().filter(|episode| episode.state == "running");
        let orphan = running.find(|episode| life.control().session(&episode.run).is_none());
        orphan.map_or(Ok(()), |orphan| Err(format!("no session plays {orphan:?}")))
    }

    /// Compares the quotas that the server reports with the ledger.
    async fn check_quota(&self, team: usize, phase: usize, rows: &Rows, life: &Life) -> Checked {
        let request = v1::GetQuotaRequest { phase: PHASES[phase].to_owned() };
        let request = authorised(request, &self.estate.place.tokens[team]);
        let Ok(answer) = timeout(AT_ONCE, life.runs().get_quota(request)).await else { return Ok(()) };
        let quotas = answer.map_err(|status| format!("no quota: {status:?}"))?.into_inner().quotas;
        let now_unix_ms = self.estate.clock.now_unix_ms();
        Ledger::new(TEAMS[team], &self.setting.phases[phase], rows, now_unix_ms).check(&quotas)
    }
}

fn check_episode(episode: &EpisodeRow) -> Checked {
    let (is_scored, is_lost) = (episode.is_scored(), episode.state == "infra");
    let is_whole = is_scored == episode.steps.is_some()
        && (is_scored || is_lost) == episode.end_reason.is_some()
        && (!is_scored || episode.has_record)
        && (!episode.has_record || is_scored || is_lost);
    check(is_whole, || format!("an incomplete result: {episode:?}"))?;
    let attempts = episode.interruptions + u32::from(is_scored || episode.state == "running");
    let is_counted = episode.attempts == attempts && is_lost == (episode.interruptions == ATTEMPTS);
    check(is_counted, || format!("a wrong number of attempts: {episode:?}"))
}

fn check_run(run: &RunRow, episodes: &[EpisodeRow]) -> Checked {
    let count =
        |holds: fn(&EpisodeRow) -> bool| episodes.iter().filter(|episode| holds(episode)).count() as u32;
    let scored = count(EpisodeRow::is_scored);
    let lost = count(|episode| episode.state == "infra");
    let faults: u32 = episodes.iter().map(|episode| episode.interruptions).sum();
    let is_counted = (run.scored, run.given_up, run.server_faults) == (scored, lost, faults)
        && run.episodes == EPISODES
        && episodes.len() as u32 == EPISODES;
    check(is_counted, || format!("wrong sums: {run:?} {episodes:?}"))?;
    let is_over = scored + lost == EPISODES;
    let has_state = match run.state.as_str() {
        "created" => episodes.iter().all(|episode| episode.state == "pending"),
        "running" => !is_over,
        "completed" => is_over,
        _ => true,
    };
    check(has_state, || format!("a wrong state: {run:?} {episodes:?}"))?;
    check(run.is_open() == run.finished_ms.is_none(), || format!("a wrong end: {run:?}"))
}

/// Compares what an agent knows with the rows of its run.
fn check_knowledge(facts: &RunFacts, run: &RunRow, episodes: &[EpisodeRow]) -> Checked {
    check(!facts.is_complete || run.state == "completed", || format!("not completed: {run:?}"))?;
    for (handle, known) in &facts.episodes {
        let Some(end) = &known.end else { continue };
        let row = episodes.iter().find(|row| row.handle.as_deref() == Some(handle));
        if end.reason() == EndReason::ServerFault {
            let is_lost = row.is_none_or(|row| !row.is_scored());
            check(is_lost, || format!("{row:?} was announced as lost: {end:?}"))?;
            continue;
        }
        let Some(row) = row else {
            return Err(format!("the result of {} {handle} is lost: {end:?}", facts.id));
        };
        let reason = row.end_reason.as_deref().unwrap_or_default().to_uppercase();
        let is_same =
            row.steps == Some(end.step) && end.reason().as_str_name() == format!("END_REASON_{reason}");
        check(is_same, || format!("{end:?} is stored as {row:?}"))?;
    }
    Ok(())
}

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
