use crate::Ablation;
use crate::planner::{Candidate, Evidence, Goals, Weights};
use crate::stairs::Flight;
use crate::trace::{Recorder, Thought};
use avln_client::{Action, Agent, Feedback, FeedbackRule, Mission, Observation, Order, TaskSpec};
use avln_kit::{
    Aftermath, Course, Hints, LOOK_M, Motion, Turns,
    map::{
        Cell, Elevation, Estimate, Intensity, Objects, Occupancy, SoundField, SourceBelief, Storeys, range_m,
    },
    perception::{Classical, Ear, Heard, Place, Query, Recognition, Sight, Stand, View},
};
use std::{mem, sync::Arc};

/// How far beyond everything seen sources may be, metres.
const AROUND_M: f32 = 1.5;
/// Steps of sound whose mean tells how loud it is here.
const RECENT: usize = 3;

/// The reference agent of the paper (section 4): hears where targets are, maps the way, looks at the things there and
/// submits those that pass its visual gate. Training-free; forgets everything between episodes.
pub struct PagNav {
    pub(crate) weights: Weights,
    pub(crate) ablation: Ablation,
    perception: Box<dyn Recognition>,
    hints: Option<Arc<dyn Hints>>,
    ear: Ear,
    view: View,
    pub(crate) map: Occupancy,
    pub(crate) objects: Objects,
    storeys: Storeys<Memory>,
    pub(crate) elevation: Elevation,
    /// Stairs that it is on.
    pub(crate) flight: Option<Flight>,
    /// Where what seemed to be stairs was none.
    pub(crate) false_stairs: Vec<Place>,
    /// How high the body is above its start, metres.
    pub(crate) height_m: f32,
    /// What a turn turns it by, radians.
    pub(crate) turn_rad: f32,
    field: Option<SoundField>,
    pub(crate) motion: Motion,
    /// Ways to what it heads for, and to frontiers.
    pub(crate) course: Course,
    pub(crate) scouting: Course,
    /// The frontier that it keeps to, its score, and for how many steps.
    pub(crate) frontier: Option<(Place, f32, u32)>,
    pub(crate) turns: Turns,
    pub(crate) queries: Vec<Query>,
    pub(crate) goals: Goals,
    pub(crate) sources: Vec<Source>,
    /// The source that the agent heads for.
    pub(crate) focus: Option<usize>,
    pub(crate) claim: Option<Claim>,
    /// Levels of the source that sounds, since its turn began.
    levels: Vec<f32>,
    /// Whether the rules tell what became of a Submit.
    is_told: bool,
    pub(crate) remaining_steps: u32,
    /// What the last action was decided by.
    pub(crate) thought: Thought,
    pub(crate) trace: Option<Recorder>,
}

/// What is remembered of one storey.
struct Memory {
    map: Occupancy,
    objects: Objects,
    sources: Vec<Source>,
}

impl Memory {
    /// Nothing yet, in a mission of `goals` goals.
    fn of(goals: usize) -> Self {
        let sources = (0..goals).map(|_| Source::default()).collect();
        Self { map: Occupancy::default(), objects: Objects::new(goals), sources }
    }
}

/// What is known of one sounding target, as it is heard on one storey: the audio memories A_bear and A_int of the paper.
#[derive(Default)]
pub(crate) struct Source {
    belief: SourceBelief,
    pub(crate) estimate: Option<Estimate>,
    pub(crate) intensity: Intensity,
    /// Pictures that showed the place from nearby, and the place that they showed.
    pub(crate) looks: u32,
    looked_at: Place,
    /// Where Submits for it found nothing, and how loud it must be for the next.
    missed: Vec<Place>,
    missed_level: f32,
    /// Steps for which the agent has headed for it.
    pub(crate) sought_steps: u32,
}

/// A Submit whose outcome is not known yet.
#[derive(Clone, Copy)]
pub(crate) struct Claim {
    pub(crate) source: usize,
    pub(crate) object: usize,
    pub(crate) goal: usize,
    level: f32,
    aftermath: Aftermath,
}

impl Default for PagNav {
    fn default() -> Self {
        Self::new(Weights::default())
    }
}

