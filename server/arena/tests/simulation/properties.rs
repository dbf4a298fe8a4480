//! Properties of all rows: no episode is scored twice or lost, quotas equal the ledger, and runs end in time.

use crate::{
    database::{EpisodeRow, Rows, RunRow},
    ledger::Ledger,
    model::RunFacts,
    server::{AT_ONCE, Life, authorised},
    setting::{EPISODES, PHASES, TEAMS},
    world::World,
};
use avln_proto::v1::{self, EndReason};
use std::time::Duration;
use tokio::time::timeout;

/// Attempts at an episode that the server may lose.
const ATTEMPTS: u32 = 3;
/// Deviation of deadlines: the search for expired runs, and times below a second.
const SLACK: Duration = Duration::from_secs(3);

type Checked = Result<(), String>;

fn check(holds: bool, violation: impl FnOnce() -> String) -> Checked {
    if holds { Ok(()) } else { Err(violation()) }
}

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
