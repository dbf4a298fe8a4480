use super::{PhaseView, Reader, Viewer};
use crate::{
    Phase, Reference, Run, RunState, StoreError,
    accounts::read_reference,
    phases::read_heads,
    runs::{RunFilter, read_runs},
    totals::{INTERVAL_SEED, plain_scores},
    words::{count, end_reason, from_json},
};
use avln_challenge::RunChoice;
use avln_episode::{Order, Sensors};
use avln_scoring::{Direction, Entry, EpisodeScore, Key, RankedEntry, Standing, Summary, best_first, rank};
use serde::{Serialize, Serializer};
use sqlx::{Sqlite, Transaction};
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::{Arc, Mutex, PoisonError},
};

/// Which board is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Board<'a> {
    /// Id of the phase.
    pub phase: &'a str,
    /// How goals count.
    pub order: Order,
    /// What entries are ranked by.
    pub key: Key,
    /// Which run stands for a method.
    pub pick: RunChoice,
    /// Only runs that were completed by then, milliseconds since 1970-01-01 UTC; `None` for all of them.
    pub as_of_unix_ms: Option<i64>,
    /// When one looks, milliseconds since 1970-01-01 UTC.
    pub now_unix_ms: i64,
}

/// A board: the completed runs of one phase and order whose every episode counts.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LeaderboardView {
    /// The phase.
    pub phase: PhaseView,
    /// How goals count.
    pub order: Order,
    /// What entries are ranked by.
    pub key: Key,
    /// Which end of it is good.
    pub direction: Direction,
    /// Which run stands for a method.
    pub pick: RunChoice,
    /// Only runs that were completed by then are on it, milliseconds since 1970-01-01 UTC; `None` for all of them.
    pub as_of_unix_ms: Option<i64>,
    /// Entries of which the rows are some: those that compete, and references. More than rows where the visitor asked for some of them.
    pub entries: u32,
    /// Whether the viewer sees all teams; otherwise ranks are among the viewer's own runs.
    pub complete: bool,
    /// The entries, best first.
    pub rows: Vec<LeaderboardRow>,
}

/// A line of a board.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LeaderboardRow {
    /// Where it stands; `None` for a reference, which is shown among the others and has no rank.
    #[serde(flatten, serialize_with = "flat")]
    pub standing: Option<Standing>,
    /// Who played.
    pub team: String,
    /// What the team's runs are a reference for; `None` where it competes.
    pub reference: Option<Reference>,
    /// Name of the method.
    pub method: String,
    /// Version of the method.
    pub version: String,
    /// The run that stands for it.
    pub run: String,
    /// Version of the benchmark that scored it.
    pub scorer: String,
    /// What the server sent to the run's agent; `None` for a run of which that was not noted.
    pub sensors: Option<Sensors>,
    /// Means and intervals.
    pub summary: Summary,
    /// Runs of this method of the team that could stand here.
    pub runs_count: u32,
    /// The middle one of what they reached in the key, the mean of the two middle ones where their number is even.
    pub median: f64,
    /// When the run was completed, milliseconds since 1970-01-01 UTC.
    pub finished_unix_ms: Option<i64>,
    /// Episodes by end reason.
    pub health: BTreeMap<&'static str, u32>,
    /// Attempts that the server lost and that do not count.
    pub server_faults: u32,
    /// Whether the organiser verified the run.
    pub verified: bool,
}

/// Rank, its interval and its tie group as fields of the row, null where there are none.
fn flat<S: Serializer>(standing: &Option<Standing>, serializer: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Flat {
        rank: Option<u32>,
        rank_low: Option<u32>,
        rank_high: Option<u32>,
        tie_group: Option<u32>,
    }
    let of = |value: fn(&Standing) -> u32| standing.as_ref().map(value);
    let (rank, tie_group) = (of(|s| s.rank), of(|s| s.tie_group));
    Flat { rank, rank_low: of(|s| s.rank_low), rank_high: of(|s| s.rank_high), tie_group }
        .serialize(serializer)
}

/// Boards that were ranked before. Completed runs never change, so the runs, the key and the pick say everything.
#[derive(Clone, Debug, Default)]
pub(super) struct RankedBoards(Arc<Mutex<BTreeMap<Question, Vec<LeaderboardRow>>>>);

/// The runs that may stand on a board, what they are ranked by and which stands for its method.
type Question = (Vec<String>, Key, RunChoice);

impl RankedBoards {
    /// Boards kept at a time; there are few phases, and old lists of runs are asked for no more.
    const KEPT: usize = 64;