impl PagNav {
    /// An agent that has played nothing yet.
    pub fn new(weights: Weights) -> Self {
        Self::with(weights, Box::<Sight>::default())
    }

    fn with(weights: Weights, perception: Box<dyn Recognition>) -> Self {
        let task = TaskSpec::default();
        Self {
            weights,
            ablation: Ablation::default(),
            perception,
            hints: None,
            ear: Ear::default(),
            view: View::new(&task),
            map: Occupancy::default(),
            objects: Objects::default(),
            storeys: Storeys::default(),
            elevation: Elevation::default(),
            flight: None,
            false_stairs: Vec::new(),
            height_m: 0.0,
            turn_rad: task.turn_rad,
            field: None,
            motion: Motion::new(&task),
            course: Course::default(),
            scouting: Course::default(),
            frontier: None,
            turns: Turns::new(0, task.sounding_window_steps),
            queries: Vec::new(),
            goals: Goals::new(0, false),
            sources: Vec::new(),
            focus: None,
            claim: None,
            levels: Vec::new(),
            is_told: false,
            remaining_steps: task.max_steps,
            thought: Thought::default(),
            trace: None,
        }
    }

    /// The same without some of its parts.
    pub fn without(self, ablation: Ablation) -> Self {
        let weights = if ablation.no_audio { self.weights.silent() } else { self.weights };
        Self { weights, ablation, ..self }
    }

    /// The same with other eyes.
    pub fn seeing(self, perception: impl Recognition + 'static) -> Self {
        Self { perception: Box::new(perception), ..self }
    }

    /// The same, told where each sound comes from.
    pub fn hinted(self, hints: Arc<dyn Hints>) -> Self {
        Self { hints: Some(hints), ..self }
    }

    /// Takes in one observation.
    fn perceive(&mut self, observation: &Observation, stand: &Stand) {
        self.remaining_steps = observation.remaining_steps;
        self.climb(observation.pose.position[1]);
        self.motion.feel(stand, &mut self.map);
        if let Some(depth) = &observation.depth {
            self.map.see(&self.view, stand, depth);
            self.elevation.see(&self.view, stand, self.height_m, depth);
        }
        let audio = observation.audio.as_ref().filter(|_| !self.ablation.no_audio);
        let heard = audio.and_then(|audio| self.ear.hear(audio));
        self.settle(observation.feedback, heard.as_ref(), stand.place);
        match heard {
            _ if self.claim.is_some() => self.turns.defer(),
            Some(heard) => {
                self.turns.advance().into_iter().for_each(|source| self.listen(source, stand, &heard))
            }
            None => _ = self.turns.advance(),
        }
        if observation.rgb.is_some() && observation.depth.is_some() {
            self.look(observation, stand);
        }
    }

    /// Notes how high the body is: what it remembers of another storey is of no use on this one.
    fn climb(&mut self, height_m: f32) {
        self.height_m = height_m;
        if self.storeys.is_on(height_m) {
            return;
        }
        let mut memory = Memory {
            map: mem::take(&mut self.map),
            objects: mem::take(&mut self.objects),
            sources: mem::take(&mut self.sources),
        };
        let count = self.queries.len();
        self.storeys.enter(height_m, &mut memory, || Memory::of(count));
        (self.map, self.objects, self.sources) = (memory.map, memory.objects, memory.sources);
        self.sources.iter_mut().for_each(|source| source.sought_steps = 0);
        (self.course, self.scouting) = (Course::default(), Course::default());
        (self.frontier, self.field, self.focus) = (None, None, None);
        (0..count).for_each(|source| self.goals.forget(source));
    }

    /// Takes in one picture.
    fn look(&mut self, observation: &Observation, stand: &Stand) {
        let map = &self.map;
        let things = self.perception.see(stand, observation, &|place| map.is_wall(Cell::at(place)));
        if self.ablation.no_memory && things.is_some() {
            self.objects = Objects::new(self.queries.len());
        }
        self.objects.see(things.unwrap_or_default());
        self.look_at_objects(stand);
        self.look_at_sources(stand);
    }

