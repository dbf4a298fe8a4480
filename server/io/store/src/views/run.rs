//! Run pages, with groups of episodes.

use crate::{
    commitment::read_key,
    database::{Transaction, Word, value},
    error::{Result, StoreError},
    phases::{Phase, read_heads},
    runs::{Run, read_run},
    scores::{INTERVAL_SEED, Rescore, read_rescores, read_scores},
    views::{Reader, Viewer},
};
use avln_challenge::{EpisodeState, MethodInfo, MethodType, Reference, RunState, TimeAccount};
use avln_episode::{EndReason, Modality, Order, Sensors};
use avln_scoring::{EpisodeScore, Metrics, Summary, summarise};
use serde::Serialize;
use sqlx::{FromRow, types::Json};
use std::{collections::BTreeMap, sync::Arc};

/// A run in a list. Times are milliseconds since 1970-01-01 UTC.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
pub struct RunLine {
    /// Run id.
    pub run: String,
    /// Phase id.
    pub phase: String,
    /// Team name.
    pub team: String,
    /// Reference kind; `None` for a competing team.
    pub reference: Option<Reference>,
    /// Method name.
    pub method: String,
    /// Method version.
    pub version: String,
    /// Method type; `None` if the team declared none.
    #[serde(rename = "type")]
    pub method_type: Option<MethodType>,
    /// Mission order.
    pub order: Order,
    /// Run state.
    pub state: RunState,
    /// Episode count.
    pub episodes: u32,
    /// Episodes that are over.
    pub done: u32,
    /// Found share, mean over scored episodes; `None` if hidden or no episode is scored.
    pub isr: Option<f64>,
    /// Start time.
    pub created_unix_ms: i64,
    /// End time.
    pub finished_unix_ms: Option<i64>,
    /// True if the organiser verified the run.
    pub verified: bool,
    /// Public disqualification reason; `None` if the run is not disqualified.
    pub disqualified: Option<String>,
}

/// A run with episodes. Data hidden from the viewer is `None` or empty.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
pub struct RunView {
    /// The run.
    pub line: RunLine,
    /// The method with type, description, links, licence and external data.
    pub method: MethodInfo,
    /// True if the viewer sees the scores.
    pub scores_visible: bool,
    /// True if the viewer sees paths, maps and targets.
    pub replays_visible: bool,
    /// True if the run is ranked: completed, every episode counts, not disqualified.
    pub eligible: bool,
    /// Means and intervals over the scored episodes.
    pub summary: Option<Summary>,
    /// Goals by modality.
    pub modalities: Vec<ModalityView>,
    /// Episodes by goal count; empty if replays are hidden, because a single episode's lengths reveal the targets.
    pub by_goals: Vec<GroupView>,
    /// Episodes by scene; empty if replays are hidden.
    pub by_scene: Vec<GroupView>,
    /// Episodes by end reason.
    pub health: BTreeMap<&'static str, u32>,
    /// Attempts lost by server failures, which do not count.
    pub server_faults: u32,
    /// Wall-clock time by activity, over all episodes; whole seconds if replays are hidden.
    pub time: TimeAccount,
    /// Sensors requested in the last session; `None` before the first session.
    pub sensors: Option<Sensors>,
    /// Digests and versions in force at the start, by name.
    pub digests: BTreeMap<String, String>,
    /// Means by other scorers; empty if scores are hidden.
    pub rescores: Vec<Rescore>,
    /// Episodes in playing order.
    pub episodes: Vec<EpisodeLine>,
}

/// Goals with one modality.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, utoipa::ToSchema)]
pub struct ModalityView {
    /// The modality.
    pub modality: Modality,
    /// Goals in scored episodes.
    pub goals: u32,
    /// Goals found.
    pub found: u32,
    /// Found share; `None` without goals.
    pub isr: Option<f64>,
}

/// An episode in a run's list.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
pub struct EpisodeLine {
    /// Index in the run, from 0.
    pub ordinal: u32,
    /// Episode state.
    pub state: EpisodeState,
    /// End reason.
    pub end: Option<EndReason>,
    /// Episode id inside the split; `None` if replays are hidden.
    pub episode: Option<String>,
    /// Scene name; `None` if replays are hidden.
    pub scene: Option<String>,
    /// Metrics; `None` if not scored, or if replays are hidden, because the lengths reveal the targets.
    pub metrics: Option<Metrics>,
    /// Result time, milliseconds since 1970-01-01 UTC.
    pub finished_unix_ms: Option<i64>,
}

