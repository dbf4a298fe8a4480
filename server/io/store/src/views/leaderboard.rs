//! Leaderboards.

use crate::{
    database::{Transaction, Word, value},
    error::Result,
    phases::read_heads,
    runs::Run,
    scores::INTERVAL_SEED,
    views::{Reader, Viewer, phase::PhaseView},
};
use avln_challenge::{MethodType, Reference, RunChoice};
use avln_episode::{EndReason, Order, Sensors};
use avln_scoring::{
    Direction, Entry, EpisodeScore, Key, Metrics, RankedEntry, Standing, Summary, best_first, rank,
};
use serde::{Serialize, Serializer};
use sqlx::{FromRow, types::Json};
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

/// A request for a leaderboard.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LeaderboardQuery<'a> {
    /// Phase id.
    pub phase: &'a str,
    /// Mission order.
    pub order: Order,
    /// The ranking metric.
    pub key: Key,
    /// Selection rule for a method with several runs.
    pub pick: RunChoice,
    /// Latest completion time, milliseconds since 1970-01-01 UTC; `None` for no restriction.
    pub as_of_unix_ms: Option<i64>,
    /// Request time, milliseconds since 1970-01-01 UTC.
    pub now_unix_ms: i64,
    /// Row selection.
    pub filter: RowFilter,
}

/// A leaderboard row selection. Selected rows have their rank among all rows.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RowFilter {
    /// Part to be found in the method, version or team name, in any case; empty for all.
    pub words: String,
    /// Team name; empty for all.
    pub team: String,
    /// Method type; `None` for all, with and without a type.
    pub method_type: Option<MethodType>,
    /// Required and excluded sensors: RGB, depth, audio; `None` for no restriction.
    pub senses: [Option<bool>; 3],
}

impl RowFilter {
    /// Returns whether the filter selects all rows.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    fn selects(&self, row: &LeaderboardRow) -> bool {
        let words = self.words.to_lowercase();
        let names = [&row.method, &row.version, &row.team];
        let is_named = names.into_iter().any(|name| name.to_lowercase().contains(&words));
        let has_type = self.method_type.is_none_or(|wanted| row.method_type == Some(wanted));
        let is_of_team = self.team.is_empty() || row.team == self.team;
        is_named && has_type && is_of_team && self.fits(row.sensors.as_ref())
    }

    /// A run without recorded sensors fits no requirement and no exclusion.
    fn fits(&self, sensors: Option<&Sensors>) -> bool {
        let had = sensors.map(|sensors| [sensors.rgb, sensors.depth, sensors.audio]);
        self.senses.iter().enumerate().all(|(index, wanted)| match (wanted, had) {
            (None, _) => true,
            (Some(_), None) => false,
            (Some(wanted), Some(had)) => had[index] == *wanted,
        })
    }
}

/// A leaderboard: a phase's completed runs in which every episode counts.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
pub struct LeaderboardView {
    /// The phase.
    pub phase: PhaseView,
    /// Mission order.
    pub order: Order,
    /// The ranking metric.
    pub key: Key,
    /// Ranking direction.
    pub direction: Direction,
    /// Selection rule for a method with several runs.
    pub pick: RunChoice,
    /// Latest completion time, milliseconds since 1970-01-01 UTC; `None` for no restriction.
    pub as_of_unix_ms: Option<i64>,
    /// Row count before filtering, including references.
    pub entries: u32,
    /// True if the viewer sees all teams. Otherwise ranks are among the viewer's own runs.
    pub complete: bool,
    /// The selected rows, best first.
    pub rows: Vec<LeaderboardRow>,
    /// The best run before filtering.
    #[serde(skip)]
    pub leader: Option<String>,
    /// The teams before filtering.
    #[serde(skip)]
    pub teams: BTreeSet<String>,
}

