//! Replay images and sound.

use crate::{
    episodes::prepare_referee,
    phases::{HostedPhase, PhaseCatalog, SceneCache, find_phase},
};
use avln_episode::{Observation, Sensors};
use avln_geom::{Vector3, angle};
use avln_render::Camera;
use avln_store::{Facts, Store};
use avln_web::{
    RenderError, RenderedSound, RenderedView, ReplayRenderer, SoundRequest, ViewRequest, async_trait,
};
use std::{fmt, sync::Arc};
use tokio::task::spawn_blocking;

/// Memory limit for replayed scenes, bytes; the last scene always stays.
const SCENE_BYTES: usize = 512 << 20;

pub(crate) struct SceneRenderer {
    store: Store,
    phases: Arc<PhaseCatalog>,
    // Separate from running episodes' scenes, so that visitors do not slow agents.
    scenes: Arc<SceneCache>,
}

impl SceneRenderer {
    pub(crate) fn new(store: Store, phases: Arc<PhaseCatalog>, cache: Arc<dyn avln_world::Cache>) -> Self {
        Self { store, phases, scenes: Arc::new(SceneCache::new(SCENE_BYTES, cache)) }
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
        let rendered = spawn_blocking(move || render_view(&phase, &scenes, &request)).await;
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
        let rendered = spawn_blocking(move || {
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