    fn find(&self, question: &Question) -> Option<Vec<LeaderboardRow>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get(question).cloned()
    }

    fn keep(&self, question: Question, rows: Vec<LeaderboardRow>) {
        let mut boards = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if boards.len() >= Self::KEPT {
            boards.clear();
        }
        boards.insert(question, rows);
    }
}

/// A run that may stand on the board.
struct Candidate {
    run: Run,
    summary: Summary,
    server_faults: u32,
    scores: Vec<EpisodeScore>,
    reference: Option<Reference>,
    /// What all runs of the method reached in the key.
    reached: Vec<f64>,
}

impl Reader {
    /// A board; `None` when there is no such phase that the viewer may know of.
    ///
    /// # Errors
    /// When the database fails or holds damaged rows.
    pub async fn leaderboard(
        &self,
        viewer: &Viewer,
        board: &Board<'_>,
    ) -> Result<Option<LeaderboardView>, StoreError> {
        let mut tx = self.snapshot().await?;
        let head = read_heads(&mut tx, Some(board.phase)).await?.pop();
        let Some(head) = head.filter(|head| viewer.knows(&head.phase)) else { return Ok(None) };
        let eligible = eligible_runs(&mut tx, viewer, &head.phase, board).await?;
        let verified: BTreeSet<String> =
            eligible.iter().filter(|(_, verified)| *verified).map(|(run, _)| run.clone()).collect();
        let runs: Vec<String> = eligible.into_iter().map(|(run, _)| run).collect();
        let question = (runs, board.key, board.pick);
        let mut rows = match self.boards.find(&question) {
            Some(rows) => rows,
            None => {
                let rows = rank_rows(&mut tx, &question.0, board).await?;
                self.boards.keep(question, rows.clone());
                rows
            }
        };
        // Rulings change, and boards that were ranked before are kept.
        rows.iter_mut().for_each(|row| row.verified = verified.contains(&row.run));
        let phase = PhaseView::new(head, viewer, board.now_unix_ms);
        let Board { order, key, pick, as_of_unix_ms, .. } = *board;
        let (complete, direction) = (phase.all_scores_visible, key.direction());
        let entries = rows.len() as u32;
        Ok(Some(LeaderboardView {
            phase,
            order,
            key,
            direction,
            pick,
            as_of_unix_ms,
            entries,
            complete,
            rows,
        }))
    }
}

async fn rank_rows(
    tx: &mut Transaction<'_, Sqlite>,
    runs: &[String],
    board: &Board<'_>,
) -> Result<Vec<LeaderboardRow>, StoreError> {
    let filter =
        RunFilter { phase: Some(board.phase), state: Some(RunState::Completed), ..RunFilter::default() };
    let mut known: BTreeMap<String, Run> =
        read_runs(tx, &filter).await?.into_iter().map(|run| (run.id.clone(), run)).collect();
    let mut candidates = Vec::with_capacity(runs.len());
    for run in runs.iter().filter_map(|run| known.remove(run)) {
        candidates.push(candidate(tx, run, board.key).await?);
    }
    let mut chosen = one_per_method(candidates, board);
    for candidate in &mut chosen {
        candidate.scores = plain_scores(tx, &candidate.run.id, board.order).await?;
        candidate.reference = read_reference(tx, &candidate.run.team).await?;
    }
    let entries: Vec<Entry<'_>> = chosen.iter().map(Candidate::entry).collect();
    let mut rows = Vec::with_capacity(chosen.len());
    for RankedEntry { entry, standing } in rank(&entries, board.key, INTERVAL_SEED) {
        rows.push(row(tx, &chosen[entry], standing).await?);
    }
    Ok(rows)
}

/// Ids of the completed runs that the viewer may see the scores of, whose every episode counts and that are not disqualified, the
/// newest first, and whether the organiser verified each.
async fn eligible_runs(
    tx: &mut Transaction<'_, Sqlite>,
    viewer: &Viewer,
    phase: &Phase,
    board: &Board<'_>,
) -> Result<Vec<(String, bool)>, StoreError> {
    // One row of many lines is read several times as fast as many rows. Names of teams hold no line breaks.
    let select = "SELECT group_concat(r.id || ' ' || COALESCE(g.verified, 0) || ' ' || r.team, char(10) \
                  ORDER BY r.finished_ms DESC, r.id) FROM runs r JOIN run_summaries s ON s.run = r.id \
                  LEFT JOIN rulings g ON g.run = r.id WHERE r.phase = $1 AND r.mission_order = $2 AND r.state = 'completed' \
                  AND s.scored = r.episodes AND s.summary IS NOT NULL AND g.disqualified IS NULL \
                  AND ($3 IS NULL OR r.finished_ms <= $3)";
    let lines: Option<String> = sqlx::query_scalar(select)
        .bind(&phase.id)
        .bind(board.order.as_str())
        .bind(board.as_of_unix_ms)
        .fetch_one(&mut **tx)
        .await?;
    let run_of = |line: &str| {
        let (run, rest) = line.split_once(' ')?;
        let (verified, team) = rest.split_once(' ')?;
        viewer.may_see(phase.scores, team).then(|| (run.to_owned(), verified == "1"))
    };
    Ok(lines.unwrap_or_default().split('\n').filter_map(run_of).collect())
}

