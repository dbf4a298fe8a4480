use super::{
    Reader, Viewer,
    group::{GroupView, by_goals, by_scene},
};
use crate::{
    EpisodeState, Phase, Reference, Rescore, Run, RunState, StoreError, TimeAccount,
    accounts::read_reference,
    phases::read_heads,
    rescore::read_rescores,
    runs::read_run,
    totals::{INTERVAL_SEED, full_scores},
    words::{count, end_reason, from_json, row},
};
use avln_episode::{EndReason, Modality, Order, Sensors};
use avln_scoring::{Metrics, Summary, summarise};
use serde::Serialize;
use sqlx::{Sqlite, Transaction};
use std::collections::BTreeMap;

/// A run in a list.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunLine {
    /// Id of the run.
    pub run: String,
    /// What is played.
    pub phase: String,
    /// Who plays.
    pub team: String,
    /// What the team's runs are a reference for; `None` where it competes.
    pub reference: Option<Reference>,
    /// Name of the method.
    pub method: String,
    /// Version of the method.
    pub version: String,
    /// How goals count.
    pub order: Order,
    /// How far it is.
    pub state: RunState,
    /// Episodes in all.
    pub episodes: u32,
    /// Episodes done.
    pub done: u32,
    /// Share of goals found so far, mean over scored episodes; `None` when hidden or none is scored.
    pub isr: Option<f64>,
    /// When it was started, milliseconds since 1970-01-01 UTC.
    pub created_unix_ms: i64,
    /// When it was completed or cancelled.
    pub finished_unix_ms: Option<i64>,
    /// Whether the organiser verified it.
    pub verified: bool,
    /// Why the organiser took it off all boards; `None` where that was not done.
    pub disqualified: Option<String>,
}

/// A run with its episodes. What the viewer may not see is `None` or empty.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunView {
    /// The run.
    pub line: RunLine,
    /// Whether the viewer may see the scores.
    pub scores_visible: bool,
    /// Whether the viewer may see paths, maps and targets.
    pub replays_visible: bool,
    /// Whether the run is ranked: completed, every episode counts, and the organiser did not disqualify it.
    pub eligible: bool,
    /// Means and intervals over the episodes scored so far.
    pub summary: Option<Summary>,
    /// Goals by the way they were told.
    pub modalities: Vec<ModalityView>,
    /// Episodes by number of goals; empty when replays are hidden: a group may be one episode, whose lengths tell of its targets.
    pub by_goals: Vec<GroupView>,
    /// Episodes by scene; empty when replays are hidden.
    pub by_scene: Vec<GroupView>,
    /// Episodes by end reason.
    pub health: BTreeMap<&'static str, u32>,
    /// Attempts that the server lost and that do not count.
    pub server_faults: u32,
    /// Where the time went, over all episodes.
    pub time: TimeAccount,
    /// What the agent asked to sense; `None` before it did.
    pub sensors: Option<Sensors>,
    /// What was in force, by name.
    pub digests: BTreeMap<String, String>,
    /// What the run is worth by other scorers; empty when scores are hidden.
    pub rescores: Vec<Rescore>,
    /// The episodes in playing order.
    pub episodes: Vec<EpisodeLine>,
}

/// Goals told in one way.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ModalityView {
    /// The way.
    pub modality: Modality,
    /// Goals of scored episodes.
    pub goals: u32,
    /// Goals found.
    pub found: u32,
    /// Share found; `None` when there are none.
    pub isr: Option<f64>,
}

/// An episode in a run's list.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EpisodeLine {
    /// Place in the phase's list, from 0.
    pub ordinal: u32,
    /// How far it is.
    pub state: EpisodeState,
    /// Why it ended.
    pub end: Option<EndReason>,
    /// Id of the episode inside the split; `None` when replays are hidden.
    pub episode: Option<String>,
    /// Name of the scene; `None` when replays are hidden.
    pub scene: Option<String>,
    /// What it was worth; `None` when not scored, or when replays are hidden: an episode's lengths tell where its targets are.
    pub metrics: Option<Metrics>,
    /// When the result was stored, milliseconds since 1970-01-01 UTC.
    pub finished_unix_ms: Option<i64>,
}