/// A viewer's access to a run's log, which reveals as much as replays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LogAccess {
    /// No access, or no such run.
    None,
    /// Access after the run's end.
    Later,
    /// Access.
    Now,
}

/// A viewer's access to a run.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sight {
    pub(crate) scores: bool,
    pub(crate) replays: bool,
}

impl Sight {
    /// Returns `None` if the run itself is hidden.
    pub(crate) fn of(viewer: &Viewer, team: &str, phase: &Phase) -> Option<Self> {
        let scores = viewer.may_see(phase.scores, team) && (viewer.knows(phase) || viewer.owns(team));
        // A replay reveals the score.
        let replays = scores && viewer.may_see(phase.replays, team);
        (scores || viewer.owns(team)).then_some(Self { scores, replays })
    }
}

#[derive(Default, FromRow)]
struct TotalsRow {
    scored: u32,
    category_goals: u32,
    category_found: u32,
    description_goals: u32,
    description_found: u32,
    image_goals: u32,
    image_found: u32,
    server_faults: u32,
}

#[derive(FromRow)]
pub(crate) struct EpisodeRow {
    pub(crate) ordinal: u32,
    pub(crate) state: Word<EpisodeState>,
    pub(crate) end_reason: Option<Word<EndReason>>,
    pub(crate) episode: String,
    pub(crate) scene: String,
    pub(crate) metrics: Option<Json<Metrics>>,
    pub(crate) time_account: Option<Json<TimeAccount>>,
    pub(crate) finished_ms: Option<i64>,
}

impl Reader {
    /// Returns the viewer's access to a run's log.
    pub async fn log_access(&self, viewer: &Viewer, id: &str) -> Result<LogAccess> {
        let mut tx = self.snapshot().await?;
        Ok(match find_run(&mut tx, viewer, id).await? {
            Some((run, Sight { replays: true, .. })) if run.state.is_open() => LogAccess::Later,
            Some((_, Sight { replays: true, .. })) => LogAccess::Now,
            _ => LogAccess::None,
        })
    }

    /// Returns the run called `id`; `None` if there is none visible to the viewer.
    pub async fn run(&self, viewer: &Viewer, id: &str) -> Result<Option<RunView>> {
        let mut tx = self.snapshot().await?;
        let Some((run, sight)) = find_run(&mut tx, viewer, id).await? else { return Ok(None) };
        let totals = read_totals(&mut tx, id).await?;
        let is_completed = run.state == RunState::Completed;
        let key = format!("{id} {sight:?}");
        let cached: Option<Arc<RunView>> = self.cache.get(&key).filter(|_| is_completed);
        let mut view = match cached {
            Some(view) => RunView::clone(&view),
            None => {
                let view = read_view(&mut tx, &run, sight, &totals).await?;
                if is_completed {
                    self.cache.insert(key, Arc::new(view.clone()));
                }
                view
            }
        };
        // Rulings and rescores can follow the end of a run, so they are never cached.
        view.eligible = is_completed && totals.scored == run.episodes && run.ruling.disqualified.is_none();
        view.rescores = if sight.scores { read_rescores(&mut tx, id).await? } else { vec![] };
        view.sensors = run.sensors.clone();
        view.line = read_line(&mut tx, id, sight).await?;
        Ok(Some(view))
    }
}

/// Returns a run's view without rescores and eligibility.
async fn read_view(tx: &mut Transaction<'_>, run: &Run, sight: Sight, totals: &TotalsRow) -> Result<RunView> {
    let rows = read_episodes(tx, &run.id, None).await?;
    let scores = if sight.scores { read_scores(tx, &run.id).await? } else { vec![] };
    let mut health = BTreeMap::new();
    let mut time = TimeAccount::default();
    for row in &rows {
        if let Some(Word(end)) = row.end_reason {
            *health.entry(end.as_str()).or_default() += 1;
        }
        time = time.plus(&row.time());
    }
    Ok(RunView {
        method: run.method.clone(),
        scores_visible: sight.scores,
        replays_visible: sight.replays,
        eligible: false,
        summary: summarise(&scores, INTERVAL_SEED),
        modalities: if sight.scores { totals.modalities() } else { vec![] },
        by_goals: if sight.replays { by_goals(&scores) } else { vec![] },
        by_scene: if sight.replays { by_scene(&scores) } else { vec![] },
        health,
        server_faults: totals.server_faults,
        time: if sight.replays { time } else { time.rounded() },
        sensors: run.sensors.clone(),
        digests: read_digests(tx, run, sight).await?,
        rescores: vec![],
        episodes: rows.into_iter().map(|row| row.into_line(sight)).collect(),
        line: read_line(tx, &run.id, sight).await?,
    })
}

