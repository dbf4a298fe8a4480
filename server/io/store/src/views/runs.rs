//! Run lists, open runs and run comparison.

use crate::{
    database::{Transaction, Word},
    error::Result,
    phases::{PhaseHead, read_heads},
    runs::{Run, RunFilter, read_runs},
    scores::INTERVAL_SEED,
    views::{
        Reader, Viewer,
        run::{EpisodeLine, RunLine, RunView, Sight, find_run, read_line, read_lines},
    },
};
use avln_challenge::RunState;
use avln_scoring::{Comparison, EpisodeScore, Metrics, compare};
use serde::Serialize;
use std::collections::BTreeMap;

/// A page in the run list.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
pub struct RunList {
    /// Runs, newest first.
    pub runs: Vec<RunLine>,
    /// Next page's start: the last run's id; `None` on the last page.
    pub next: Option<String>,
}

/// An open run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LiveRun {
    /// The run.
    pub line: RunLine,
    /// Running episodes.
    pub playing: u32,
    /// True if the viewer sees single episodes' progress: lengths reveal targets.
    pub steps_visible: bool,
}

impl Reader {
    /// Returns the newest `limit` runs listed for the viewer, in one phase or all.
    pub async fn runs(&self, viewer: &Viewer, phase: Option<&str>, limit: u32) -> Result<Vec<RunLine>> {
        let list = self.older_runs(viewer, phase, None, limit).await?;
        Ok(list.map(|list| list.runs).unwrap_or_default())
    }

    /// Returns the newest `limit` visible runs older than the run called `before`; `None` if that run is hidden or unknown.
    /// Cancelled runs, such as those of checks, are listed only for their team and the organiser.
    pub async fn older_runs(
        &self,
        viewer: &Viewer,
        phase: Option<&str>,
        before: Option<&str>,
        limit: u32,
    ) -> Result<Option<RunList>> {
        let mut tx = self.snapshot().await?;
        if let Some(before) = before
            && find_run(&mut tx, viewer, before).await?.is_none()
        {
            return Ok(None);
        }
        let phases = read_heads(&mut tx, phase).await?;
        let select = "SELECT id, phase, team, state FROM runs WHERE ($1 IS NULL OR phase = $1) AND ($2 IS NULL OR EXISTS \
             (SELECT 1 FROM runs b WHERE b.id = $2 AND (runs.created_ms < b.created_ms \
              OR (runs.created_ms = b.created_ms AND runs.id > b.id)))) ORDER BY created_ms DESC, id";
        let runs: Vec<(String, String, String, Word<RunState>)> =
            sqlx::query_as(select).bind(phase).bind(before).fetch_all(&mut *tx).await?;
        // Visibility is decided here and not in SQL, so ids are filtered until the page is full.
        let mut visible = runs
            .into_iter()
            .filter(|(_, _, team, state)| state.0 != RunState::Cancelled || viewer.owns(team))
            .filter_map(|(run, phase, team, _)| Some((run, sight_in(&phases, viewer, &phase, &team)?)));
        let page: Vec<_> = visible.by_ref().take(limit as usize).collect();
        let last = page.last().map(|(run, _)| run.clone());
        let next = if visible.next().is_some() { last } else { None };
        Ok(Some(RunList { runs: read_lines(&mut tx, &page).await?, next }))
    }

    /// Returns the team's newest `limit` runs; empty for other viewers.
    pub async fn own_runs(&self, viewer: &Viewer, limit: u32) -> Result<Vec<RunLine>> {
        let Viewer::Team(team) = viewer else { return Ok(vec![]) };
        let mut tx = self.snapshot().await?;
        let phases = read_heads(&mut tx, None).await?;
        let runs = read_runs(&mut tx, &RunFilter { team: Some(team), ..RunFilter::default() }).await?;
        let sight = |run: Run| Some((run.id, sight_in(&phases, viewer, &run.phase, &run.team)?));
        let page: Vec<_> = runs.into_iter().take(limit as usize).filter_map(sight).collect();
        read_lines(&mut tx, &page).await
    }

    /// Returns a run's progress; `None` if there is none visible to the viewer.
    pub async fn live_run(&self, viewer: &Viewer, id: &str) -> Result<Option<LiveRun>> {
        let mut tx = self.snapshot().await?;
        match find_run(&mut tx, viewer, id).await? {
            Some((run, sight)) => read_progress(&mut tx, run, sight).await.map(Some),
            None => Ok(None),
        }
    }

