//! Episode pages and replays.

use crate::{
    database::{Transaction, value},
    error::Result,
    facts::{Facts, read_facts},
    phases::{SceneMap, read_heads},
    runs::Run,
    views::{
        Reader, Viewer,
        run::{EpisodeRow, RunLine, Sight, find_run, read_episodes, read_line},
    },
};
use avln_challenge::{EpisodeState, GoalText, TimeAccount};
use avln_episode::{EndReason, Modality, Order, Point3, Pose, Rules, Sensors};
use avln_scoring::Metrics;
use avln_truth::Target;
use serde::Serialize;
use sqlx::types::Json;

/// A run's episode. Data hidden from the viewer is `None`.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
pub struct EpisodeView {
    /// The run.
    pub run: RunLine,
    /// Index in the run, from 0.
    pub ordinal: u32,
    /// Episode state.
    pub state: EpisodeState,
    /// End reason.
    pub end: Option<EndReason>,
    /// Metrics; `None` if not scored, or if replays are hidden, because the lengths reveal the targets.
    pub metrics: Option<Metrics>,
    /// The mission; `None` if scores are hidden.
    pub mission: Option<MissionView>,
    /// Wall-clock time by activity; whole seconds if replays are hidden.
    pub time: TimeAccount,
    /// Result time, milliseconds since 1970-01-01 UTC.
    pub finished_unix_ms: Option<i64>,
    /// The replay; `None` if hidden, not played yet or pruned.
    pub replay: Option<Replay>,
}

/// A mission in words.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
pub struct MissionView {
    /// Goal order.
    pub order: Order,
    /// Goals in mission order.
    pub goals: Vec<GoalView>,
}

/// A mission's goal.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
pub struct GoalView {
    /// Cue kind.
    pub modality: Modality,
    /// The label or sentence; `None` for an image, or if replays are hidden.
    pub text: Option<String>,
    /// The step that found it, counted from 1; `None` if it was not found.
    pub found_at_step: Option<u32>,
    /// Geodesic distance from the last pose to the success region, metres; `None` if unreachable or not played yet.
    pub final_distance_m: Option<f64>,
}

/// An episode's poses, actions and targets: world frame, Y up, metres, radians.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
pub struct Replay {
    /// Episode id inside the split.
    pub episode: String,
    /// Scene name.
    pub scene: String,
    /// Rules in force.
    pub rules: Rules,
    /// Sensors requested in the last session.
    pub sensors: Option<Sensors>,
    /// True if any session requested audio.
    pub hears: bool,
    /// Floor plan.
    pub map: SceneMap,
    /// Base positions before the first action and after every action; x, y, z.
    pub path: Vec<[f32; 3]>,
    /// Headings at the same times; 0 faces -Z, positive turns left.
    pub headings_rad: Vec<f32>,
    /// Words of the actions, one fewer than positions.
    pub actions: Vec<String>,
    /// Steps with a collision, counted from 1.
    pub collisions: Vec<u32>,
    /// Sounding source in every step, from 0: a goal, or a distractor from the goal count on; `None` for silence.
    pub sounding: Vec<Option<u8>>,
    /// Per step a bit for every goal, set inside the success region.
    pub in_region: Vec<u8>,
    /// Submits and claiming Stops.
    pub submits: Vec<SubmitMark>,
    /// Targets in mission order.
    pub targets: Vec<TargetView>,
    /// Reference path; x, y, z.
    pub reference_path: Vec<[f32; 3]>,
}

/// A Submit or a claiming Stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, utoipa::ToSchema)]
pub struct SubmitMark {
    /// Step, counted from 1; also the path index.
    pub step: u32,
    /// Completed goal, from 0.
    pub completed: Option<u8>,
    /// Goal with a wrong instance from the right category at this position.
    pub wrong_instance: Option<u8>,
}

/// A target.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
pub struct TargetView {
    /// Instance category.
    pub category: String,
    /// Cue kind.
    pub modality: Modality,
    /// Bounding-box centre; x, y, z.
    pub position: [f32; 3],
    /// Bounding-box minimum corner.
    pub min: [f32; 3],
    /// Bounding-box maximum corner.
    pub max: [f32; 3],
    /// Position of the sound source.
    pub source: [f32; 3],
    /// Floor height, metres.
    pub floor_y_m: f32,
}