/// A leaderboard row.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
pub struct LeaderboardRow {
    /// Rank and tie group; `None` for a reference, which has no rank.
    #[serde(flatten, serialize_with = "flat")]
    #[schema(value_type = StandingFields)]
    pub standing: Option<Standing>,
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
    /// Run id.
    pub run: String,
    /// Benchmark version used for scoring.
    pub scorer: String,
    /// Sensors sent to the agent; `None` if they were not recorded.
    pub sensors: Option<Sensors>,
    /// Means and intervals.
    pub summary: Summary,
    /// Eligible runs with this method.
    pub runs_count: u32,
    /// Median ranking metric over these runs.
    pub median: f64,
    /// Completion time, milliseconds since 1970-01-01 UTC.
    pub finished_unix_ms: Option<i64>,
    /// Episodes by end reason.
    pub health: BTreeMap<&'static str, u32>,
    /// Attempts lost by server failures, which do not count.
    pub server_faults: u32,
    /// True if the organiser verified the run.
    pub verified: bool,
}

/// Rank, rank interval and tie group as row fields; null for a reference.
#[derive(Serialize, utoipa::ToSchema)]
struct StandingFields {
    rank: Option<u32>,
    rank_low: Option<u32>,
    rank_high: Option<u32>,
    tie_group: Option<u32>,
}

fn flat<S: Serializer>(standing: &Option<Standing>, serializer: S) -> Result<S::Ok, S::Error> {
    let fields = StandingFields {
        rank: standing.map(|standing| standing.rank),
        rank_low: standing.map(|standing| standing.rank_low),
        rank_high: standing.map(|standing| standing.rank_high),
        tie_group: standing.map(|standing| standing.tie_group),
    };
    fields.serialize(serializer)
}

impl Reader {
    /// Returns a leaderboard; `None` if the phase is unknown or hidden from the viewer.
    pub async fn leaderboard(
        &self,
        viewer: &Viewer,
        query: &LeaderboardQuery<'_>,
    ) -> Result<Option<LeaderboardView>> {
        let mut tx = self.snapshot().await?;
        let head = read_heads(&mut tx, Some(query.phase)).await?.pop();
        let Some(head) = head.filter(|head| viewer.knows(&head.phase)) else { return Ok(None) };
        // A team with access to its own scores only is ranked among its own runs: ranks among all would reveal the others.
        let all = match viewer {
            _ if viewer.sees_all(head.phase.scores) => self.ranking(&mut tx, query, None).await?,
            Viewer::Team(team) if viewer.may_see(head.phase.scores, team) => {
                self.ranking(&mut tx, query, Some(team)).await?
            }
            _ => Arc::default(),
        };
        let phase = PhaseView::read(&mut tx, head, viewer, query.now_unix_ms).await?;
        Ok(Some(LeaderboardView {
            complete: phase.all_scores_visible,
            phase,
            order: query.order,
            key: query.key,
            direction: query.key.direction(),
            pick: query.pick,
            as_of_unix_ms: query.as_of_unix_ms,
            entries: all.len() as u32,
            leader: all.first().map(|row| row.run.clone()),
            teams: all.iter().map(|row| row.team.clone()).collect(),
            rows: all.iter().filter(|row| query.filter.selects(row)).cloned().collect(),
        }))
    }

    async fn ranking(
        &self,
        tx: &mut Transaction<'_>,
        query: &LeaderboardQuery<'_>,
        team: Option<&str>,
    ) -> Result<Arc<Vec<LeaderboardRow>>> {
        let key = ranking_key(tx, query, team).await?;
        // Resampled rank intervals of a full leaderboard take longer than a page may.
        if let Some(rows) = self.cache.get(&key) {
            return Ok(rows);
        }
        let rows = Arc::new(rank_rows(tx, query, team).await?);
        self.cache.insert(key, rows.clone());
        Ok(rows)
    }
}

