use super::{
    Reader, Viewer,
    run::{EpisodeRow, RunLine, Sight, find_run, line, read_episodes},
};
use crate::{
    EpisodeState, Facts, GoalText, Run, SceneMap, StoreError, TimeAccount,
    facts::read_facts,
    phases::read_heads,
    words::{count, end_reason, from_json},
};
use avln_episode::{EndReason, Modality, Order, Point3, Rules, Sensors};
use avln_scoring::Metrics;
use avln_truth::{SubmitFacts, Target};
use serde::Serialize;
use sqlx::{Sqlite, Transaction};

/// One episode of a run. What the viewer may not see is `None`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EpisodeView {
    /// The run.
    pub run: RunLine,
    /// Place in the phase's list, from 0.
    pub ordinal: u32,
    /// How far it is.
    pub state: EpisodeState,
    /// Why it ended.
    pub end: Option<EndReason>,
    /// What it was worth; `None` when not scored, or when replays are hidden: its lengths tell where the targets are.
    pub metrics: Option<Metrics>,
    /// The mission; `None` when scores are hidden.
    pub mission: Option<MissionView>,
    /// Where the time went.
    pub time: TimeAccount,
    /// When the result was stored, milliseconds since 1970-01-01 UTC.
    pub finished_unix_ms: Option<i64>,
    /// Where everything was; `None` when hidden or not played yet.
    pub replay: Option<Replay>,
}

/// A mission in words.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MissionView {
    /// How goals count.
    pub order: Order,
    /// The goals in the order of the mission.
    pub goals: Vec<GoalView>,
}

/// One goal of a mission.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GoalView {
    /// How it was told.
    pub modality: Modality,
    /// The label or sentence; `None` for a picture or when replays are hidden.
    pub text: Option<String>,
    /// The step that found it, counted from 1; `None` when it was not found.
    pub found_at_step: Option<u32>,
    /// Walk from the last pose to its region, metres; `None` when unreachable or not played yet.
    pub final_distance_m: Option<f64>,
}

/// Where everything was: world frame, Y up, metres, radians.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Replay {
    /// Id of the episode inside the split.
    pub episode: String,
    /// Name of the scene.
    pub scene: String,
    /// The rules that were in force.
    pub rules: Rules,
    /// What the agent asked to sense.
    pub sensors: Option<Sensors>,
    /// Whether the agent asked for sound, in this session or an earlier one.
    pub hears: bool,
    /// Floor plan.
    pub map: SceneMap,
    /// Positions of the base: before the first action and after each; x, y, z.
    pub path: Vec<[f32; 3]>,
    /// Headings at the same times; 0 looks along -Z, positive is to the left.
    pub headings_rad: Vec<f32>,
    /// Words of the actions, one fewer than positions.
    pub actions: Vec<String>,
    /// Steps in which an obstacle held the body back, counted from 1.
    pub collisions: Vec<u32>,
    /// Goal that sounded in each step, from 0; `None` in silence.
    pub sounding: Vec<Option<u8>>,
    /// For each step: bit i is set when the body then stood in the success region of goal i.
    pub in_region: Vec<u8>,
    /// The claims.
    pub submits: Vec<SubmitMark>,
    /// The targets in the order of the mission.
    pub targets: Vec<TargetView>,
    /// The reference tour; x, y, z.
    pub reference_path: Vec<[f32; 3]>,
}

/// A Submit or a Stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct SubmitMark {
    /// Step, counted from 1; also the index of its position in the path.
    pub step: u32,
    /// Goal that it completed, from 0.
    pub completed: Option<u8>,
    /// Goal that it would have completed if another instance of the target's category were the target.
    pub wrong_instance: Option<u8>,
}

/// A target.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TargetView {
    /// Category of the instance.
    pub category: String,
    /// How it was told.
    pub modality: Modality,
    /// Middle of its box; x, y, z.
    pub position: [f32; 3],
    /// Smallest corner of its box.
    pub min: [f32; 3],
    /// Largest corner of its box.
    pub max: [f32; 3],
    /// Where its sound comes from.
    pub source: [f32; 3],
    /// Height of the floor from which it can be reached, metres.
    pub floor_y_m: f32,
}