    /// Finds out what became of the last Submit: a target that was found falls silent.
    fn settle(&mut self, feedback: Feedback, heard: Option<&Heard>, here: Place) {
        let Some(claim) = &mut self.claim else { return };
        let outcome = claim.aftermath.outcome(feedback, heard, self.weights.found_level);
        let Some(found) = outcome.or(self.ablation.no_audio.then_some(true)) else { return };
        let claim = *claim;
        self.claim = None;
        self.levels.clear();
        if found {
            self.turns.silence(claim.source);
            if self.ablation.no_audio {
                self.goals.close(claim.goal);
                self.objects.refute(claim.object);
            } else {
                self.goals.found(claim.source);
                self.begin_anew();
            }
            self.focus = None;
        } else {
            self.goals.missed(claim.source);
            self.objects.refute(claim.object);
            self.miss(&claim, here);
        }
    }

    /// Forgets Submits in vain that were for another goal.
    fn begin_anew(&mut self) {
        let anew = self.sources.iter_mut().filter(|_| self.goals.is_ordered());
        anew.for_each(|source| {
            source.missed.clear();
            source.missed_level = 0.0;
        });
    }

    /// Takes in that a Submit found nothing: what may be found is not there, the next goal's target at the least.
    fn miss(&mut self, claim: &Claim, here: Place) {
        const LOUDER: f32 = 1.2;
        let all = !self.goals.is_ordered();
        let sources = self.sources.iter_mut().enumerate();
        sources
            .filter(|(source, _)| all || *source == claim.source)
            .for_each(|(_, source)| source.missed.push(here));
        self.sources[claim.source].missed_level = LOUDER * claim.level;
    }

    /// Compares every hypothesis that is near and before the camera with the goals.
    fn look_at_objects(&mut self, stand: &Stand) {
        let (map, goals, perception) = (&self.map, 0..self.queries.len(), &self.perception);
        for object in self.objects.iter_mut() {
            if map.is_in_view(stand, object.thing.center(), LOOK_M) {
                let fits: Vec<f32> = goals.clone().map(|goal| perception.fit(&object.thing, goal)).collect();
                object.look(&fits);
            }
        }
    }

    /// Notes how well what stands at the believed sources in view fits each goal.
    fn look_at_sources(&mut self, stand: &Stand) {
        for index in 0..self.sources.len() {
            let estimate = self.sources[index].estimate;
            let Some(estimate) = estimate.filter(|estimate| self.is_located(index, estimate)) else {
                continue;
            };
            if self.map.is_in_view(stand, estimate.place, LOOK_M) {
                self.sources[index].look_at(estimate.place);
                for goal in 0..self.queries.len() {
                    self.goals.see(index, goal, self.fit_at(estimate.place, goal));
                }
            }
        }
    }

    /// How well the best of the things at a place fits a goal by what is seen, 0 to 1.
    fn fit_at(&self, place: Place, goal: usize) -> f32 {
        const AT_M: f32 = 0.4;
        let at = self.objects.all().iter().filter(|object| object.thing.distance_m(place) <= AT_M);
        let fits = at.map(|object| {
            let context = self.context(object.thing.center(), goal);
            Evidence { vis: object.vis(goal), context, sound: 0.0 }.seen(&self.weights)
        });
        fits.fold(0.0, f32::max)
    }

    /// How much rooms and things around a place speak for a goal, 0 to 1.
    pub(crate) fn context(&self, place: Place, goal: usize) -> f32 {
        const NEUTRAL: f32 = 0.5;
        if self.ablation.no_priors { NEUTRAL } else { self.objects.context(place, &self.queries[goal]) }
    }

    /// Whether a believed source is certain, and has been heard from so near that it can be seen.
    pub(crate) fn is_located(&self, source: usize, estimate: &Estimate) -> bool {
        let heard_m = range_m(self.sources[source].intensity.loudest());
        estimate.certainty >= self.weights.certain && heard_m <= self.weights.look_range_m
    }

