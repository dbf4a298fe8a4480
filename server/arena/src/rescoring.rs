//! Recorded runs, replayed and rescored.

use crate::{
    BENCHMARK_VERSION, Failure,
    data::DataFolder,
    episodes::prepare_referee,
    phases::{HostedPhase, SceneCache},
    runlog::EpisodeHistory,
};
use avln_episode::{Order, Rules, Sensors};
use avln_scoring::{Metrics, Summary, score};
use avln_store::{Run, RunState, ScoredEpisode, Store, StoreError};
use avln_truth::{EpisodeTruth, Record};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

/// A versioned scoring function.
#[derive(Clone, Copy, Debug)]
pub struct Scorer {
    /// Benchmark version; equal versions give equal scores.
    pub version: &'static str,
    /// Scores an episode.
    pub score: fn(&EpisodeTruth, &Record, &Rules) -> Metrics,
}

impl Scorer {
    /// This build's scorer.
    pub const OURS: Self = Self { version: BENCHMARK_VERSION, score };
}

/// A run with two scores.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// Run id.
    pub run: String,
    /// Method.
    pub method: String,
    /// Benchmark version of the original score.
    pub scorer_before: String,
    /// Benchmark version of the new score.
    pub scorer_after: String,
    /// Counted episodes.
    pub episodes: usize,
    /// Changed episodes' indices.
    pub changed: Vec<u32>,
    /// Original summary; `None` without counted episodes.
    pub before: Option<Summary>,
    /// New summary.
    pub after: Option<Summary>,
    /// True if the new scores were stored.
    pub is_kept: bool,
}

impl Comparison {
    /// Returns true if equal versions disagree: a change without a new version.
    pub fn contradicts(&self) -> bool {
        self.scorer_before == self.scorer_after && !self.changed.is_empty()
    }
}

/// Rescores a run with unpruned facts. The original scores stay; the new ones are stored under the scorer's
/// version, unless that version scored the run first.
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
        let message = format!("{pruned} episode records of run {} were pruned", run.id);
        return Err(Failure::data(message).hinted("restore an older backup"));
    }
    let mut again: BTreeMap<u32, Metrics> = BTreeMap::new();
    for episode in &episodes {
        if let Some(facts) = &episode.facts {
            again.insert(episode.ordinal, (scorer.score)(&facts.truth, &facts.record, &rules));
        }
    }
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

/// Compares a run log with the database: fails if the log lacks the end of a scored episode, or the signature of a completed run.
/// A run of another data folder is not compared.
pub async fn check_complete(
    data: &DataFolder,
    run: &str,
    episodes: &BTreeMap<String, EpisodeHistory>,
    is_signed: bool,
) -> Result<(), Failure> {
    let store = data.store().await?;
    let found = match store.run(run).await {
        Ok(found) => Some((found.state, store.scored_episodes(run).await?)),
        Err(StoreError::Unknown { .. }) => None,
        Err(error) => return Err(error.into()),
    };
    store.close().await;
    let Some((state, scored)) = found else { return Ok(()) };
    let ended = episodes.values().filter(|episode| episode.ended.is_some());
    let ended: BTreeSet<u32> = ended.map(|episode| episode.ordinal).collect();
    let cut = |what: String| {
        let message = format!("{what}: lines are missing at its end");
        Err(Failure::run(message)
            .hinted("use the log in the folder runs of the data folder, or download it again"))
    };
    if let Some(missing) = scored.iter().find(|episode| !ended.contains(&episode.ordinal)) {
        return cut(format!("the log lacks the end of episode {}, which has a score", missing.ordinal));
    }
    if state == RunState::Completed && !is_signed {
        return cut("the run is completed, but its log has no signature".to_owned());
    }
    Ok(())
}

/// Memory for scenes, bytes.
const SCENE_BYTES: usize = 1 << 30;

/// A replayer for a phase, without sensors: they do not affect the outcome.
pub struct Replayer {
    phase: HostedPhase,
    scenes: SceneCache,
    order: Order,
}

impl Replayer {
    /// Opens a phase for replay.
    pub async fn open(data: &DataFolder, phase: &str, order: Order) -> Result<Self, Failure> {
        let store = data.store().await?;
        let phase = store.phase(phase).await?;
        store.close().await;
        Ok(Self {
            phase: HostedPhase::read(data, phase, &[])?,
            scenes: SceneCache::new(SCENE_BYTES, data.cache()),
            order,
        })
    }

    /// Compares the digests that affect scores with the present ones; the error names the difference.
    pub fn check_digests(&self, then: &BTreeMap<String, String>) -> Result<(), Failure> {
        self.phase.check_digests(then, &["benchmark", "split", "config"]).map_err(|difference| {
            Failure::run(difference)
                .hinted("check it with the data folder and the version of the server that hosted it")
        })
    }

    /// Replays an episode; returns the metrics if it has ended and counts. Fails if a state differs.
    pub fn replay(&self, history: &EpisodeHistory) -> Result<Option<Metrics>, String> {
        let blind = Sensors { rgb: false, depth: false, audio: false, ..Sensors::all(64, 64) };
        let referee = prepare_referee(&self.phase, &self.scenes, &history.episode, self.order, blind);
        let mut referee = referee.map_err(|refusal| refusal.message)?.referee;
        referee.replay(&history.actions).map_err(|error| error.to_string())?;
        let Some((end, _)) = history.ended else { return Ok(None) };
        referee.truncate(end);
        let (truth, record) = referee.into_record();
        Ok((record.end == end).then(|| score(&truth, &record, self.phase.rules())))
    }
}