/// Returns a ranking's inputs as text. Completed runs never change, so their count identifies them.
async fn ranking_key(
    tx: &mut Transaction<'_>,
    query: &LeaderboardQuery<'_>,
    team: Option<&str>,
) -> Result<String> {
    let select = "SELECT COUNT(*), (SELECT group_concat(g.run || ':' || g.verified || (g.disqualified IS NULL), ' ' ORDER BY g.run) \
                  FROM rulings g JOIN runs r ON r.id = g.run WHERE r.phase = $1) \
                  FROM runs WHERE phase = $1 AND mission_order = $2 AND state = 'completed'";
    let (completed, rulings): (i64, Option<String>) =
        sqlx::query_as(select).bind(query.phase).bind(query.order.as_str()).fetch_one(&mut **tx).await?;
    let LeaderboardQuery { phase, order, key, pick, as_of_unix_ms, .. } = query;
    Ok(format!("{:?}", (phase, order, key, pick, as_of_unix_ms, team, completed, rulings)))
}

/// An eligible run: completed, every episode counts, not disqualified.
#[derive(FromRow)]
struct Candidate {
    run: String,
    team: String,
    method: String,
    version: String,
    method_type: Option<Word<MethodType>>,
    reference: Option<Word<Reference>>,
    digests: Json<BTreeMap<String, String>>,
    senses: Option<Json<Sensors>>,
    summary: Json<Summary>,
    server_faults: u32,
    finished_ms: Option<i64>,
    verified: bool,
}

struct Representative {
    candidate: Candidate,
    /// Ranking metrics for all eligible runs with the method.
    values: Vec<f64>,
    episodes: ScoredEpisodes,
}

#[derive(FromRow)]
struct ChosenEpisode {
    run: String,
    episode: String,
    scene: String,
    end_reason: Option<Word<EndReason>>,
    metrics: Option<Json<Metrics>>,
}

#[derive(Default)]
struct ScoredEpisodes {
    scores: Vec<EpisodeScore>,
    health: BTreeMap<&'static str, u32>,
}

async fn rank_rows(
    tx: &mut Transaction<'_>,
    query: &LeaderboardQuery<'_>,
    team: Option<&str>,
) -> Result<Vec<LeaderboardRow>> {
    let candidates = read_candidates(tx, query, team).await?;
    let mut chosen = choose(candidates, query);
    read_episodes(tx, query.order, &mut chosen).await?;
    let entries: Vec<Entry<'_>> = chosen.iter().map(Representative::entry).collect();
    let places = rank(&entries, query.key, INTERVAL_SEED);
    Ok(places.into_iter().map(|RankedEntry { entry, standing }| chosen[entry].row(standing)).collect())
}

/// Returns the eligible runs, newest first.
async fn read_candidates(
    tx: &mut Transaction<'_>,
    query: &LeaderboardQuery<'_>,
    team: Option<&str>,
) -> Result<Vec<Candidate>> {
    let select = "SELECT r.id AS run, r.team, r.method, r.version, r.method_type, t.reference, r.digests, r.senses, \
                  s.summary, s.server_faults, r.finished_ms, COALESCE(g.verified, 0) AS verified \
                  FROM runs r JOIN run_summaries s ON s.run = r.id JOIN teams t ON t.name = r.team \
                  LEFT JOIN rulings g ON g.run = r.id \
                  WHERE r.phase = $1 AND r.mission_order = $2 AND r.state = 'completed' \
                  AND s.scored = r.episodes AND s.summary IS NOT NULL AND g.disqualified IS NULL \
                  AND ($3 IS NULL OR r.finished_ms <= $3) AND ($4 IS NULL OR r.team = $4) \
                  ORDER BY r.finished_ms DESC, r.id";
    Ok(sqlx::query_as(select)
        .bind(query.phase)
        .bind(query.order.as_str())
        .bind(query.as_of_unix_ms)
        .bind(team)
        .fetch_all(&mut **tx)
        .await?)
}

/// Chooses one run per team and method. `candidates` are sorted newest first.
fn choose(candidates: Vec<Candidate>, query: &LeaderboardQuery<'_>) -> Vec<Representative> {
    let order: Vec<usize> = match query.pick {
        RunChoice::Latest => (0..candidates.len()).collect(),
        RunChoice::Best => {
            let summaries: Vec<&Summary> = candidates.iter().map(|candidate| &candidate.summary.0).collect();
            best_first(&summaries, query.key)
        }
    };
    // In rank order the first run of a method represents it.
    let mut left: Vec<Option<Candidate>> = candidates.into_iter().map(Some).collect();
    let mut chosen: BTreeMap<(String, String), Representative> = BTreeMap::new();
    for candidate in order.into_iter().filter_map(|index| left[index].take()) {
        let value = query.key.mean_of(&candidate.summary.0);
        chosen
            .entry((candidate.team.clone(), candidate.method.clone()))
            .and_modify(|first| first.values.push(value))
            .or_insert(Representative { candidate, values: vec![value], episodes: Default::default() });
    }
    chosen.into_values().collect()
}

