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
use avln_web::{Blind, Glance, Heard, Hearing, Listening, Looking, Onlooker, Seen};
use std::{collections::BTreeMap, fmt, sync::Arc};

/// Memory limit of these scenes, bytes; the last scene always stays.
const SCENE_BYTES: usize = 512 << 20;

/// Renderer for visitors.
pub(super) struct SceneOnlooker {
    store: Store,
    stages: Arc<Stages>,
    scenes: Arc<SceneCache>,
}

impl SceneOnlooker {
    pub(super) fn new(store: Store, stages: Arc<Stages>, cache: Arc<dyn avln_world::Cache>) -> Self {
        Self { store, stages, scenes: Arc::new(SceneCache::new(SCENE_BYTES, cache)) }
    }
}

impl fmt::Debug for SceneOnlooker {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("SceneOnlooker")
    }
}

impl Onlooker for SceneOnlooker {
    fn look(&self, glance: Glance) -> Looking {
        let (store, stages, scenes) = (self.store.clone(), self.stages.clone(), self.scenes.clone());
        Box::pin(async move {
            let stage = stage(&stages, &store, &glance.phase).await?;
            let looked = tokio::task::spawn_blocking(move || look(&stage, &scenes, &glance)).await;
            looked.map_err(blind)?
        })
    }

    fn listen(&self, listening: Listening) -> Hearing {
        let (store, stages, scenes) = (self.store.clone(), self.stages.clone(), self.scenes.clone());
        Box::pin(async move {
            let Listening { phase, run, ordinal } = listening;
            let stage = stage(&stages, &store, &phase).await?;
            let then = store.run(&run).await.map_err(blind)?.digests;
            let facts = store.facts(&run, ordinal).await.map_err(blind)?;
            let facts = facts
                .ok_or_else(|| Blind(format!("the record of episode {ordinal} of {run} is not kept")))?;
            let heard = tokio::task::spawn_blocking(move || {
                check_digests(&stage, &then)?;
                listen(&stage, &scenes, &facts)
            });
            let heard = heard.await.map_err(blind)?;
            heard.map_err(|Blind(why)| Blind(format!("episode {ordinal} of {run}: {why}")))
        })
    }
}

fn blind(error: impl fmt::Display) -> Blind {
    Blind(error.to_string())
}

async fn stage(stages: &Stages, store: &Store, phase: &str) -> Result<Arc<Stage>, Blind> {
    let all = stages.now(store).await.map_err(blind)?;
    let stage = all.iter().find(|stage| stage.phase.id == phase).cloned();
    stage.ok_or_else(|| Blind(format!("phase '{phase}' is not hosted")))
}

/// Refuses to hear by other missions, rules or sounds than the run was played by.
fn check_digests(stage: &Stage, then: &BTreeMap<String, String>) -> Result<(), Blind> {
    let now = stage.digests();
    let differs = |name: &&str| then.get(*name) != now.get(*name);
    let Some(name) = ["split", "config"].into_iter().find(differs) else { return Ok(()) };
    let told = |digests: &BTreeMap<String, String>| digests.get(name).cloned().unwrap_or_default();
    Err(Blind(format!("it was played with {name} '{}', which is '{}' now", told(then), told(&now))))
}

/// Replays the recorded actions with audio only.
fn listen(stage: &Stage, scenes: &SceneCache, facts: &Facts) -> Result<Heard, Blind> {
    let ears = Sensors { rgb: false, depth: false, ..Sensors::all(64, 64) };
    let (truth, record) = (&facts.truth, &facts.record);
    let made = make_referee(stage, scenes, &truth.episode, truth.order, ears);
    let mut referee = made.map_err(|refusal| Blind(refusal.message))?.referee;
    let samples_per_step = stage.rules().samples_per_step() as usize;
    let mut heard = Heard { samples_per_step, ..Heard::default() };
    append(&mut heard, referee.start())?;
    for step in &record.steps {
        let observation = referee.step(step.action).map_err(blind)?.observation;
        if referee.state_hash() != step.state_hash {
            return Err(Blind(format!("step {} leads elsewhere than it did", referee.steps())));
        }
        append(&mut heard, observation)?;
    }
    Ok(heard)
}

/// Appends the sound of a step without padding.
fn append(heard: &mut Heard, observation: Observation) -> Result<(), Blind> {
    let audio = observation.audio.unwrap_or_default();
    let (left, right) = audio.split_at(audio.len() / 2);
    let step = |ear: &[f32]| ear.get(..heard.samples_per_step).map(<[f32]>::to_vec);
    let (Some(left), Some(right)) = (step(left), step(right)) else {
        return Err(Blind(format!("observation {} has no sound", observation.step)));
    };
    heard.left.extend(left);
    heard.right.extend(right);
    Ok(())
}

fn look(stage: &Stage, scenes: &SceneCache, glance: &Glance) -> Result<Seen, Blind> {
    let (assets, _) = stage.scene(&glance.scene, scenes).map_err(blind)?;
    let rules = stage.rules();
    let camera = Camera {
        eye: glance.pose.position + Vector3::y() * rules.camera_height_m,
        world_from_camera: angle::about_up(glance.pose.heading_rad),
        width: glance.width,
        height: glance.height,
        hfov_rad: glance.hfov_rad,
        depth_max_m: rules.depth_max_m,
    };
    let frame = assets.render(&camera);
    Ok(Seen { rgb: frame.rgb, depth_m: frame.depth, depth_max_m: rules.depth_max_m })
}
