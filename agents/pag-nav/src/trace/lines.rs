//! Trace lines from the agent's state.

use crate::candidate::{Candidate, Decision, Stage, SubmitGate};
use crate::goals::{PendingSubmit, SourceMemory};
use crate::weights::{Ablation, Weights};
use avln_client::{Action, GoalCue, Mission, Observation, Pose};
use avln_kit::geometry::FloorPoint;
use avln_kit::hearing::{HeardSound, SoundSchedule};
use avln_kit::map::{CELL_M, Cell, ObjectHypothesis, ObjectMemory, Occupancy};
use avln_kit::perception::DetectedObject;
use serde::Serialize;
use std::fmt::Write;

const FORMAT: u32 = 1;
/// Words per object in a map line.
const WORDS: usize = 3;

/// The agent's state that traces describe.
pub(crate) struct TraceInput<'a> {
    pub(crate) weights: &'a Weights,
    pub(crate) ablation: Ablation,
    pub(crate) map: &'a Occupancy,
    pub(crate) objects: &'a ObjectMemory,
    pub(crate) goals: usize,
    pub(crate) sources: &'a [SourceMemory],
    pub(crate) schedule: &'a SoundSchedule,
    pub(crate) focus: Option<usize>,
    pub(crate) pending: Option<PendingSubmit>,
    pub(crate) decision: &'a Decision,
}

#[derive(Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub(crate) enum TraceLine<'a> {
    Mission(MissionLine<'a>),
    Step(StepLine),
    Event {
        step: u32,
        #[serde(flatten)]
        event: TraceEvent,
    },
    Map(MapLine),
}

/// The first line: mission and settings.
#[derive(Serialize)]
pub(crate) struct MissionLine<'a> {
    format: u32,
    episode: &'a str,
    agent: &'static str,
    version: &'static str,
    order: String,
    goals: Vec<GoalLine<'a>>,
    ablation: Ablation,
    weights: &'a Weights,
}