async fn candidate(tx: &mut Transaction<'_, Sqlite>, run: Run, key: Key) -> Result<Candidate, StoreError> {
    let select = "SELECT summary, server_faults FROM run_summaries WHERE run = $1";
    let (summary, faults): (String, i64) = sqlx::query_as(select).bind(&run.id).fetch_one(&mut **tx).await?;
    let summary: Summary = from_json("summary", &summary)?;
    Ok(Candidate {
        run,
        reached: vec![key.mean_of(&summary)],
        summary,
        server_faults: count(faults),
        scores: vec![],
        reference: None,
    })
}

/// Keeps the run that stands for each method of each team. `candidates` come newest first.
fn one_per_method(candidates: Vec<Candidate>, board: &Board<'_>) -> Vec<Candidate> {
    let order: Vec<usize> = match board.pick {
        RunChoice::Latest => (0..candidates.len()).collect(),
        RunChoice::Best => {
            let summaries: Vec<&Summary> = candidates.iter().map(|candidate| &candidate.summary).collect();
            best_first(&summaries, board.key)
        }
    };
    let mut slots: Vec<Option<Candidate>> = candidates.into_iter().map(Some).collect();
    let mut kept: BTreeMap<(String, String), Candidate> = BTreeMap::new();
    for candidate in order.into_iter().filter_map(|index| slots[index].take()) {
        let method = (candidate.run.team.clone(), candidate.run.method.clone());
        let reached = candidate.reached[0];
        kept.entry(method).and_modify(|first| first.reached.push(reached)).or_insert(candidate);
    }
    kept.into_values().collect()
}

impl Candidate {
    fn entry(&self) -> Entry<'_> {
        Entry { summary: &self.summary, scores: &self.scores, is_ranked: self.reference.is_none() }
    }
}

/// The middle of values of which there is one at least.
fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    (sorted[(sorted.len() - 1) / 2] + sorted[sorted.len() / 2]) / 2.0
}

async fn row(
    tx: &mut Transaction<'_, Sqlite>,
    candidate: &Candidate,
    standing: Option<Standing>,
) -> Result<LeaderboardRow, StoreError> {
    let run = &candidate.run;
    Ok(LeaderboardRow {
        standing,
        team: run.team.clone(),
        reference: candidate.reference,
        method: run.method.clone(),
        version: run.version.clone(),
        run: run.id.clone(),
        scorer: run.scorer().to_owned(),
        sensors: run.senses.clone(),
        summary: candidate.summary.clone(),
        runs_count: candidate.reached.len() as u32,
        median: median(&candidate.reached),
        finished_unix_ms: run.finished_unix_ms,
        health: read_health(tx, &run.id).await?,
        server_faults: candidate.server_faults,
        verified: run.ruling.verified,
    })
}

async fn read_health(
    tx: &mut Transaction<'_, Sqlite>,
    run: &str,
) -> Result<BTreeMap<&'static str, u32>, StoreError> {
    let select =
        "SELECT end_reason, COUNT(*) FROM episodes WHERE run = $1 AND end_reason IS NOT NULL GROUP BY 1";
    let rows: Vec<(String, i64)> = sqlx::query_as(select).bind(run).fetch_all(&mut **tx).await?;
    rows.into_iter().map(|(word, times)| Ok((end_reason(&word)?.as_str(), count(times)))).collect()
}

#[cfg(test)]
mod tests {
    use super::median;

    #[test]
    fn the_median_is_the_middle_or_between_the_middles() {
        assert_eq!(median(&[0.25]), 0.25);
        assert_eq!(median(&[1.0, 0.0, 0.5]), 0.5);
        assert_eq!(median(&[1.0, 0.0, 0.5, 0.75]), 0.625);
    }
}
