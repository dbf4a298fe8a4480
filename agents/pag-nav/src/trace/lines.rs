use super::events::Event;
use super::map::MapLine;
use crate::planner::{Candidate, Gate, Stage};
use crate::{Ablation, PagNav, Weights};
use avln_client::{Action, GoalCue, Mission, Observation, Order, Pose};
use avln_kit::perception::{Place, Thing};
use serde::Serialize;

/// Version of the format.
const FORMAT: u32 = 1;

/// One line of a trace.
#[derive(Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub(super) enum Line<'a> {
    Mission(Opening<'a>),
    Step(Step),
    Event {
        step: u32,
        #[serde(flatten)]
        event: Event,
    },
    Map(MapLine),
}

/// What is written down once.
#[derive(Serialize)]
pub(super) struct Opening<'a> {
    format: u32,
    episode: &'a str,
    agent: &'static str,
    version: &'static str,
    order: &'static str,
    goals: Vec<Goal<'a>>,
    ablation: Ablation,
    weights: &'a Weights,
}

#[derive(Serialize)]
#[serde(rename_all = "snake_case")]
enum Goal<'a> {
    Category(&'a str),
    Description(&'a str),
    Image { width: u32, height: u32 },
}

/// What is written down at every step.
#[derive(Serialize)]
pub(super) struct Step {
    step: u32,
    pose: PoseNote,
    heard: Option<Sound>,
    sources: Vec<Track>,
    focus: Option<usize>,
    stage: Option<Stage>,
    candidate: Option<Choice>,
    gate: Option<GateNote>,
    frontier: Option<Frontier>,
    action: String,
}

#[derive(Serialize)]
struct PoseNote {
    position_m: [f32; 3],
    heading_rad: f32,
}

#[derive(Serialize)]
struct Sound {
    source: usize,
    itd_s: f32,
    level: f32,
}

/// What is believed of one source.
#[derive(Serialize)]
struct Track {
    place_m: Option<[f32; 2]>,
    certainty: Option<f32>,
    is_silent: bool,
    looks: u32,
    sought_steps: u32,
}

#[derive(Serialize)]
struct Choice {
    goal: usize,
    object: usize,
    source: usize,
    place_m: [f32; 2],
    #[serde(flatten)]
    solid: Solid,
    vis: f32,
    context: f32,
    sound: f32,
    score: f32,
}

#[derive(Serialize)]
struct GateNote {
    is_verified: bool,
    distance_m: f32,
    bearing_rad: f32,
}

#[derive(Serialize)]
struct Frontier {
    place_m: [f32; 2],
    score: f32,
}

/// A box: x and z in the frame of poses, y from the floor.
#[derive(Serialize)]
pub(super) struct Solid {
    min_m: [f32; 3],
    max_m: [f32; 3],
}

impl<'a> Opening<'a> {
    pub(super) fn new(agent: &'a PagNav, mission: &'a Mission, episode: &'a str) -> Self {
        Self {
            format: FORMAT,
            episode,
            agent: env!("CARGO_PKG_NAME"),
            version: env!("CARGO_PKG_VERSION"),
            order: match mission.order {
                Order::Ordered => "ordered",
                Order::Unordered => "unordered",
            },
            goals: mission.goals.iter().map(Goal::of).collect(),
            ablation: agent.ablation,
            weights: &agent.weights,
        }
    }
}

impl<'a> Goal<'a> {
    fn of(cue: &'a GoalCue) -> Self {
        match cue {
            GoalCue::Category(label) => Self::Category(label),
            GoalCue::Description(sentence) => Self::Description(sentence),
            GoalCue::Image(image) => Self::Image { width: image.width, height: image.height },
        }
    }
}

impl Step {
    pub(super) fn new(agent: &PagNav, observation: &Observation, action: Action) -> Self {
        let thought = &agent.thought;
        let Pose { position, heading_rad } = observation.pose;
        let sound = |(source, heard): (usize, avln_kit::perception::Heard)| Sound {
            source,
            itd_s: heard.itd_s,
            level: heard.level,
        };
        Self {
            step: observation.step,
            pose: PoseNote { position_m: position, heading_rad },
            heard: thought.heard.map(sound),
            sources: (0..agent.sources.len()).map(|source| Track::of(agent, source)).collect(),
            focus: agent.focus,
            stage: thought.stage,
            candidate: thought.candidate.map(|candidate| Choice::of(agent, &candidate)),
            gate: thought.gate.map(GateNote::of),
            frontier: thought.frontier.map(|(place, score)| Frontier { place_m: xz(place), score }),
            action: action.to_string(),
        }
    }
}

impl Track {
    fn of(agent: &PagNav, index: usize) -> Self {
        let source = &agent.sources[index];
        Self {
            place_m: source.estimate.map(|estimate| xz(estimate.place)),
            certainty: source.estimate.map(|estimate| estimate.certainty),
            is_silent: agent.turns.is_silent(index),
            looks: source.looks,
            sought_steps: source.sought_steps,
        }
    }
}

impl Choice {
    fn of(agent: &PagNav, candidate: &Candidate) -> Self {
        let &Candidate { goal, object, source, place, evidence } = candidate;
        Self {
            goal,
            object,
            source,
            place_m: xz(place),
            solid: Solid::of(&agent.objects.all()[object].thing),
            vis: evidence.vis,
            context: evidence.context,
            sound: evidence.sound,
            score: evidence.score(&agent.weights),
        }
    }
}

impl GateNote {
    fn of(gate: Gate) -> Self {
        let Gate { is_verified, distance_m, bearing_rad } = gate;
        Self { is_verified, distance_m, bearing_rad }
    }
}

impl Solid {
    pub(super) fn of(thing: &Thing) -> Self {
        let solid = |corner: Place, y: f32| [corner.x, y, corner.z];
        Self { min_m: solid(thing.min, thing.low_m), max_m: solid(thing.max, thing.high_m) }
    }
}

/// A place as it is written.
pub(super) fn xz(place: Place) -> [f32; 2] {
    [place.x, place.z]
}
