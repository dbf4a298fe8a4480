use crate::map::{Cell, Estimate, Occupancy, SoundField, SourceBelief, range_m};
use crate::perception::{Ear, Heard, Stand, View};
use crate::planner::{Motion, Turns, Weights, path};
use avln_client::{Action, Agent, Feedback, Mission, Observation, TaskSpec};

/// Steps of sound whose mean tells how loud it is here.
const RECENT: usize = 3;
/// How far beyond everything seen sources may be, metres.
const AROUND_M: f32 = 3.0;
/// Within this distance of a believed source the way to it ends, metres.
const REACH_M: f32 = 0.5;

/// The reference agent of the paper (section 4): hears where targets are, maps the way, looks at what it found and
/// claims it. Training-free; forgets everything between episodes.
pub struct PagNav {
    weights: Weights,
    ear: Ear,
    view: View,
    map: Occupancy,
    field: Option<SoundField>,
    motion: Motion,
    turns: Turns,
    sources: Vec<Source>,
    focus: Option<usize>,
    claim: Option<Claim>,
    levels: Vec<f32>,
}

/// What is known of one sounding target.
#[derive(Default)]
struct Source {
    belief: SourceBelief,
    estimate: Option<Estimate>,
    wrong_submits: i32,
}

/// A Submit whose outcome is not known yet.
struct Claim {
    source: usize,
    level: f32,
}

impl Default for PagNav {
    fn default() -> Self {
        Self::new(Weights::default())
    }
}

impl PagNav {
    /// An agent that has played nothing yet.
    pub fn new(weights: Weights) -> Self {
        let task = TaskSpec::default();
        Self {
            weights,
            ear: Ear::default(),
            view: View::new(&task),
            map: Occupancy::default(),
            field: None,
            motion: Motion::new(&task),
            turns: Turns::new(0, task.sounding_window_steps),
            sources: Vec::new(),
            focus: None,
            claim: None,
            levels: Vec::new(),
        }
    }

    /// Takes in one observation.
    fn perceive(&mut self, observation: &Observation, stand: &Stand) {
        self.motion.feel(stand, &mut self.map);
        if let Some(depth) = &observation.depth {
            self.map.see(&self.view, stand, depth);
        }
        let heard = observation.audio.as_ref().and_then(|audio| self.ear.hear(audio));
        self.settle(observation.feedback, heard.as_ref());
        if let (Some(source), Some(heard)) = (self.turns.next(), heard) {
            self.listen(source, stand, &heard);
        }
    }

    /// Finds out what became of the last Submit: a target that was found falls silent.
    fn settle(&mut self, feedback: Feedback, heard: Option<&Heard>) {
        let Some(claim) = self.claim.take() else { return };
        let fell_silent = heard.is_none_or(|heard| heard.level < self.weights.found_level * claim.level);
        let found = match feedback {
            Feedback::Verdict(found) => found,
            Feedback::None | Feedback::Accepted => fell_silent,
        };
        if found {
            self.turns.silence(claim.source);
            self.focus = None;
        } else {
            self.sources[claim.source].wrong_submits += 1;
        }
    }

    fn listen(&mut self, index: usize, stand: &Stand, heard: &Heard) {
        if self.turns.is_first() {
            self.levels.clear();
        }
        self.levels.push(heard.level);
        let (map, source) = (&self.map, &mut self.sources[index]);
        let field = self.field.take().filter(|field| field.listener() == stand.place);
        let field = field.unwrap_or_else(|| SoundField::new(map, stand.place, map.area(AROUND_M)));
        source.belief.hear(&field, stand, heard);
        source.estimate = source.belief.estimate(&field, |place| map.is_free(Cell::at(place)));
        self.field = Some(field);
    }

    /// Level of the current source here, over the last steps.
    fn level(&self) -> f32 {
        let recent = &self.levels[self.levels.len().saturating_sub(RECENT)..];
        recent.iter().sum::<f32>() / recent.len().max(1) as f32
    }

    fn decide(&mut self, observation: &Observation, stand: &Stand) -> Action {
        if observation.remaining_steps <= 1 {
            return Action::Stop;
        }
        let Some((focus, estimate)) = self.choose(stand) else { return Action::TurnLeft };
        let way = path(&self.map, stand.place, estimate.place, REACH_M);
        let step = self.motion.along(&way, stand, &self.map);
        if self.is_near(focus, &estimate, stand, step.is_none()) {
            return match self.motion.toward(stand.bearing_rad(estimate.place)) {
                Some(turn) if stand.bearing_rad(estimate.place).abs() > self.weights.submit_rad => turn,
                _ => self.submit(focus),
            };
        }
        step.unwrap_or(Action::TurnLeft)
    }

    /// The source to head for: the one that can be claimed first.
    fn choose(&mut self, stand: &Stand) -> Option<(usize, Estimate)> {
        let cost = |index: usize, estimate: &Estimate| {
            let walk_steps = estimate.place.distance_m(stand.place) * self.weights.steps_per_m;
            let loyalty = if self.focus == Some(index) { self.weights.loyalty_steps } else { 0.0 };
            walk_steps.max(self.turns.wait_steps(index) as f32) - loyalty
        };
        let open = self.sources.iter().enumerate().filter(|(index, _)| !self.turns.is_silent(*index));
        let heard = open.filter_map(|(index, source)| Some((index, source.estimate?)));
        let best = heard.min_by(|a, b| cost(a.0, &a.1).total_cmp(&cost(b.0, &b.1)));
        self.focus = best.map(|(index, _)| index);
        best
    }

    /// The gate of the paper: near enough, sure enough, and loud enough to be in sight.
    fn is_near(&self, index: usize, estimate: &Estimate, stand: &Stand, at_end: bool) -> bool {
        let weights = &self.weights;
        let nearer = weights.nearer.powi(self.sources[index].wrong_submits);
        let limit_m = nearer * if at_end { weights.submit_blocked_m } else { weights.submit_m };
        self.turns.current() == index
            && self.levels.len() >= RECENT
            && estimate.certainty >= weights.submit_certainty
            && estimate.place.distance_m(stand.place) <= limit_m
            && range_m(self.level()) <= weights.submit_range_m
            && self.map.is_clear(stand.place, estimate.place, 0.8)
    }

    fn submit(&mut self, source: usize) -> Action {
        self.claim = Some(Claim { source, level: self.level() });
        Action::Submit
    }
}

impl Agent for PagNav {
    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        *self = Self {
            view: View::new(task),
            motion: Motion::new(task),
            turns: Turns::new(mission.goals.len(), task.sounding_window_steps),
            sources: mission.goals.iter().map(|_| Source::default()).collect(),
            ..Self::new(self.weights.clone())
        };
    }

    fn act(&mut self, observation: &Observation) -> Action {
        let stand = Stand::new(&observation.pose);
        self.perceive(observation, &stand);
        let action = self.decide(observation, &stand);
        self.motion.note(action, &stand);
        action
    }
}
