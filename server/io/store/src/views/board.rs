use super::{PhaseView, Reader, Viewer};
use crate::{
    Phase, Run, RunState, StoreError,
    phases::read_heads,
    runs::{RunFilter, read_runs},
    totals::{INTERVAL_SEED, plain_scores},
    words::{count, end_reason, from_json},
};
use avln_episode::{Order, Sensors};
use avln_scoring::{Direction, Entry, EpisodeScore, Key, Place, Summary, rank};
use serde::{Deserialize, Serialize};
use sqlx::{Sqlite, Transaction};
use std::{
    collections::BTreeMap,
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
    pub pick: Pick,
    /// Only runs that were completed by then, milliseconds since 1970-01-01 UTC; `None` for all of them.
    pub as_of_unix_ms: Option<i64>,
    /// When one looks, milliseconds since 1970-01-01 UTC.
    pub now_unix_ms: i64,
}

/// Which of its runs stands for a method of a team.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Pick {
    /// The one that ranks first.
    #[default]
    Best,
    /// The one that was completed last.
    Latest,
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
    pub pick: Pick,
    /// Only runs that were completed by then are on it, milliseconds since 1970-01-01 UTC; `None` for all of them.
    pub as_of_unix_ms: Option<i64>,
    /// Entries among which the rows are ranked; more than rows where the visitor asked for some of them.
    pub entries: u32,
    /// Whether the viewer sees all teams; otherwise ranks are among the viewer's own runs.
    pub complete: bool,
    /// The entries, best first.
    pub rows: Vec<LeaderboardRow>,
}

/// A line of a board.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LeaderboardRow {
    /// 1 for the best; equal entries share a rank.
    pub rank: u32,
    /// Entries of one group cannot be told apart from its first.
    pub tie_group: u32,
    /// Who played.
    pub team: String,
    /// Whether the team stands for the organiser's reference agents.
    pub baseline: bool,
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
    /// Ranked runs of this method of the team.
    pub runs_count: u32,
    /// When the run was completed, milliseconds since 1970-01-01 UTC.
    pub finished_unix_ms: Option<i64>,
    /// Episodes by end reason.
    pub health: BTreeMap<&'static str, u32>,
    /// Attempts that the server lost and that do not count.
    pub server_faults: u32,
}

/// Boards that were ranked before. Completed runs never change, so the runs, the key and the pick say everything.
#[derive(Clone, Debug, Default)]
pub(super) struct RankedBoards(Arc<Mutex<BTreeMap<Question, Vec<LeaderboardRow>>>>);

/// The runs that may stand on a board, what they are ranked by and which stands for its method.
type Question = (Vec<String>, Key, Pick);

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
    runs_count: u32,
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
        let candidates = candidates(&mut tx, viewer, &head.phase, board).await?;
        let runs: Vec<String> = candidates.iter().map(|candidate| candidate.run.id.clone()).collect();
        let question = (runs, board.key, board.pick);
        let rows = match self.boards.find(&question) {
            Some(rows) => rows,
            None => {
                let rows = rank_rows(&mut tx, candidates, board).await?;
                self.boards.keep(question, rows.clone());
                rows
            }
        };
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
    candidates: Vec<Candidate>,
    board: &Board<'_>,
) -> Result<Vec<LeaderboardRow>, StoreError> {
    let mut chosen = one_per_method(candidates, board);
    for candidate in &mut chosen {
        candidate.scores = plain_scores(tx, &candidate.run.id, board.order).await?;
    }
    let mut rows = Vec::with_capacity(chosen.len());
    for place in ranked(&chosen, board.key) {
        rows.push(row(tx, &chosen[place.entry], place).await?);
    }
    Ok(rows)
}

/// Completed runs that the viewer may see the scores of and whose every episode counts, the newest first.
async fn candidates(
    tx: &mut Transaction<'_, Sqlite>,
    viewer: &Viewer,
    phase: &Phase,
    board: &Board<'_>,
) -> Result<Vec<Candidate>, StoreError> {
    let filter =
        RunFilter { phase: Some(&phase.id), state: Some(RunState::Completed), ..RunFilter::default() };
    let mut found = Vec::new();
    for run in read_runs(tx, &filter).await? {
        let is_later = board.as_of_unix_ms.is_some_and(|as_of| run.finished_unix_ms > Some(as_of));
        if is_later || run.order != board.order || !viewer.may_see(phase.scores, &run.team) {
            continue;
        }
        if let Some((summary, server_faults)) = stored_summary(tx, &run).await? {
            found.push(Candidate { run, summary, server_faults, scores: vec![], runs_count: 1 });
        }
    }
    found.sort_by_key(|candidate| std::cmp::Reverse(candidate.run.finished_unix_ms));
    Ok(found)
}

/// Means and lost attempts of a run; `None` when an episode of it does not count.
async fn stored_summary(
    tx: &mut Transaction<'_, Sqlite>,
    run: &Run,
) -> Result<Option<(Summary, u32)>, StoreError> {
    let select = "SELECT summary, server_faults FROM run_summaries WHERE run = $1 AND scored = $2 AND summary IS NOT NULL";
    let row: Option<(String, i64)> =
        sqlx::query_as(select).bind(&run.id).bind(run.episodes).fetch_optional(&mut **tx).await?;
    row.map(|(summary, faults)| Ok((from_json("summary", &summary)?, count(faults)))).transpose()
}

/// Keeps the run that stands for each method of each team. `candidates` come newest first.
fn one_per_method(candidates: Vec<Candidate>, board: &Board<'_>) -> Vec<Candidate> {
    let order: Vec<usize> = match board.pick {
        Pick::Latest => (0..candidates.len()).collect(),
        Pick::Best => ranked(&candidates, board.key).iter().map(|place| place.entry).collect(),
    };
    let mut slots: Vec<Option<Candidate>> = candidates.into_iter().map(Some).collect();
    let mut kept: BTreeMap<(String, String), Candidate> = BTreeMap::new();
    for candidate in order.into_iter().filter_map(|index| slots[index].take()) {
        let method = (candidate.run.team.clone(), candidate.run.method.clone());
        kept.entry(method).and_modify(|first| first.runs_count += 1).or_insert(candidate);
    }
    kept.into_values().collect()
}

fn ranked(candidates: &[Candidate], key: Key) -> Vec<Place> {
    let entries: Vec<Entry<'_>> =
        candidates.iter().map(|c| Entry { summary: &c.summary, scores: &c.scores }).collect();
    rank(&entries, key, INTERVAL_SEED)
}

async fn row(
    tx: &mut Transaction<'_, Sqlite>,
    candidate: &Candidate,
    place: Place,
) -> Result<LeaderboardRow, StoreError> {
    let run = &candidate.run;
    let baseline = "SELECT baseline FROM teams WHERE name = $1";
    let baseline: bool = sqlx::query_scalar(baseline).bind(&run.team).fetch_one(&mut **tx).await?;
    Ok(LeaderboardRow {
        rank: place.rank,
        tie_group: place.tie_group,
        team: run.team.clone(),
        baseline,
        method: run.method.clone(),
        version: run.version.clone(),
        run: run.id.clone(),
        scorer: run.scorer().to_owned(),
        sensors: run.senses.clone(),
        summary: candidate.summary.clone(),
        runs_count: candidate.runs_count,
        finished_unix_ms: run.finished_unix_ms,
        health: read_health(tx, &run.id).await?,
        server_faults: candidate.server_faults,
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