/// Returns a run's digests; without access to replays, the split's digest as agents see it.
async fn read_digests(tx: &mut Transaction<'_>, run: &Run, sight: Sight) -> Result<BTreeMap<String, String>> {
    let mut digests = run.digests.clone();
    if !sight.replays
        && let Some(digest) = digests.get_mut(Run::SPLIT)
        && let Some(secret) = read_key(tx, &run.phase).await?
    {
        *digest = secret.split_digest(digest);
    }
    Ok(digests)
}

/// Returns a run and the viewer's access; `None` if there is none visible to the viewer.
pub(crate) async fn find_run(
    tx: &mut Transaction<'_>,
    viewer: &Viewer,
    id: &str,
) -> Result<Option<(Run, Sight)>> {
    let run = match read_run(tx, id).await {
        Ok(run) => run,
        Err(StoreError::Unknown { .. }) => return Ok(None),
        Err(error) => return Err(error),
    };
    let phase = read_heads(tx, Some(&run.phase)).await?.pop();
    let sight = phase.and_then(|head| Sight::of(viewer, &run.team, &head.phase));
    Ok(sight.map(|sight| (run, sight)))
}

/// Returns a run's line in lists.
pub(crate) async fn read_line(tx: &mut Transaction<'_>, run: &str, sight: Sight) -> Result<RunLine> {
    let line = read_lines(tx, &[(run.to_owned(), sight)]).await?.pop();
    line.ok_or_else(|| StoreError::unknown("run", run))
}

/// Returns the lines of known runs in the same order, with a single query.
pub(crate) async fn read_lines(tx: &mut Transaction<'_>, page: &[(String, Sight)]) -> Result<Vec<RunLine>> {
    let ids: Vec<&str> = page.iter().map(|(run, _)| run.as_str()).collect();
    // SQLite never reorders a cross join: the page comes first.
    let select = "SELECT o.*, t.reference, s.scored, s.isr FROM json_each($1) page \
                  CROSS JOIN run_overview o ON o.id = page.value JOIN run_summaries s ON s.run = o.id \
                  JOIN teams t ON t.name = o.team ORDER BY page.key";
    let runs: Vec<ListedRun> = sqlx::query_as(select).bind(Json(ids)).fetch_all(&mut **tx).await?;
    // By id: a missing row must not give a run the access of its neighbour.
    let sights: BTreeMap<_, _> = page.iter().map(|(run, sight)| (run.as_str(), *sight)).collect();
    let line =
        |listed: ListedRun| sights.get(listed.run.id.as_str()).copied().map(|sight| listed.into_line(sight));
    Ok(runs.into_iter().filter_map(line).collect())
}

/// A run with columns for lists.
#[derive(FromRow)]
struct ListedRun {
    #[sqlx(flatten)]
    run: Run,
    reference: Option<Word<Reference>>,
    scored: u32,
    isr: f64,
}

impl ListedRun {
    fn into_line(self, sight: Sight) -> RunLine {
        let Self { run, reference, scored, isr } = self;
        RunLine {
            reference: value(reference),
            isr: (sight.scores && scored > 0).then(|| isr / f64::from(scored)),
            run: run.id,
            phase: run.phase,
            team: run.team,
            method: run.method.name,
            version: run.method.version,
            method_type: run.method.method_type,
            order: run.order,
            state: run.state,
            episodes: run.episodes,
            done: run.done,
            created_unix_ms: run.created_unix_ms,
            finished_unix_ms: run.finished_unix_ms,
            verified: run.ruling.verified,
            disqualified: run.ruling.disqualified,
        }
    }
}

async fn read_totals(tx: &mut Transaction<'_>, run: &str) -> Result<TotalsRow> {
    let select = "SELECT scored, category_goals, category_found, description_goals, description_found, \
                  image_goals, image_found, server_faults FROM run_summaries WHERE run = $1";
    Ok(sqlx::query_as(select).bind(run).fetch_optional(&mut **tx).await?.unwrap_or_default())
}

