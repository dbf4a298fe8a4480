//! Trace lines from the agent's state.

use crate::candidate::{Candidate, Decision, Stage};
use crate::memory::{PendingSubmit, StoreyMemory};
use crate::mission::MissionState;
use crate::preset::Ablation;
use crate::verify::SubmitGate;
use crate::weights::Weights;
use avln_client::{Action, GoalCue, Mission, Observation};
use avln_kit::geometry::FloorPoint;
use avln_kit::hearing::{HeardSound, SoundSchedule};
use avln_kit::map::{CELL_M, Cell, ObjectHypothesis, Occupancy};
use avln_kit::perception::DetectedObject;
use serde::Serialize;
use std::fmt::Write;
use std::ops::Range;

const FORMAT: u32 = 2;
/// Words per object in a map line.
const WORDS: usize = 3;

/// The agent's state that traces describe.
pub(crate) struct TraceInput<'a> {
    pub(crate) weights: &'a Weights,
    pub(crate) ablation: Ablation,
    pub(crate) memory: &'a StoreyMemory,
    pub(crate) mission: &'a MissionState,
    pub(crate) schedule: &'a SoundSchedule,
    pub(crate) focus: Option<usize>,
    pub(crate) claimed: bool,
    pub(crate) outcome: Option<(PendingSubmit, bool)>,
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
    source: Option<usize>,
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
    source: Option<usize>,
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
        let sound = |(source, HeardSound { itd_s, level })| HeardLine { source, itd_s, level };
        Self {
            step: observation.step,
            pose: PoseLine {
                position_m: observation.pose.position(),
                heading_rad: observation.pose.heading_rad(),
            },
            heard: decision.heard.map(sound),
            sources: agent.sources().map(|source| SourceLine::of(agent, source)).collect(),
            focus: agent.focus,
            stage: decision.stage,
            candidate: decision.candidate.map(|candidate| CandidateLine::of(agent, &candidate)),
            gate: decision.gate,
            frontier: decision.frontier.map(|(place, score)| FrontierLine { place_m: xz(place), score }),
            action: action.to_string(),
        }
    }
}

impl TraceInput<'_> {
    /// Returns the estimated sources.
    fn sources(&self) -> Range<usize> {
        0..if self.weights.switches.source_positions { self.memory.sources.len() } else { 0 }
    }

    fn is_silent(&self, source: usize) -> bool {
        self.weights.switches.count_windows && self.schedule.is_silent(source)
    }
}

impl SourceLine {
    fn of(agent: &TraceInput, index: usize) -> Self {
        let source = &agent.memory.sources[index];
        Self {
            place_m: source.estimate.map(|estimate| xz(estimate.place)),
            certainty: source.estimate.map(|estimate| estimate.certainty),
            is_silent: agent.is_silent(index),
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
            solid: BoxLine::of(&agent.memory.objects.all()[object].detection),
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
        let objects = agent.memory.objects.all().iter().enumerate();
        let note = |(index, object)| ObjectLine::new(index, object, agent.mission.goals());
        Self { step, plan: MapGrid::of(&agent.memory.map), objects: objects.map(note).collect() }
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
    silent: Vec<bool>,
    located: Vec<bool>,
    /// Outcome and claim of this step only.
    made: Vec<TraceEvent>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub(crate) enum TraceEvent {
    Found { source: Option<usize>, goal: usize, object: Option<usize> },
    Missed { source: Option<usize>, goal: usize, object: Option<usize> },
    Silenced { source: usize },
    Located { source: usize },
    Stage { stage: Stage },
    Focus { source: Option<usize> },
    Claimed { source: Option<usize>, goal: usize, object: usize },
}

impl TracedState {
    pub(crate) fn of(agent: &TraceInput) -> Self {
        let is_located = |source: usize| {
            !agent.is_silent(source) && agent.memory.sources[source].is_located(agent.weights)
        };
        let outcome = agent.outcome.map(|(pending, found)| pending.settled(found));
        let claim = agent.decision.candidate.filter(|_| agent.claimed).map(|candidate| {
            let Candidate { source, goal, object, .. } = candidate;
            TraceEvent::Claimed { source, goal, object }
        });
        Self {
            stage: agent.decision.stage,
            focus: agent.focus,
            silent: (0..agent.memory.sources.len()).map(|source| agent.is_silent(source)).collect(),
            located: agent.sources().map(is_located).collect(),
            made: outcome.into_iter().chain(claim).collect(),
        }
    }

    /// Returns the changes up to `next`: new information first, then decisions.
    pub(crate) fn until(&self, next: &Self) -> Vec<TraceEvent> {
        let is_claim = |event: &&TraceEvent| matches!(event, TraceEvent::Claimed { .. });
        let outcome = next.made.iter().filter(|event| !is_claim(event)).copied();
        let silenced = risen(&self.silent, &next.silent).map(|source| TraceEvent::Silenced { source });
        let located = risen(&self.located, &next.located).map(|source| TraceEvent::Located { source });
        let stage = next.stage.filter(|_| self.stage != next.stage).map(|stage| TraceEvent::Stage { stage });
        let focus = (self.focus != next.focus).then_some(TraceEvent::Focus { source: next.focus });
        let claims = next.made.iter().filter(is_claim).copied();
        outcome.chain(silenced).chain(located).chain(stage).chain(focus).chain(claims).collect()
    }
}

impl PendingSubmit {
    fn settled(self, is_found: bool) -> TraceEvent {
        let Self { goal, object, source, .. } = self;
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
