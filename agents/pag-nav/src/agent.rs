use crate::map::{Cell, Estimate, Occupancy, SoundField, SourceBelief, Things, range_m};
use crate::perception::{Ear, Heard, Layout, Place, Query, Stand, View, things};
use crate::planner::{Goals, Motion, Turns, Weights};
use avln_client::{Action, Agent, Feedback, Image, Mission, Observation, Order, TaskSpec};

/// How far beyond everything seen sources may be, metres.
const AROUND_M: f32 = 1.5;
/// The reference agent of the paper (section 4): hears where targets are, maps the way, looks at what it found and
/// claims it. Training-free; forgets everything between episodes.
pub struct PagNav {
    pub(crate) weights: Weights,
    ear: Ear,
    view: View,
    pub(crate) map: Occupancy,
    pub(crate) things: Things,
    field: Option<SoundField>,
    pub(crate) motion: Motion,
    pub(crate) turns: Turns,
    pub(crate) queries: Vec<Query>,
    pub(crate) goals: Goals,
    pub(crate) sources: Vec<Source>,
    /// The source that the agent heads for.
    pub(crate) focus: Option<usize>,
    pub(crate) claim: Option<Claim>,
    /// Levels of the source that sounds, since its turn began.
    pub(crate) levels: Vec<f32>,
}

/// What is known of one sounding target.
#[derive(Default)]
pub(crate) struct Source {
    belief: SourceBelief,
    pub(crate) estimate: Option<Estimate>,
    pub(crate) wrong_submits: i32,
    /// Loudest that it was heard (the intensity memory of the paper).
    loudest: f32,
    /// Pictures that showed the place from nearby, and the place that they showed.
    pub(crate) looks: u32,
    looked_at: Place,
    /// Steps for which the agent has headed for it.
    pub(crate) sought_steps: u32,
    /// How much the best of these pictures resembled the picture of each goal, 0 to 1.
    resemblance: Vec<f32>,
}

/// A Submit whose outcome is not known yet.
pub(crate) struct Claim {
    pub(crate) source: usize,
    pub(crate) level: f32,
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
            things: Things::default(),
            field: None,
            motion: Motion::new(&task),
            turns: Turns::new(0, task.sounding_window_steps),
            queries: Vec::new(),
            goals: Goals::new(0, false),
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
        if let (Some(image), Some(depth)) = (&observation.rgb, &observation.depth) {
            let map = &self.map;
            self.things.see(things(&self.view, stand, image, depth, |place| map.is_wall(Cell::at(place))));
            self.look(stand, image);
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
            self.goals.found(claim.source);
            self.focus = None;
        } else {
            self.goals.missed(claim.source);
            self.sources[claim.source].wrong_submits += 1;
        }
    }

    /// Compares what is before the camera at the believed sources with the goals.
    fn look(&mut self, stand: &Stand, image: &Image) {
        let layout = Layout::of(image);
        for (index, source) in self.sources.iter_mut().enumerate() {
            let Some(estimate) = source.estimate.filter(|e| e.certainty >= self.weights.submit_certainty)
            else {
                continue;
            };
            let is_loud = range_m(source.loudest) <= self.weights.look_range_m;
            if !is_loud || !is_in_view(stand, &self.map, &estimate) {
                continue;
            }
            source.look_at(estimate.place, self.queries.len());
            for (goal, query) in self.queries.iter().enumerate() {
                let mut fit = self.things.fit(estimate.place, query).unwrap_or(0.0);
                if let Query::Picture { layout: wanted, .. } = query {
                    let best = &mut source.resemblance[goal];
                    *best = best.max(layout.likeness(wanted));
                    fit = self.weights.middle * fit + self.weights.layout * *best;
                }
                self.goals.see(index, goal, fit);
            }
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
        source.loudest = source.loudest.max(heard.level);
        source.belief.hear(&field, stand, heard);
        source.estimate = source.belief.estimate(&field, map);
        self.field = Some(field);
    }
}

impl Agent for PagNav {
    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        *self = Self {
            view: View::new(task),
            motion: Motion::new(task),
            turns: Turns::new(mission.goals.len(), task.sounding_window_steps),
            queries: mission.goals.iter().map(Query::new).collect(),
            goals: Goals::new(mission.goals.len(), mission.order == Order::Ordered),
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

impl Source {
    /// Counts a look; looks at another place than this do not count.
    fn look_at(&mut self, place: Place, goals: usize) {
        const SAME_M: f32 = 1.0;
        if self.looks == 0 || self.looked_at.distance_m(place) > SAME_M {
            (self.looks, self.resemblance) = (0, vec![0.0; goals]);
            self.looked_at = place;
        }
        self.looks += 1;
    }
}

/// Whether a place lies before the camera, near and not behind a wall.
fn is_in_view(stand: &Stand, map: &Occupancy, estimate: &Estimate) -> bool {
    const NEAR_M: f32 = 2.8;
    const ASIDE_RAD: f32 = 0.6;
    estimate.place.distance_m(stand.place) <= NEAR_M
        && stand.bearing_rad(estimate.place).abs() <= ASIDE_RAD
        && map.hears(stand.place, estimate.place)
}
