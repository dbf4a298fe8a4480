use avln_client::{Action, Agent, Feedback, FeedbackRule, Mission, Observation, Order, TaskSpec};
use avln_kit::{
    Aftermath, Scout, Turns,
    map::{Estimate, SoundField, SourceBelief, range_m},
    perception::{Ear, Heard, Place},
};

/// Sources are sought within this distance of the start, metres.
const AROUND_M: f32 = 12.0;
/// It submits where a source is believed to be nearer than this, metres, and so sure.
const NEAR_M: f32 = 1.2;
const CERTAIN: f32 = 0.5;
/// The sound must be as loud as in the open at this distance, metres: rooms add to it.
const LOUD_M: f32 = 0.8;
/// Within this distance of the believed place the way ends, metres.
const REACH_M: f32 = 0.4;
/// Steps of sound before it submits, whose mean is how loud it is.
const RECENT: usize = 3;
/// A Submit in this share of the loudness before it was followed by silence of the source: it found its target.
const FOUND_LEVEL: f32 = 0.5;
/// Submits at one source that find nothing before it heads for another.
const MOST_WRONG: u32 = 2;

/// Goes where it hears something and submits near; sees nothing, so that its map is what blocked it.
///
/// Behaves as SAVi (Chen, Al-Halah and Grauman 2021) is meant to for goals that sound: it keeps a belief of where each
/// sound comes from over silence, and goes there. It is not SAVi: nothing is learnt, it has no pictures, the clip tells no
/// category, and it knows no goals, so that in ordered missions it submits at whatever is nearest.
#[derive(Default)]
pub struct SoundFollower {
    ear: Ear,
    state: Option<State>,
}

struct State {
    scout: Scout,
    turns: Turns,
    sources: Vec<Source>,
    field: Option<SoundField>,
    levels: Vec<f32>,
    /// The source of the last Submit, and what it led to.
    claim: Option<(usize, Aftermath)>,
    is_told: bool,
    /// Whether a Submit may be for any target, so that one that found nothing tells where none is.
    is_any_right: bool,
}

#[derive(Default)]
struct Source {
    belief: SourceBelief,
    estimate: Option<Estimate>,
    wrong_submits: u32,
    /// Where Submits for it found nothing.
    missed: Vec<Place>,
}

impl State {
    fn new(task: &TaskSpec, mission: &Mission) -> Self {
        let goals = mission.goals.len();
        let mut scout = Scout::new(task);
        scout.map.suppose([Place::new(-AROUND_M, -AROUND_M), Place::new(AROUND_M, AROUND_M)]);
        Self {
            scout,
            turns: Turns::new(goals, task.sounding_window_steps),
            sources: (0..goals).map(|_| Source::default()).collect(),
            field: None,
            levels: Vec::new(),
            claim: None,
            is_told: task.feedback == FeedbackRule::Verdict,
            is_any_right: mission.order == Order::Unordered,
        }
    }

    /// Finds out what became of the last Submit: a target that was found falls silent.
    fn settle(&mut self, feedback: Feedback, heard: Option<&Heard>) {
        let Some((source, aftermath)) = &mut self.claim else { return };
        let Some(found) = aftermath.outcome(feedback, heard, FOUND_LEVEL) else { return };
        match found {
            true => self.turns.silence(*source),
            false => {
                self.sources[*source].wrong_submits += 1;
                self.sources[*source].missed.extend(self.is_any_right.then_some(self.scout.stand().place));
            }
        }
        self.claim = None;
        self.levels.clear();
    }

    fn listen(&mut self, source: usize, heard: &Heard) {
        if self.turns.is_first() {
            self.levels.clear();
        }
        self.levels.push(heard.level);
        let (stand, map) = (self.scout.stand(), &self.scout.map);
        let field = self.field.take().filter(|field| field.listener() == stand.place);
        let field = field.unwrap_or_else(|| SoundField::new(map, stand.place, map.area(0.0)));
        let source = &mut self.sources[source];
        source.belief.hear(&field, &stand, heard);
        source.estimate = source.belief.estimate(&field, map, &source.missed);
        self.field = Some(field);
    }

    /// The nearest believed source that has not been found; those at which it submitted in vain come last.
    fn aim(&self) -> Option<(usize, Estimate)> {
        let here = self.scout.stand().place;
        let open = (0..self.sources.len()).filter(|&source| !self.turns.is_silent(source));
        let heard = open.filter_map(|source| Some((source, self.sources[source].estimate?)));
        let cost = |&(source, estimate): &(usize, Estimate)| {
            (self.sources[source].wrong_submits >= MOST_WRONG, estimate.place.distance_m(here))
        };
        heard.min_by(|a, b| {
            let (a, b) = (cost(a), cost(b));
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
        })
    }

    fn decide(&mut self) -> Action {
        if self.claim.is_some() {
            return Action::TurnLeft;
        }
        let Some((source, Estimate { place, certainty })) = self.aim() else { return Action::MoveForward };
        if certainty >= CERTAIN
            && place.distance_m(self.scout.stand().place) <= NEAR_M
            && let Some(level) = self.loudness_of(source)
        {
            self.claim = Some((source, Aftermath::of(level)));
            return Action::Submit;
        }
        self.scout.go(place, REACH_M).unwrap_or(Action::TurnLeft)
    }

    /// How loud a source is that sounds now and from near; only then its silence tells that it was found.
    fn loudness_of(&self, source: usize) -> Option<f32> {
        let recent = &self.levels[self.levels.len().saturating_sub(RECENT)..];
        let level = recent.iter().sum::<f32>() / recent.len().max(1) as f32;
        let is_heard = self.turns.current() == source
            && self.turns.steps_left() >= Aftermath::STEPS
            && recent.len() == RECENT
            && range_m(level) <= LOUD_M;
        (is_heard || self.is_told).then_some(level)
    }
}

impl Agent for SoundFollower {
    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        self.state = Some(State::new(task, mission));
    }

    fn act(&mut self, observation: &Observation) -> Action {
        let Some(state) = &mut self.state else { return Action::Stop };
        state.scout.observe(observation);
        let heard = observation.audio.as_ref().and_then(|audio| self.ear.hear(audio));
        state.settle(observation.feedback, heard.as_ref());
        match heard {
            _ if state.claim.is_some() => state.turns.defer(),
            Some(heard) => state.turns.advance().into_iter().for_each(|source| state.listen(source, &heard)),
            None => _ = state.turns.advance(),
        }
        let action = if observation.remaining_steps <= 1 { Action::Stop } else { state.decide() };
        state.scout.note(action);
        action
    }
}
