//! Recorded runs, replayed: rescored, checked, and rendered for pages.

use crate::{
    BENCHMARK_VERSION, Failure,
    data::DataFolder,
    episodes::prepare_referee,
    phases::{HostedPhase, PhaseCatalog, SceneCache, find_phase},
    runlog::EpisodeHistory,
};
use avln_episode::{Observation, Order, Rules, Sensors};
use avln_geom::{Vector3, angle};
use avln_render::Camera;
use avln_scoring::{Metrics, Summary, score};
use avln_store::{Facts, Run, RunState, ScoredEpisode, Store, StoreError};
use avln_truth::{EpisodeTruth, Record};
use avln_web::{
    RenderError, RenderedSound, RenderedView, ReplayRenderer, SoundRequest, ViewRequest, async_trait,
};
use serde::Serialize;
use std::{
    collections::{BTreeMap, BTreeSet},
    fmt,
    sync::Arc,
};
use tokio::task::spawn_blocking;
use tracing::Span;

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

/// Memory for scenes of a replayed log, bytes.
const REPLAYED_SCENE_BYTES: usize = 1 << 30;

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
            scenes: SceneCache::new(REPLAYED_SCENE_BYTES, data.cache()),
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

/// Memory limit for rendered scenes, bytes; the last scene always stays.
const RENDERED_SCENE_BYTES: usize = 512 << 20;

pub(crate) struct SceneRenderer {
    store: Store,
    phases: Arc<PhaseCatalog>,
    // Separate from running episodes' scenes, so that visitors do not slow agents.
    scenes: Arc<SceneCache>,
}

impl SceneRenderer {
    pub(crate) fn new(store: Store, phases: Arc<PhaseCatalog>, cache: Arc<dyn avln_world::Cache>) -> Self {
        Self { store, phases, scenes: Arc::new(SceneCache::new(RENDERED_SCENE_BYTES, cache)) }
    }

    async fn phase(&self, id: &str) -> Result<Arc<HostedPhase>, RenderError> {
        let phases = self.phases.now(&self.store).await.map_err(render_error)?;
        find_phase(&phases, id).ok_or_else(|| RenderError(format!("phase '{id}' is not hosted")))
    }
}

impl fmt::Debug for SceneRenderer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("SceneRenderer")
    }
}

#[async_trait]
impl ReplayRenderer for SceneRenderer {
    async fn render_view(&self, request: ViewRequest) -> Result<RenderedView, RenderError> {
        let phase = self.phase(&request.phase).await?;
        let scenes = self.scenes.clone();
        let span = Span::current();
        let rendered = spawn_blocking(move || span.in_scope(|| render_view(&phase, &scenes, &request))).await;
        rendered.map_err(render_error)?
    }

    async fn render_sound(&self, request: SoundRequest) -> Result<RenderedSound, RenderError> {
        let SoundRequest { phase, run, ordinal } = request;
        let phase = self.phase(&phase).await?;
        let then = self.store.run(&run).await.map_err(render_error)?.digests;
        let facts = self.store.facts(&run, ordinal).await.map_err(render_error)?;
        let facts = facts
            .ok_or_else(|| RenderError(format!("the record of episode {ordinal} of {run} is not stored")))?;
        let scenes = self.scenes.clone();
        let span = Span::current();
        let rendered = spawn_blocking(move || {
            let _entered = span.enter();
            // Changed missions, rules or clips would render another sound than the agent received.
            phase.check_digests(&then, &["split", "config"]).map_err(RenderError)?;
            render_sound(&phase, &scenes, &facts)
        });
        let rendered = rendered.await.map_err(render_error)?;
        rendered.map_err(|RenderError(cause)| RenderError(format!("episode {ordinal} of {run}: {cause}")))
    }
}

fn render_error(error: impl fmt::Display) -> RenderError {
    RenderError(error.to_string())
}

fn render_sound(
    phase: &HostedPhase,
    scenes: &SceneCache,
    facts: &Facts,
) -> Result<RenderedSound, RenderError> {
    let ears = Sensors { rgb: false, depth: false, ..Sensors::all(64, 64) };
    let (truth, record) = (&facts.truth, &facts.record);
    let prepared = prepare_referee(phase, scenes, &truth.episode, truth.order, ears);
    let mut referee = prepared.map_err(|refusal| RenderError(refusal.message))?.referee;
    let samples_per_step = phase.rules().samples_per_step() as usize;
    let mut sound = RenderedSound { samples_per_step, ..RenderedSound::default() };
    append(&mut sound, referee.start())?;
    for step in &record.steps {
        let observation = referee.step(step.action).map_err(render_error)?.observation;
        if referee.state_hash() != step.state_hash {
            let step = referee.steps();
            return Err(RenderError(format!("step {step} leads to another state than recorded")));
        }
        append(&mut sound, observation)?;
    }
    Ok(sound)
}

/// Appends a step's sound without padding.
fn append(sound: &mut RenderedSound, observation: Observation) -> Result<(), RenderError> {
    let audio = observation.audio.unwrap_or_default();
    let (left, right) = audio.split_at(audio.len() / 2);
    let step = |ear: &[f32]| ear.get(..sound.samples_per_step).map(<[f32]>::to_vec);
    let (Some(left), Some(right)) = (step(left), step(right)) else {
        return Err(RenderError(format!("observation {} has no sound", observation.step)));
    };
    sound.left.extend(left);
    sound.right.extend(right);
    Ok(())
}

fn render_view(
    phase: &HostedPhase,
    scenes: &SceneCache,
    request: &ViewRequest,
) -> Result<RenderedView, RenderError> {
    let (assets, _) = phase.scene(&request.scene, scenes).map_err(render_error)?;
    let rules = phase.rules();
    let camera = Camera {
        eye: request.pose.position + Vector3::y() * rules.camera_height_m,
        world_from_camera: angle::about_up(request.pose.heading_rad),
        width: request.width,
        height: request.height,
        hfov_rad: request.hfov_rad,
        depth_max_m: rules.depth_max_m,
    };
    let frame = assets.render(&camera);
    Ok(RenderedView { rgb: frame.rgb, depth_m: frame.depth, depth_max_m: rules.depth_max_m })
}
