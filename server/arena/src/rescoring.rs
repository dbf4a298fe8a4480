//! Rescoring of runs from recorded facts.

use crate::{BENCHMARK_VERSION, Failure, FailureKind};
use avln_episode::Rules;
use avln_scoring::{Metrics, Summary, score};
use avln_store::{Run, ScoredEpisode, Store};
use avln_truth::{EpisodeTruth, Record};
use serde::Serialize;
use std::collections::BTreeMap;

/// A scoring function with its version.
#[derive(Clone, Copy, Debug)]
pub struct Scorer {
    /// Benchmark version; equal versions give equal scores.
    pub version: &'static str,
    /// Scores an episode.
    pub score: fn(&EpisodeTruth, &Record, &Rules) -> Metrics,
}

impl Scorer {
    /// The scorer of this build.
    pub const OURS: Self = Self { version: BENCHMARK_VERSION, score };
}

/// A run by two scorers.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// The run.
    pub run: String,
    /// Method.
    pub method: String,
    /// Version of the benchmark that scored it when it was played.
    pub scorer_before: String,
    /// Scorer of the new metrics.
    pub scorer_after: String,
    /// Episodes that count.
    pub episodes: usize,
    /// Changed episodes by position.
    pub changed: Vec<u32>,
    /// Original summary; `None` without counted episodes.
    pub before: Option<Summary>,
    /// New summary.
    pub after: Option<Summary>,
    /// True if the new scores were stored.
    pub is_kept: bool,
}

impl Comparison {
    /// Returns true if a benchmark version gave two results, which indicates an unknown change.
    pub fn contradicts(&self) -> bool {
        self.scorer_before == self.scorer_after && !self.changed.is_empty()
    }
}

/// Rescores a run. The original scores stay; new scores are stored by scorer version, unless that version
/// scored the run first.
///
/// # Errors
/// If facts were pruned, the phase is unknown, or the database fails.
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