    fn listen(&mut self, index: usize, stand: &Stand, heard: &Heard) {
        if self.turns.is_first() {
            self.levels.clear();
        }
        self.levels.push(heard.level);
        self.thought.heard = Some((index, *heard));
        let (map, source) = (&self.map, &mut self.sources[index]);
        let field = self.field.take().filter(|field| field.listener() == stand.place);
        let field = field.unwrap_or_else(|| SoundField::new(map, stand.place, map.area(AROUND_M)));
        source.intensity.hear(stand.place, heard.level);
        source.belief.hear(&field, stand, heard);
        let told = self.hints.as_ref().and_then(|hints| hints.source());
        let told = told.map(|place| Estimate { place, certainty: 1.0 });
        let estimate = told.or_else(|| source.belief.estimate(&field, map, &source.missed));
        if source.locate(estimate) {
            self.goals.forget(index);
        }
        self.field = Some(field);
    }

    /// Submits a candidate, unless its outcome would stay unknown: where the rules tell none, only the silence of a
    /// source that was loud before does. One that a Submit from here found nothing at is refuted instead: waiting changes nothing.
    pub(crate) fn submit(&mut self, candidate: &Candidate, stand: &Stand) -> Option<Action> {
        let Candidate { object, source, goal, .. } = *candidate;
        let recent = &self.levels[self.levels.len().saturating_sub(RECENT)..];
        let level = recent.iter().sum::<f32>() / recent.len().max(1) as f32;
        let is_heard = self.turns.current() == source
            && recent.len() == RECENT
            && self.turns.steps_left() >= Aftermath::STEPS
            && range_m(level) <= self.weights.look_range_m;
        if !self.is_told && !self.ablation.no_audio {
            if !is_heard {
                return None;
            }
            if !self.sources[source].is_worth(level, stand.place) {
                self.objects.refute(object);
                return None;
            }
        }
        self.claim = Some(Claim { source, object, goal, level, aftermath: Aftermath::of(level) });
        Some(Action::Submit)
    }
}

impl Agent for PagNav {
    fn enter(&mut self, episode: &str) {
        self.trace(|trace, agent| trace.enter(agent, episode));
    }

    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        let count = mission.goals.len();
        let nothing: Box<dyn Recognition> = Box::<Classical>::default();
        let mut perception = mem::replace(&mut self.perception, nothing);
        perception.begin(task, mission);
        *self = Self {
            ablation: self.ablation,
            hints: self.hints.take(),
            trace: self.trace.take(),
            view: View::new(task),
            motion: Motion::new(task),
            turn_rad: task.turn_rad,
            objects: Objects::new(count),
            turns: Turns::new(count, task.sounding_window_steps),
            queries: mission.goals.iter().map(Query::new).collect(),
            goals: Goals::new(count, mission.order == Order::Ordered),
            sources: mission.goals.iter().map(|_| Source::default()).collect(),
            is_told: task.feedback == FeedbackRule::Verdict,
            ..Self::with(self.weights.clone(), perception)
        };
        self.trace(|trace, agent| trace.begin(agent, mission));
    }

    fn act(&mut self, observation: &Observation) -> Action {
        let stand = Stand::new(&observation.pose);
        self.thought = Thought::default();
        self.perceive(observation, &stand);
        let action = self.decide(&stand);
        self.motion.note(action, &stand);
        self.trace(|trace, agent| trace.step(agent, observation, action));
        action
    }
}

impl Source {
    /// Takes in where it is believed to be. Gives back whether that is elsewhere than what was looked at, which counts no
    /// more.
    fn locate(&mut self, estimate: Option<Estimate>) -> bool {
        const SAME_M: f32 = 1.0;
        self.estimate = estimate;
        let is_there = estimate.is_some_and(|estimate| estimate.place.distance_m(self.looked_at) <= SAME_M);
        let is_elsewhere = self.looks > 0 && !is_there;
        if is_elsewhere {
            self.looks = 0;
        }
        is_elsewhere
    }

    /// Whether a Submit at this level and place is worth another try: it is louder, or not where one found nothing.
    fn is_worth(&self, level: f32, here: Place) -> bool {
        const ANEW_M: f32 = 0.4;
        level > self.missed_level || self.missed.iter().all(|place| place.distance_m(here) >= ANEW_M)
    }

    /// Counts a look.
    fn look_at(&mut self, place: Place) {
        if self.looks == 0 {
            self.looked_at = place;
        }
        self.looks += 1;
    }
}