/// A part of the list of runs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunList {
    /// The newest first.
    pub runs: Vec<RunLine>,
    /// The run after which the list goes on; `None` at its end.
    pub next: Option<String>,
}

/// Runs of a phase, or of all, the newest first, from the one on that comes after a run.
const OLDER_RUNS: &str = "SELECT id, phase, team FROM runs WHERE ($1 IS NULL OR phase = $1) AND ($2 IS NULL OR EXISTS \
     (SELECT 1 FROM runs b WHERE b.id = $2 AND (runs.created_ms < b.created_ms \
      OR (runs.created_ms = b.created_ms AND runs.id > b.id)))) ORDER BY created_ms DESC, id";

/// Whether a viewer may read the log of a run, which tells what its replay tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LogAccess {
    /// The viewer may not, or knows of no such run.
    None,
    /// Once the run is over.
    Later,
    /// The viewer may.
    Now,
}

/// What a viewer may see of a run.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sight {
    pub(super) scores: bool,
    pub(super) replays: bool,
}

impl Sight {
    /// `None` when the viewer may not even know of the run.
    pub(super) fn of(viewer: &Viewer, team: &str, phase: &Phase) -> Option<Self> {
        let scores = viewer.may_see(phase.scores, team) && (viewer.knows(phase) || viewer.owns(team));
        // A replay tells the score.
        let replays = scores && viewer.may_see(phase.replays, team);
        (scores || viewer.owns(team)).then_some(Self { scores, replays })
    }
}

row! {
    #[derive(Default)]
    pub(super) struct TotalsRow {
        scored: i64,
        isr: f64,
        category_goals: i64,
        category_found: i64,
        description_goals: i64,
        description_found: i64,
        image_goals: i64,
        image_found: i64,
        server_faults: i64,
    }
}

row! {
    pub(super) struct EpisodeRow {
        pub(super) ordinal: i64,
        pub(super) state: String,
        pub(super) end_reason: Option<String>,
        pub(super) episode: String,
        pub(super) scene: String,
        pub(super) metrics: Option<String>,
        pub(super) time_account: Option<String>,
        pub(super) finished_ms: Option<i64>,
    }
}

