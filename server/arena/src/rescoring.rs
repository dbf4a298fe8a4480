//! Scoring runs again, from the facts that were recorded when they were played.

use crate::{BENCHMARK_VERSION, Failure, FailureKind};
use avln_episode::Rules;
use avln_scoring::{Metrics, Summary, score};
use avln_store::{Run, ScoredEpisode, Store};
use avln_truth::{EpisodeTruth, Record};
use serde::Serialize;
use std::collections::BTreeMap;

/// What turns facts into metrics.
#[derive(Clone, Copy, Debug)]
pub struct Scorer {
    /// Version of the benchmark; another version may give other scores, the same one never.
    pub version: &'static str,
    /// Scores an episode.
    pub score: fn(&EpisodeTruth, &Record, &Rules) -> Metrics,
}

impl Scorer {
    /// The one of this build.
    pub const OURS: Self = Self { version: BENCHMARK_VERSION, score };
}

/// A run by two scorers.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// The run.
    pub run: String,
    /// Its method.
    pub method: String,
    /// Version of the benchmark that scored it when it was played.
    pub scorer_before: String,
    /// The one that scored it now.
    pub scorer_after: String,
    /// Episodes that count.
    pub episodes: usize,
    /// Those that are worth something else now, by place.
    pub changed: Vec<u32>,
    /// What the run was worth; `None` when no episode counts.
    pub before: Option<Summary>,
    /// What it is worth now.
    pub after: Option<Summary>,
    /// Whether the scores of now were stored beside the first.
    pub is_kept: bool,
}

impl Comparison {
    /// Whether one version of the benchmark said two things: something that it does not know of has changed.
    pub fn contradicts(&self) -> bool {
        self.scorer_before == self.scorer_after && !self.changed.is_empty()
    }
}

/// Scores a run again. What it was worth stays; other scores are stored beside it, by the scorer's version, unless that is
/// the version that scored it first.
///
/// # Errors
/// When facts of the run were pruned, its phase is unknown, or the database fails.
pub async fn rescore(
    store: &Store,
    run: &Run,
    scorer: &Scorer,
    now_unix_ms: i64,
) -> Result<Comparison, Failure> {
    let rules = store.phase(&run.phase).await?.rules;
    let episodes = store.scored_episodes(&run.id).await?;
    let pruned = episodes.iter().filter(|episode| episode.facts.is_none()).count();
    if pruned > 0 {
        let message = format!("the records of {pruned} episodes of run {} are not kept any more", run.id);
        return Err(
            Failure::new(FailureKind::Data, message).hinted("restore a backup from before they were pruned")
        );
    }
    let again: BTreeMap<u32, Metrics> =
        episodes.iter().filter_map(|episode| again(episode, scorer, &rules)).collect();
    let differs = |episode: &&ScoredEpisode| again.get(&episode.ordinal) != Some(&episode.metrics);
    let changed = episodes.iter().filter(differs).map(|episode| episode.ordinal).collect();
    let is_other = run.scorer() != scorer.version;
    let rescored = store.rescore(&run.id, scorer.version, &again, is_other, now_unix_ms).await?;
    Ok(Comparison {
        run: run.id.clone(),
        method: run.method.name.clone(),
        scorer_before: run.scorer().to_owned(),
        scorer_after: scorer.version.to_owned(),
        episodes: episodes.len(),
        changed,
        before: rescored.before,
        after: rescored.after,
        is_kept: is_other,
    })
}

fn again(episode: &ScoredEpisode, scorer: &Scorer, rules: &Rules) -> Option<(u32, Metrics)> {
    let facts = episode.facts.as_ref()?;
    Some((episode.ordinal, (scorer.score)(&facts.truth, &facts.record, rules)))
}