impl Reader {
    /// Returns a run's episode; `None` if there is none visible to the viewer.
    pub async fn episode(&self, viewer: &Viewer, run: &str, ordinal: u32) -> Result<Option<EpisodeView>> {
        let mut tx = self.snapshot().await?;
        let Some((run, sight)) = find_run(&mut tx, viewer, run).await? else { return Ok(None) };
        let Some(row) = read_episodes(&mut tx, &run.id, Some(ordinal)).await?.pop() else { return Ok(None) };
        // Facts hold the targets: they are not even read for a viewer without access to replays.
        let facts = if sight.replays { read_facts(&mut tx, &run.id, ordinal).await? } else { None };
        let replay = match facts {
            Some(facts) => read_replay(&mut tx, &run, &row, facts).await?,
            None => None,
        };
        let goals = read_goals(&mut tx, &run.phase, &row.episode).await?;
        let time = if sight.replays { row.time() } else { row.time().rounded() };
        let metrics = row.metrics.filter(|_| sight.replays).map(|Json(metrics)| metrics);
        let order = run.order;
        let mission = MissionView { order, goals: goal_views(goals, metrics.as_ref(), sight) };
        Ok(Some(EpisodeView {
            run: read_line(&mut tx, &run.id, sight).await?,
            ordinal: row.ordinal,
            state: row.state.0,
            end: value(row.end_reason),
            mission: sight.scores.then_some(mission),
            metrics,
            time,
            finished_unix_ms: row.finished_ms,
            replay,
        }))
    }
}

async fn read_goals(tx: &mut Transaction<'_>, phase: &str, episode: &str) -> Result<Vec<GoalText>> {
    let select = "SELECT goals FROM phase_episodes WHERE phase = $1 AND episode = $2";
    let goals: Option<Json<Vec<GoalText>>> =
        sqlx::query_scalar(select).bind(phase).bind(episode).fetch_optional(&mut **tx).await?;
    Ok(goals.map(|Json(goals)| goals).unwrap_or_default())
}

async fn read_replay(
    tx: &mut Transaction<'_>,
    run: &Run,
    row: &EpisodeRow,
    facts: Facts,
) -> Result<Option<Replay>> {
    let Some(head) = read_heads(tx, Some(&run.phase)).await?.pop() else { return Ok(None) };
    let select = "SELECT map FROM scenes WHERE name = $1";
    let Json(map) = sqlx::query_scalar(select).bind(&row.scene).fetch_one(&mut **tx).await?;
    Ok(Some(replay(facts, head.phase.rules, map, run)))
}

fn goal_views(goals: Vec<GoalText>, metrics: Option<&Metrics>, sight: Sight) -> Vec<GoalView> {
    let view = |(index, goal): (usize, GoalText)| GoalView {
        modality: goal.modality,
        text: goal.text.filter(|_| sight.replays),
        found_at_step: metrics.and_then(|m| *m.steps_to_goal.get(index)?),
        final_distance_m: metrics.and_then(|m| *m.final_distance_m.get(index)?),
    };
    goals.into_iter().enumerate().map(view).collect()
}

fn replay(facts: Facts, rules: Rules, map: SceneMap, run: &Run) -> Replay {
    let Facts { truth, record } = facts;
    let steps = &record.steps;
    let poses: Vec<&Pose> =
        std::iter::once(&record.start).chain(steps.iter().map(|step| &step.pose)).collect();
    let collisions = (1_u32..).zip(steps).filter(|(_, step)| step.collided);
    let submits = record.submits.iter().map(|submit| SubmitMark {
        step: submit.step,
        completed: submit.completed,
        wrong_instance: submit.wrong_instance,
    });
    Replay {
        rules,
        sensors: run.sensors.clone(),
        hears: run.senses.as_ref().is_some_and(|senses| senses.audio),
        map,
        path: poses.iter().map(|pose| xyz(&pose.position)).collect(),
        headings_rad: poses.iter().map(|pose| pose.heading_rad).collect(),
        actions: steps.iter().map(|step| step.action.to_string()).collect(),
        collisions: collisions.map(|(number, _)| number).collect(),
        sounding: steps.iter().map(|step| step.sounding).collect(),
        in_region: steps.iter().map(|step| step.in_region).collect(),
        submits: submits.collect(),
        targets: truth.targets.iter().map(target_view).collect(),
        reference_path: truth.reference_path.iter().map(xyz).collect(),
        episode: truth.episode,
        scene: truth.scene,
    }
}

fn target_view(target: &Target) -> TargetView {
    TargetView {
        category: target.category.clone(),
        modality: target.modality,
        position: xyz(&target.bounds.center()),
        min: xyz(&target.bounds.min),
        max: xyz(&target.bounds.max),
        source: xyz(&target.source),
        floor_y_m: target.floor_y_m,
    }
}

fn xyz(point: &Point3<f32>) -> [f32; 3] {
    [point.x, point.y, point.z]
}