impl Reader {
    /// The runs that the viewer may know of, the newest first, `limit` at most; `phase` `None` for all phases.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn runs(
        &self,
        viewer: &Viewer,
        phase: Option<&str>,
        limit: u32,
    ) -> Result<Vec<RunLine>, StoreError> {
        let list = self.older_runs(viewer, phase, None, limit).await?;
        Ok(list.map(|list| list.runs).unwrap_or_default())
    }

    /// The same, from the run on that comes after the one called `before`; `None` when the viewer knows of no such run.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn older_runs(
        &self,
        viewer: &Viewer,
        phase: Option<&str>,
        before: Option<&str>,
        limit: u32,
    ) -> Result<Option<RunList>, StoreError> {
        let mut tx = self.snapshot().await?;
        if let Some(before) = before
            && find_run(&mut tx, viewer, before).await?.is_none()
        {
            return Ok(None);
        }
        let phases = read_heads(&mut tx, phase).await?;
        let runs: Vec<(String, String, String)> =
            sqlx::query_as(OLDER_RUNS).bind(phase).bind(before).fetch_all(&mut *tx).await?;
        let mut list = RunList { runs: Vec::new(), next: None };
        for (run, phase, team) in runs {
            let head = phases.iter().find(|head| head.phase.id == phase);
            let Some(sight) = head.and_then(|head| Sight::of(viewer, &team, &head.phase)) else { continue };
            if list.runs.len() >= limit as usize {
                list.next = list.runs.last().map(|last| last.run.clone());
                break;
            }
            let run = read_run(&mut tx, &run).await?;
            list.runs.push(line(&mut tx, run, sight).await?);
        }
        Ok(Some(list))
    }

    /// Whether the viewer may read the log of the run called `id`.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn log_access(&self, viewer: &Viewer, id: &str) -> Result<LogAccess, StoreError> {
        let mut tx = self.snapshot().await?;
        Ok(match find_run(&mut tx, viewer, id).await? {
            Some((run, Sight { replays: true, .. })) if run.state.is_open() => LogAccess::Later,
            Some((_, Sight { replays: true, .. })) => LogAccess::Now,
            _ => LogAccess::None,
        })
    }

    /// The run called `id`; `None` when there is none that the viewer may know of.
    ///
    /// # Errors
    /// When the database fails or holds damaged rows.
    pub async fn run(&self, viewer: &Viewer, id: &str) -> Result<Option<RunView>, StoreError> {
        let mut tx = self.snapshot().await?;
        let Some((run, sight)) = find_run(&mut tx, viewer, id).await? else { return Ok(None) };
        let (totals, is_over) = (read_totals(&mut tx, id).await?, run.state == RunState::Completed);
        let kept = self.runs.find(id, sight).filter(|_| is_over);
        let mut view = match kept {
            Some(view) => view,
            None => {
                let view = read_view(&mut tx, &run, sight, &totals).await?;
                if is_over {
                    self.runs.keep(id, sight, view.clone());
                }
                view
            }
        };
        // What the organiser rules, and what other scorers find, may change after a run is over.
        let is_whole = is_over && count(totals.scored) == run.episodes;
        view.eligible = is_whole && run.ruling.disqualified.is_none();
        view.rescores = if sight.scores { read_rescores(&mut tx, id).await? } else { vec![] };
        view.sensors = run.sensors.clone();
        view.line = line(&mut tx, run, sight).await?;
        Ok(Some(view))
    }
}

/// A run with its episodes, but for what may change after it is over.
async fn read_view(
    tx: &mut Transaction<'_, Sqlite>,
    run: &Run,
    sight: Sight,
    totals: &TotalsRow,
) -> Result<RunView, StoreError> {
    let rows = read_episodes(tx, &run.id, None).await?;
    let scores = if sight.scores { full_scores(tx, &run.id).await? } else { vec![] };
    Ok(RunView {
        scores_visible: sight.scores,
        replays_visible: sight.replays,
        eligible: false,
        summary: summarise(&scores, INTERVAL_SEED),
        modalities: if sight.scores { totals.modalities() } else { vec![] },
        by_goals: if sight.replays { by_goals(&scores) } else { vec![] },
        by_scene: if sight.replays { by_scene(&scores) } else { vec![] },
        health: health(&rows)?,
        server_faults: count(totals.server_faults),
        time: time_of_all(&rows)?,
        sensors: run.sensors.clone(),
        digests: run.digests.clone(),
        rescores: vec![],
        episodes: rows.into_iter().map(|row| row.into_line(sight)).collect::<Result<_, _>>()?,
        line: line(tx, run.clone(), sight).await?,
    })
}

/// A run and what the viewer may see of it; `None` when there is none that the viewer may know of.
pub(super) async fn find_run(
    tx: &mut Transaction<'_, Sqlite>,
    viewer: &Viewer,
    id: &str,
) -> Result<Option<(Run, Sight)>, StoreError> {
    let run = match read_run(tx, id).await {
        Ok(run) => run,
        Err(StoreError::Unknown { .. }) => return Ok(None),
        Err(error) => return Err(error),
    };
    let phase = read_heads(tx, Some(&run.phase)).await?.pop();
    let sight = phase.and_then(|head| Sight::of(viewer, &run.team, &head.phase));
    Ok(sight.map(|sight| (run, sight)))
}