impl Reader {
    /// The episode at place `ordinal` of a run; `None` when there is none that the viewer may know of.
    ///
    /// # Errors
    /// When the database fails or holds damaged rows.
    pub async fn episode(
        &self,
        viewer: &Viewer,
        run: &str,
        ordinal: u32,
    ) -> Result<Option<EpisodeView>, StoreError> {
        let mut tx = self.snapshot().await?;
        let Some((run, sight)) = find_run(&mut tx, viewer, run).await? else { return Ok(None) };
        let Some(row) = read_episodes(&mut tx, &run.id, Some(ordinal)).await?.pop() else { return Ok(None) };
        let facts = if sight.replays { read_facts(&mut tx, &run.id, ordinal).await? } else { None };
        let replay = match facts {
            Some(facts) => read_replay(&mut tx, &run, &row, facts).await?,
            None => None,
        };
        let goals = read_goals(&mut tx, &run.phase, &row.episode).await?;
        let metrics = row.metrics.as_deref().filter(|_| sight.replays);
        let metrics: Option<Metrics> = metrics.map(|json| from_json("metrics", json)).transpose()?;
        let order = run.order;
        Ok(Some(EpisodeView {
            run: line(&mut tx, run, sight).await?,
            ordinal: count(row.ordinal),
            state: EpisodeState::from_word(&row.state)?,
            end: row.end_reason.as_deref().map(end_reason).transpose()?,
            mission: sight
                .scores
                .then(|| MissionView { order, goals: goal_views(goals, metrics.as_ref(), sight) }),
            metrics,
            time: row.time()?,
            finished_unix_ms: row.finished_ms,
            replay,
        }))
    }
}

async fn read_goals(
    tx: &mut Transaction<'_, Sqlite>,
    phase: &str,
    episode: &str,
) -> Result<Vec<GoalText>, StoreError> {
    let select = "SELECT goals FROM phase_episodes WHERE phase = $1 AND episode = $2";
    let json: Option<String> =
        sqlx::query_scalar(select).bind(phase).bind(episode).fetch_optional(&mut **tx).await?;
    json.map_or(Ok(vec![]), |json| from_json("goals", &json))
}

/// What happened, on its map and by its rules.
async fn read_replay(
    tx: &mut Transaction<'_, Sqlite>,
    run: &Run,
    row: &EpisodeRow,
    facts: Facts,
) -> Result<Option<Replay>, StoreError> {
    let Some(head) = read_heads(tx, Some(&run.phase)).await?.pop() else { return Ok(None) };
    let map = read_map(tx, row).await?;
    let hears = run.senses.as_ref().is_some_and(|senses| senses.audio);
    Ok(Some(Replay { sensors: run.sensors.clone(), hears, ..replay(facts, head.phase.rules, map) }))
}

async fn read_map(tx: &mut Transaction<'_, Sqlite>, row: &EpisodeRow) -> Result<SceneMap, StoreError> {
    let select = "SELECT map FROM scenes WHERE name = $1";
    let json: String = sqlx::query_scalar(select).bind(&row.scene).fetch_one(&mut **tx).await?;
    from_json("map", &json)
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

fn replay(facts: Facts, rules: Rules, map: SceneMap) -> Replay {
    let Facts { truth, record } = facts;
    let poses = || std::iter::once(&record.start).chain(record.steps.iter().map(|step| &step.pose));
    let numbered = || (1_u32..).zip(&record.steps);
    let mark = |submit: &SubmitFacts| {
        let SubmitFacts { step, completed, wrong_instance, .. } = *submit;
        SubmitMark { step, completed, wrong_instance }
    };
    Replay {
        rules,
        sensors: None,
        hears: false,
        map,
        path: poses().map(|pose| xyz(&pose.position)).collect(),
        headings_rad: poses().map(|pose| pose.heading_rad).collect(),
        actions: record.steps.iter().map(|step| step.action.to_string()).collect(),
        collisions: numbered().filter(|(_, step)| step.collided).map(|(number, _)| number).collect(),
        sounding: record.steps.iter().map(|step| step.sounding).collect(),
        in_region: record.steps.iter().map(|step| step.in_region).collect(),
        submits: record.submits.iter().map(mark).collect(),
        targets: truth.targets.iter().map(target).collect(),
        reference_path: truth.reference_path.iter().map(xyz).collect(),
        episode: truth.episode,
        scene: truth.scene,
    }
}

fn target(target: &Target) -> TargetView {
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