/// Returns a run's episode at `ordinal`, or all episodes.
pub(crate) async fn read_episodes(
    tx: &mut Transaction<'_>,
    run: &str,
    ordinal: Option<u32>,
) -> Result<Vec<EpisodeRow>> {
    let select = "SELECT ordinal, state, end_reason, episode, scene, metrics, time_account, finished_ms \
                  FROM episodes WHERE run = $1 AND ($2 IS NULL OR ordinal = $2) ORDER BY ordinal";
    Ok(sqlx::query_as(select).bind(run).bind(ordinal).fetch_all(&mut **tx).await?)
}

impl TotalsRow {
    fn modalities(&self) -> Vec<ModalityView> {
        let view = |modality, goals: u32, found: u32| ModalityView {
            modality,
            goals,
            found,
            isr: (goals > 0).then(|| f64::from(found) / f64::from(goals)),
        };
        vec![
            view(Modality::Category, self.category_goals, self.category_found),
            view(Modality::Description, self.description_goals, self.description_found),
            view(Modality::Image, self.image_goals, self.image_found),
        ]
    }
}

impl EpisodeRow {
    fn into_line(self, sight: Sight) -> EpisodeLine {
        EpisodeLine {
            ordinal: self.ordinal,
            state: self.state.0,
            end: value(self.end_reason),
            episode: sight.replays.then_some(self.episode),
            scene: sight.replays.then_some(self.scene),
            metrics: self.metrics.filter(|_| sight.replays).map(|Json(metrics)| metrics),
            finished_unix_ms: self.finished_ms,
        }
    }

    pub(crate) fn time(&self) -> TimeAccount {
        self.time_account.as_ref().map(|Json(time)| *time).unwrap_or_default()
    }
}

/// A group of a run's episodes, with means.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
pub struct GroupView {
    /// Common scene or goal count.
    pub name: String,
    /// Episode count.
    pub episodes: u32,
    /// Success rate.
    pub sr: f64,
    /// Found share.
    pub isr: f64,
    /// Found share weighted by path length.
    pub soft_spl: f64,
    /// Action count.
    pub steps: f64,
}

/// Groups episodes by goal count, ascending.
pub(crate) fn by_goals(scores: &[EpisodeScore]) -> Vec<GroupView> {
    grouped(scores, |score| score.metrics.goals, u32::to_string)
}

pub(crate) fn by_scene(scores: &[EpisodeScore]) -> Vec<GroupView> {
    grouped(scores, |score| score.scene.as_str(), |scene| (*scene).to_owned())
}

fn grouped<'a, K: Ord>(
    scores: &'a [EpisodeScore],
    key: impl Fn(&'a EpisodeScore) -> K,
    name: impl Fn(&K) -> String,
) -> Vec<GroupView> {
    let mut groups = BTreeMap::<K, Vec<&EpisodeScore>>::new();
    scores.iter().for_each(|score| groups.entry(key(score)).or_default().push(score));
    groups.into_iter().map(|(key, scores)| GroupView::new(name(&key), scores)).collect()
}

impl GroupView {
    fn new(name: String, mut scores: Vec<&EpisodeScore>) -> Self {
        // Float addition is not associative: sorted sums are equal for every playing order.
        scores.sort_by(|a, b| a.episode.cmp(&b.episode));
        let mean = |value: fn(&Metrics) -> f64| {
            scores.iter().map(|score| value(&score.metrics)).sum::<f64>() / scores.len() as f64
        };
        Self {
            episodes: scores.len() as u32,
            sr: mean(|m| m.sr),
            isr: mean(|m| m.isr),
            soft_spl: mean(|m| m.soft_spl),
            steps: mean(|m| f64::from(m.steps)),
            name,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_episode::Order;

    #[test]
    fn episodes_are_grouped_by_goals_and_scene() {
        let score = |episode: &str, scene: &str, goals, isr| EpisodeScore {
            episode: episode.to_owned(),
            scene: scene.to_owned(),
            order: Order::Ordered,
            metrics: Metrics { goals, isr, steps: 10, ..Metrics::default() },
        };
        let scores = [score("c", "x", 4, 0.5), score("a", "y", 2, 1.0), score("b", "x", 2, 0.0)];
        let values = |groups: Vec<GroupView>| {
            groups.into_iter().map(|group| (group.name, group.episodes, group.isr)).collect::<Vec<_>>()
        };
        assert_eq!(values(by_goals(&scores)), [("2".to_owned(), 2, 0.5), ("4".to_owned(), 1, 0.5)]);
        assert_eq!(values(by_scene(&scores)), [("x".to_owned(), 2, 0.25), ("y".to_owned(), 1, 1.0)]);
    }
}