async fn read_episodes(tx: &mut Transaction<'_>, order: Order, chosen: &mut [Representative]) -> Result<()> {
    // SQLite could extract the metric from the JSON, but its text-to-float conversion is not exact to the last bit.
    let select = "SELECT run, episode, scene, end_reason, metrics FROM episodes \
                  WHERE run IN (SELECT value FROM json_each($1)) ORDER BY run, ordinal";
    let runs: Vec<&str> = chosen.iter().map(|entry| entry.candidate.run.as_str()).collect();
    let rows: Vec<ChosenEpisode> = sqlx::query_as(select).bind(Json(runs)).fetch_all(&mut **tx).await?;
    let mut episodes: BTreeMap<String, ScoredEpisodes> = BTreeMap::new();
    for ChosenEpisode { run, episode, scene, end_reason, metrics } in rows {
        let of_run = episodes.entry(run).or_default();
        if let Some(Word(end)) = end_reason {
            *of_run.health.entry(end.as_str()).or_default() += 1;
        }
        if let Some(Json(metrics)) = metrics {
            of_run.scores.push(EpisodeScore { episode, scene, order, metrics });
        }
    }
    for entry in chosen {
        entry.episodes = episodes.remove(&entry.candidate.run).unwrap_or_default();
    }
    Ok(())
}

impl Representative {
    fn entry(&self) -> Entry<'_> {
        Entry {
            summary: &self.candidate.summary.0,
            scores: &self.episodes.scores,
            is_ranked: self.candidate.reference.is_none(),
        }
    }

    fn row(&self, standing: Option<Standing>) -> LeaderboardRow {
        let Candidate { run, team, method, version, digests, summary, .. } = &self.candidate;
        LeaderboardRow {
            standing,
            team: team.clone(),
            reference: value(self.candidate.reference),
            method: method.clone(),
            version: version.clone(),
            method_type: value(self.candidate.method_type),
            run: run.clone(),
            scorer: digests.0.get(Run::SCORER).cloned().unwrap_or_default(),
            sensors: self.candidate.senses.as_ref().map(|Json(senses)| senses.clone()),
            summary: summary.0.clone(),
            runs_count: self.values.len() as u32,
            median: median(&self.values),
            finished_unix_ms: self.candidate.finished_ms,
            health: self.episodes.health.clone(),
            server_faults: self.candidate.server_faults,
            verified: self.candidate.verified,
        }
    }
}

/// Returns a non-empty list's median; for an even length the mean over both middle values.
fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    (sorted[(sorted.len() - 1) / 2] + sorted[sorted.len() / 2]) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn median_is_middle_or_mean_of_middles() {
        assert_eq!(median(&[0.25]), 0.25);
        assert_eq!(median(&[1.0, 0.0, 0.5]), 0.5);
        assert_eq!(median(&[1.0, 0.0, 0.5, 0.75]), 0.625);
    }

    #[test]
    fn unrecorded_sensors_fit_no_filter() {
        let deaf = Sensors { audio: false, ..Sensors::all(64, 64) };
        let filter = |senses| RowFilter { senses, ..RowFilter::default() };
        assert!(filter([None, None, Some(false)]).fits(Some(&deaf)));
        assert!(!filter([None, None, Some(true)]).fits(Some(&deaf)));
        assert!(filter([Some(true), None, Some(false)]).fits(Some(&deaf)));
        assert!(
            !filter([Some(false), None, None]).fits(None) && !filter([Some(true), None, None]).fits(None)
        );
        assert!(filter([None; 3]).fits(None));
    }
}
