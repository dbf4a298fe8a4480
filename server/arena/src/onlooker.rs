//! Rendering of images and sound for replays, with separate scenes so that visitors do not slow agents.

use super::{
    play::make_referee,
    scenes::SceneCache,
    stages::{Stage, Stages},
};
use avln_episode::{Observation, Sensors};
use avln_geom::{Vector3, angle};
use avln_render::Camera;
use avln_store::{Facts, Store};
use avln_web::{
    RenderError, RenderedSound, RenderedView, ReplayRenderer, SoundRequest, ViewRequest, async_trait,
};
use std::{collections::BTreeMap, fmt, sync::Arc};

/// Memory limit of these scenes, bytes; the last scene always stays.
const SCENE_BYTES: usize = 512 << 20;

/// Renderer for visitors.
pub(super) struct SceneRenderer {
    store: Store,
    stages: Arc<Stages>,
    scenes: Arc<SceneCache>,
}

impl SceneRenderer {
    pub(super) fn new(store: Store, stages: Arc<Stages>, cache: Arc<dyn avln_world::Cache>) -> Self {
        Self { store, stages, scenes: Arc::new(SceneCache::new(SCENE_BYTES, cache)) }
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
        let stage = stage(&self.stages, &self.store, &request.phase).await?;
        let scenes = self.scenes.clone();
        let rendered = tokio::task::spawn_blocking(move || render_view(&stage, &scenes, &request)).await;
        rendered.map_err(render_error)?
    }

    async fn render_sound(&self, request: SoundRequest) -> Result<RenderedSound, RenderError> {
        let SoundRequest { phase, run, ordinal } = request;
        let stage = stage(&self.stages, &self.store, &phase).await?;
        let then = self.store.run(&run).await.map_err(render_error)?.digests;
        let facts = self.store.facts(&run, ordinal).await.map_err(render_error)?;
        let facts = facts
            .ok_or_else(|| RenderError(format!("the record of episode {ordinal} of {run} is not stored")))?;
        let scenes = self.scenes.clone();
        let rendered = tokio::task::spawn_blocking(move || {
            check_digests(&stage, &then)?;
            render_sound(&stage, &scenes, &facts)
        });
        let rendered = rendered.await.map_err(render_error)?;
        rendered.map_err(|RenderError(cause)| RenderError(format!("episode {ordinal} of {run}: {cause}")))
    }
}

fn render_error(error: impl fmt::Display) -> RenderError {
    RenderError(error.to_string())
}

async fn stage(stages: &Stages, store: &Store, phase: &str) -> Result<Arc<Stage>, RenderError> {
    let all = stages.now(store).await.map_err(render_error)?;
    let stage = all.iter().find(|stage| stage.phase.id == phase).cloned();
    stage.ok_or_else(|| RenderError(format!("phase '{phase}' is not hosted")))
}

/// Refuses to hear by other missions, rules or sounds than the run was played by.
fn check_digests(stage: &Stage, then: &BTreeMap<String, String>) -> Result<(), RenderError> {
    let now = stage.digests();
    let differs = |name: &&str| then.get(*name) != now.get(*name);
    let Some(name) = ["split", "config"].into_iter().find(differs) else { return Ok(()) };
    let told = |digests: &BTreeMap<String, String>| digests.get(name).cloned().unwrap_or_default();
    Err(RenderError(format!("it was played with {name} '{}', which is '{}' now", told(then), told(&now))))
}

/// Replays the recorded actions with audio only.
fn render_sound(stage: &Stage, scenes: &SceneCache, facts: &Facts) -> Result<RenderedSound, RenderError> {
    let ears = Sensors { rgb: false, depth: false, ..Sensors::all(64, 64) };
    let (truth, record) = (&facts.truth, &facts.record);
    let made = make_referee(stage, scenes, &truth.episode, truth.order, ears);
    let mut referee = made.map_err(|refusal| RenderError(refusal.message))?.referee;
    let samples_per_step = stage.rules().samples_per_step() as usize;
    let mut sound = RenderedSound { samples_per_step, ..RenderedSound::default() };
    append(&mut sound, referee.start())?;
    for step in &record.steps {
        let observation = referee.step(step.action).map_err(render_error)?.observation;
        if referee.state_hash() != step.state_hash {
            return Err(RenderError(format!("step {} leads elsewhere than it did", referee.steps())));
        }
        append(&mut sound, observation)?;
    }
    Ok(sound)
}

/// Appends the sound of a step without padding.
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
    stage: &Stage,
    scenes: &SceneCache,
    request: &ViewRequest,
) -> Result<RenderedView, RenderError> {
    let (assets, _) = stage.scene(&request.scene, scenes).map_err(render_error)?;
    let rules = stage.rules();
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