    /// Returns the newest `limit` open runs visible to the viewer.
    pub async fn live_runs(&self, viewer: &Viewer, limit: u32) -> Result<Vec<LiveRun>> {
        let mut tx = self.snapshot().await?;
        let phases = read_heads(&mut tx, None).await?;
        let mut runs = Vec::new();
        for state in [RunState::Running, RunState::Created] {
            runs.extend(read_runs(&mut tx, &RunFilter { state: Some(state), ..RunFilter::default() }).await?);
        }
        runs.sort_by(|a, b| b.created_unix_ms.cmp(&a.created_unix_ms).then_with(|| a.id.cmp(&b.id)));
        let mut found = Vec::new();
        for run in runs {
            if let Some(sight) = sight_in(&phases, viewer, &run.phase, &run.team) {
                found.push(read_progress(&mut tx, run, sight).await?);
            }
            if found.len() >= limit as usize {
                break;
            }
        }
        Ok(found)
    }
}

fn sight_in(phases: &[PhaseHead], viewer: &Viewer, phase: &str, team: &str) -> Option<Sight> {
    let head = phases.iter().find(|head| head.phase.id == phase)?;
    Sight::of(viewer, team, &head.phase)
}

async fn read_progress(tx: &mut Transaction<'_>, run: Run, sight: Sight) -> Result<LiveRun> {
    let select = "SELECT COUNT(*) FROM episodes WHERE run = $1 AND state = 'running'";
    let playing: u32 = sqlx::query_scalar(select).bind(&run.id).fetch_one(&mut **tx).await?;
    Ok(LiveRun { playing, steps_visible: sight.replays, line: read_line(tx, &run.id, sight).await? })
}

/// Two runs with equal phase and order, over common episodes.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
pub struct CompareView {
    /// The first run.
    pub first: RunLine,
    /// The second run.
    pub second: RunLine,
    /// Paired differences; `None` without episodes scored in both runs.
    pub comparison: Option<Comparison>,
    /// Episodes scored in both runs, in the first run's playing order.
    pub episodes: Vec<PairView>,
}

/// An episode scored in both runs.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
pub struct PairView {
    /// Episode id inside the split.
    pub episode: String,
    /// Scene name.
    pub scene: String,
    /// Position in the first run, from 0.
    pub first_ordinal: u32,
    /// Position in the second run.
    pub second_ordinal: u32,
    /// Metrics in the first run.
    pub first: Metrics,
    /// Metrics in the second run.
    pub second: Metrics,
}

/// A reason against a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Incomparable {
    /// The runs have different phases or orders.
    Apart,
    /// Single episodes' metrics are hidden from the viewer.
    Hidden,
}

impl Reader {
    /// Compares two runs; `None` if one is unknown or hidden from the viewer.
    pub async fn compare(
        &self,
        viewer: &Viewer,
        [first, second]: [&str; 2],
    ) -> Result<Option<Result<CompareView, Incomparable>>> {
        let Some(first) = self.run(viewer, first).await? else { return Ok(None) };
        let Some(second) = self.run(viewer, second).await? else { return Ok(None) };
        if first.line.phase != second.line.phase || first.line.order != second.line.order {
            return Ok(Some(Err(Incomparable::Apart)));
        }
        if !(first.replays_visible && second.replays_visible) {
            return Ok(Some(Err(Incomparable::Hidden)));
        }
        let comparison = compare(&scores(&first), &scores(&second), INTERVAL_SEED);
        let episodes = pairs(&first.episodes, &second.episodes);
        Ok(Some(Ok(CompareView { first: first.line, second: second.line, comparison, episodes })))
    }
}

fn scores(run: &RunView) -> Vec<EpisodeScore> {
    let score = |line: &EpisodeLine| {
        Some(EpisodeScore {
            episode: line.episode.clone()?,
            scene: line.scene.clone()?,
            order: run.line.order,
            metrics: line.metrics.clone()?,
        })
    };
    run.episodes.iter().filter_map(score).collect()
}

fn pairs(first: &[EpisodeLine], second: &[EpisodeLine]) -> Vec<PairView> {
    let others: BTreeMap<&str, (u32, &Metrics)> = second
        .iter()
        .filter_map(|line| Some((line.episode.as_deref()?, (line.ordinal, line.metrics.as_ref()?))))
        .collect();
    let pair = |line: &EpisodeLine| {
        let (second_ordinal, second) = *others.get(line.episode.as_deref()?)?;
        Some(PairView {
            episode: line.episode.clone()?,
            scene: line.scene.clone()?,
            first_ordinal: line.ordinal,
            second_ordinal,
            first: line.metrics.clone()?,
            second: second.clone(),
        })
    };
    first.iter().filter_map(pair).collect()
}