pub(super) async fn line(
    tx: &mut Transaction<'_, Sqlite>,
    run: Run,
    sight: Sight,
) -> Result<RunLine, StoreError> {
    let reference = read_reference(tx, &run.team).await?;
    let totals = read_totals(tx, &run.id).await?;
    Ok(RunLine {
        reference,
        isr: (sight.scores && totals.scored > 0).then(|| totals.isr / totals.scored as f64),
        run: run.id,
        phase: run.phase,
        team: run.team,
        method: run.method,
        version: run.version,
        order: run.order,
        state: run.state,
        episodes: run.episodes,
        done: run.done,
        created_unix_ms: run.created_unix_ms,
        finished_unix_ms: run.finished_unix_ms,
        verified: run.ruling.verified,
        disqualified: run.ruling.disqualified,
    })
}

async fn read_totals(tx: &mut Transaction<'_, Sqlite>, run: &str) -> Result<TotalsRow, StoreError> {
    let select = "SELECT scored, isr, category_goals, category_found, description_goals, description_found, \
                  image_goals, image_found, server_faults FROM run_summaries WHERE run = $1";
    Ok(sqlx::query_as(select).bind(run).fetch_optional(&mut **tx).await?.unwrap_or_default())
}

/// The episodes of a run, or the one at place `ordinal`.
pub(super) async fn read_episodes(
    tx: &mut Transaction<'_, Sqlite>,
    run: &str,
    ordinal: Option<u32>,
) -> Result<Vec<EpisodeRow>, StoreError> {
    let select = "SELECT ordinal, state, end_reason, episode, scene, metrics, time_account, finished_ms \
                  FROM episodes WHERE run = $1 AND ($2 IS NULL OR ordinal = $2) ORDER BY ordinal";
    Ok(sqlx::query_as(select).bind(run).bind(ordinal).fetch_all(&mut **tx).await?)
}

impl TotalsRow {
    fn modalities(&self) -> Vec<ModalityView> {
        let view = |modality, goals: i64, found: i64| ModalityView {
            modality,
            goals: count(goals),
            found: count(found),
            isr: (goals > 0).then(|| found as f64 / goals as f64),
        };
        vec![
            view(Modality::Category, self.category_goals, self.category_found),
            view(Modality::Description, self.description_goals, self.description_found),
            view(Modality::Image, self.image_goals, self.image_found),
        ]
    }
}

impl EpisodeRow {
    pub(super) fn into_line(self, sight: Sight) -> Result<EpisodeLine, StoreError> {
        let metrics = self.metrics.filter(|_| sight.replays);
        Ok(EpisodeLine {
            ordinal: count(self.ordinal),
            state: EpisodeState::from_word(&self.state)?,
            end: self.end_reason.map(|word| end_reason(&word)).transpose()?,
            episode: sight.replays.then_some(self.episode),
            scene: sight.replays.then_some(self.scene),
            metrics: metrics.map(|json| from_json("metrics", &json)).transpose()?,
            finished_unix_ms: self.finished_ms,
        })
    }

    pub(super) fn time(&self) -> Result<TimeAccount, StoreError> {
        Ok(self
            .time_account
            .as_deref()
            .map(|json| from_json("time account", json))
            .transpose()?
            .unwrap_or_default())
    }
}

fn health(rows: &[EpisodeRow]) -> Result<BTreeMap<&'static str, u32>, StoreError> {
    let mut health = BTreeMap::new();
    for word in rows.iter().filter_map(|row| row.end_reason.as_deref()) {
        *health.entry(end_reason(word)?.as_str()).or_default() += 1;
    }
    Ok(health)
}

fn time_of_all(rows: &[EpisodeRow]) -> Result<TimeAccount, StoreError> {
    rows.iter().try_fold(TimeAccount::default(), |sum, row| Ok(sum.plus(&row.time()?)))
}