#[derive(Serialize)]
#[serde(rename_all = "snake_case")]
enum GoalLine<'a> {
    Category(&'a str),
    Description(&'a str),
    Image { width: u32, height: u32 },
}

/// A step: observation, beliefs and action.
#[derive(Serialize)]
pub(crate) struct StepLine {
    step: u32,
    pose: PoseLine,
    heard: Option<HeardLine>,
    sources: Vec<SourceLine>,
    focus: Option<usize>,
    stage: Option<Stage>,
    candidate: Option<CandidateLine>,
    gate: Option<SubmitGate>,
    frontier: Option<FrontierLine>,
    action: String,
}

#[derive(Serialize)]
struct PoseLine {
    position_m: [f32; 3],
    heading_rad: f32,
}

#[derive(Serialize)]
struct HeardLine {
    source: usize,
    itd_s: f32,
    level: f32,
}

#[derive(Serialize)]
struct SourceLine {
    place_m: Option<[f32; 2]>,
    certainty: Option<f32>,
    is_silent: bool,
    looks: u32,
    sought_steps: u32,
}

#[derive(Serialize)]
struct CandidateLine {
    goal: usize,
    object: usize,
    source: usize,
    place_m: [f32; 2],
    #[serde(flatten)]
    solid: BoxLine,
    vis: f32,
    context: f32,
    sound: f32,
    score: f32,
}

#[derive(Serialize)]
struct FrontierLine {
    place_m: [f32; 2],
    score: f32,
}

/// A box: x and z in the frame of poses, y above the floor.
#[derive(Serialize)]
pub(crate) struct BoxLine {
    min_m: [f32; 3],
    max_m: [f32; 3],
}

impl<'a> MissionLine<'a> {
    pub(crate) fn new(agent: &'a TraceInput<'a>, mission: &'a Mission, episode: &'a str) -> Self {
        Self {
            format: FORMAT,
            episode,
            agent: env!("CARGO_PKG_NAME"),
            version: env!("CARGO_PKG_VERSION"),
            order: mission.order.to_string(),
            goals: mission.goals.iter().map(GoalLine::of).collect(),
            ablation: agent.ablation,
            weights: agent.weights,
        }
    }
}

impl<'a> GoalLine<'a> {
    fn of(cue: &'a GoalCue) -> Self {
        match cue {
            GoalCue::Category(label) => Self::Category(label),
            GoalCue::Description(sentence) => Self::Description(sentence),
            GoalCue::Image(image) => Self::Image { width: image.width, height: image.height },
        }
    }
}

impl StepLine {
    pub(crate) fn new(agent: &TraceInput, observation: &Observation, action: Action) -> Self {
        let decision = agent.decision;
        let Pose { position, heading_rad } = observation.pose;
        let sound = |(source, HeardSound { itd_s, level })| HeardLine { source, itd_s, level };
        Self {
            step: observation.step,
            pose: PoseLine { position_m: position, heading_rad },
            heard: decision.heard.map(sound),
            sources: (0..agent.sources.len()).map(|source| SourceLine::of(agent, source)).collect(),
            focus: agent.focus,
            stage: decision.stage,
            candidate: decision.candidate.map(|candidate| CandidateLine::of(agent, &candidate)),
            gate: decision.gate,
            frontier: decision.frontier.map(|(place, score)| FrontierLine { place_m: xz(place), score }),
            action: action.to_string(),
        }
    }
}

impl SourceLine {
    fn of(agent: &TraceInput, index: usize) -> Self {
        let source = &agent.sources[index];
        Self {
            place_m: source.estimate.map(|estimate| xz(estimate.place)),
            certainty: source.estimate.map(|estimate| estimate.certainty),
            is_silent: agent.schedule.is_silent(index),
            looks: source.looks,
            sought_steps: source.sought_steps,
        }
    }
}

impl CandidateLine {
    fn of(agent: &TraceInput, candidate: &Candidate) -> Self {
        let &Candidate { goal, object, source, place, evidence } = candidate;
        Self {
            goal,
            object,
            source,
            place_m: xz(place),
            solid: BoxLine::of(&agent.objects.all()[object].detection),
            vis: evidence.vis,
            context: evidence.context,
            sound: evidence.sound,
            score: evidence.score(agent.weights),
        }
    }
}

impl BoxLine {
    pub(crate) fn of(detection: &DetectedObject) -> Self {
        let solid = |corner: FloorPoint, y: f32| [corner.x, y, corner.z];
        Self { min_m: solid(detection.min, detection.low_m), max_m: solid(detection.max, detection.high_m) }
    }
}

pub(crate) fn xz(place: FloorPoint) -> [f32; 2] {
    [place.x, place.z]
}

#[derive(Serialize)]
pub(crate) struct MapLine {
    step: u32,
    #[serde(flatten)]
    plan: MapGrid,
    objects: Vec<ObjectLine>,
}

/// The floor plan as run-length encoded rows of cells.
#[derive(Serialize)]
pub(crate) struct MapGrid {
    cell_m: f32,
    /// The first cell's lowest corner.
    min_m: [f32; 2],
    pub(crate) columns: u32,
    pub(crate) rows: u32,
    pub(crate) cells: String,
}

#[derive(Serialize)]
struct ObjectLine {
    object: usize,
    #[serde(flatten)]
    solid: BoxLine,
    /// The likeliest categories with their probabilities.
    words: Vec<(String, f32)>,
    /// Visual compatibility with each goal.
    vis: Vec<f32>,
    looks: u32,
    views: u32,
    wrong_submits: i32,
}

impl MapLine {
    pub(crate) fn new(agent: &TraceInput, step: u32) -> Self {
        let objects = agent.objects.all().iter().enumerate();
        let note = |(index, object)| ObjectLine::new(index, object, agent.goals);
        Self { step, plan: MapGrid::of(agent.map), objects: objects.map(note).collect() }
    }
}

impl MapGrid {
    pub(crate) fn of(map: &Occupancy) -> Self {
        // The map is a square around the start: the start's cell gives the size.
        let last = 2 * Cell::at(Default::default()).column - 1;
        let inside = |cell: Cell| Cell { column: cell.column.clamp(0, last), row: cell.row.clamp(0, last) };
        let [low, high] = map.area(0.0).map(|corner| inside(Cell::at(corner)));
        let rows = low.row..=high.row;
        let cells = rows.flat_map(|row| (low.column..=high.column).map(move |column| Cell { column, row }));
        let [x, z] = xz(low.center());
        Self {
            cell_m: CELL_M,
            min_m: [x - 0.5 * CELL_M, z - 0.5 * CELL_M],
            columns: low.column.abs_diff(high.column) + 1,
            rows: low.row.abs_diff(high.row) + 1,
            cells: runs(cells.map(|cell| state(map, cell))),
        }
    }
}

impl ObjectLine {
    fn new(index: usize, object: &ObjectHypothesis, goals: usize) -> Self {
        let detection = &object.detection;
        let mut words = detection.kinds.clone();
        words.sort_by(|a, b| b.1.total_cmp(&a.1));
        words.truncate(WORDS);
        Self {
            object: index,
            solid: BoxLine::of(detection),
            words,
            vis: (0..goals).map(|goal| object.vis(goal)).collect(),
            looks: object.looks,
            views: detection.views,
            wrong_submits: object.wrong_submits,
        }
    }
}

/// Returns a cell's letter: wall, lower obstacle, free floor or unknown.
fn state(map: &Occupancy, cell: Cell) -> char {
    match cell {
        cell if map.is_wall(cell) => 'w',
        cell if map.is_obstacle(cell) => 'o',
        cell if map.is_free(cell) => 'f',
        _ => 'u',
    }
}

/// Run-length encodes letters: `uuuf` becomes `3u1f`.
pub(crate) fn runs(letters: impl Iterator<Item = char>) -> String {
    let mut text = String::new();
    let mut letters = letters.peekable();
    while let Some(letter) = letters.next() {
        let mut count = 1;
        while letters.next_if_eq(&letter).is_some() {
            count += 1;
        }
        let _ = write!(text, "{count}{letter}");
    }
    text
}

/// The rarely changing state.
#[derive(Clone, Default)]
pub(crate) struct TracedState {
    stage: Option<Stage>,
    focus: Option<usize>,
    pending: Option<PendingSubmit>,
    silent: Vec<bool>,
    located: Vec<bool>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub(crate) enum TraceEvent {
    Found { source: usize, goal: usize, object: usize },
    Missed { source: usize, goal: usize, object: usize },
    Silenced { source: usize },
    Located { source: usize },
    Stage { stage: Stage },
    Focus { source: Option<usize> },
    Claimed { source: usize, goal: usize, object: usize },
}

impl TracedState {
    pub(crate) fn of(agent: &TraceInput) -> Self {
        let sources = 0..agent.sources.len();
        let is_located = |source: usize| {
            let memory = &agent.sources[source];
            !agent.schedule.is_silent(source) && memory.is_located(agent.weights)
        };
        Self {
            stage: agent.decision.stage,
            focus: agent.focus,
            pending: agent.pending,
            silent: sources.clone().map(|source| agent.schedule.is_silent(source)).collect(),
            located: sources.map(is_located).collect(),
        }
    }

    /// Returns the changes up to `next`: new information first, then decisions.
    pub(crate) fn until(&self, next: &Self) -> Vec<TraceEvent> {
        let settled = self
            .pending
            .filter(|_| next.pending.is_none())
            .map(|pending| pending.settled(next.silent.get(pending.source) == Some(&true)));
        let silenced = risen(&self.silent, &next.silent).map(|source| TraceEvent::Silenced { source });
        let located = risen(&self.located, &next.located).map(|source| TraceEvent::Located { source });
        let stage = next.stage.filter(|_| self.stage != next.stage).map(|stage| TraceEvent::Stage { stage });
        let focus = (self.focus != next.focus).then_some(TraceEvent::Focus { source: next.focus });
        let known = settled.into_iter().chain(silenced).chain(located);
        let made = next.pending.filter(|_| self.pending.is_none()).map(PendingSubmit::made);
        known.chain(stage).chain(focus).chain(made).collect()
    }
}

impl PendingSubmit {
    fn made(self) -> TraceEvent {
        TraceEvent::Claimed { source: self.source, goal: self.goal, object: self.object }
    }

    fn settled(self, is_found: bool) -> TraceEvent {
        let Self { source, goal, object, .. } = self;
        if is_found {
            TraceEvent::Found { source, goal, object }
        } else {
            TraceEvent::Missed { source, goal, object }
        }
    }
}

/// Returns the indices that changed from false to true.
fn risen(before: &[bool], after: &[bool]) -> impl Iterator<Item = usize> {
    let pairs = before.iter().zip(after).enumerate();
    pairs.filter(|(_, (before, after))| !**before && **after).map(|(index, _)| index)
}
