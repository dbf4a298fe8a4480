use crate::agent::PagNav;
use avln_client::Action;
use avln_kit::{
    map::Climb,
    perception::{Place, Stand},
};
use std::f32::consts::TAU;

/// Stairs lead at least so far up or down, metres.
const FLIGHT_M: f32 = 0.9;
/// On stairs it heads for what is so much higher, metres, or else for the next step, that far away at the most.
const RISE_M: f32 = 0.4;
const STEP_M: f32 = 0.12;
const NEAR_M: f32 = 1.0;
/// Where no step leads on it goes so far on the level, metres, and looks around there.
const LANDING_M: f32 = 0.6;
/// What is level, and how near one must come to the middle of a landing, metres.
const LEVEL_M: f32 = 0.1;
/// Within this distance ahead on its way the body aims, metres.
const AIM_M: f32 = 0.35;
/// A step forward that moved by less hit something, metres.
const BLOCKED_M: f32 = 0.08;
/// Steps near stairs without having come higher after which it gives them up, and how near to their foot none are sought again,
/// metres.
const VAIN_STEPS: u32 = 50;
const FALSE_M: f32 = 1.0;
/// Steps from one search for stairs to the next.
const SEARCH_STEPS: u32 = 10;

/// A way from storey to storey that is being taken.
#[derive(Clone, Copy)]
pub(crate) struct Flight {
    /// 1 up, -1 down.
    sign: f32,
    /// How high it came, metres, in its direction, and for how many steps it came no higher.
    best_m: f32,
    vain_steps: u32,
    /// Where it looks for the next steps.
    landing: Option<Place>,
    /// What it has turned since it saw steps, radians.
    turned_rad: f32,
    /// Where it stood when it walked on.
    walked_from: Option<Place>,
}

impl PagNav {
    /// The next action on stairs, where it is on them or has sought something on this storey for so long that it takes them.
    pub(crate) fn take_stairs(&mut self, stand: &Stand) -> Option<Action> {
        let mut flight = self.flight.take().or_else(|| self.find_stairs(stand))?;
        let is_blocked = flight.walked_from.is_some_and(|place| place.distance_m(stand.place) < BLOCKED_M);
        if is_blocked {
            self.elevation.bumped(stand.offset(0.2, 0.0), self.height_m);
        }
        let way = self.steps_on(&mut flight, stand);
        let turn = match &way {
            Some(climb) => self.motion.toward(stand.bearing_rad(climb.ahead(AIM_M))),
            None => Some(Action::TurnLeft),
        };
        flight.turned_rad = if way.is_some() { 0.0 } else { flight.turned_rad + self.turn_rad };
        flight.walked_from = turn.is_none().then_some(stand.place);
        let is_near = way.is_none_or(|climb| climb.end().distance_m(stand.place) <= 2.0 * NEAR_M);
        flight.vain_steps += u32::from(is_near || is_blocked);
        self.note_progress(flight, stand.place);
        Some(turn.unwrap_or(Action::MoveForward))
    }

    /// Stays on stairs that lead on, and remembers where there are none.
    fn note_progress(&mut self, mut flight: Flight, here: Place) {
        let rise_m = flight.sign * self.height_m;
        if rise_m >= flight.best_m + STEP_M {
            (flight.best_m, flight.vain_steps) = (rise_m, 0);
        }
        let is_vain = flight.vain_steps >= VAIN_STEPS;
        self.false_stairs.extend(is_vain.then_some(here));
        self.flight = Some(flight).filter(|flight| flight.turned_rad < TAU && !is_vain);
    }

    /// The way to the next steps, or to where one sees more of them; `None` where one is there.
    fn steps_on(&self, flight: &mut Flight, stand: &Stand) -> Option<Climb> {
        let (here_m, from) = (self.height_m, stand.place);
        let climb = |wanted: &dyn Fn(Place, f32) -> bool| self.elevation.climb(from, here_m, wanted);
        let rise_m = |height_m: f32| flight.sign * (height_m - here_m);
        let steps =
            climb(&|place, height_m| rise_m(height_m) >= RISE_M && !self.is_false(place)).or_else(|| {
                climb(&|place, height_m| rise_m(height_m) >= STEP_M && place.distance_m(from) <= NEAR_M)
            });
        if steps.is_some() {
            flight.landing = None;
            return steps;
        }
        let is_level = |height_m: f32| rise_m(height_m).abs() <= LEVEL_M;
        let away = || climb(&|place, height_m| is_level(height_m) && place.distance_m(from) >= LANDING_M);
        let middle = flight.landing.or_else(|| away().map(|way| way.end()))?;
        flight.landing = Some(middle);
        let is_there = middle.distance_m(from) <= 2.0 * LEVEL_M || flight.turned_rad > 0.0;
        let to_middle =
            || climb(&|place, height_m| is_level(height_m) && place.distance_m(middle) <= LEVEL_M);
        if is_there { None } else { to_middle() }
    }

    /// Stairs up or down, where it is time to take some.
    fn find_stairs(&self, stand: &Stand) -> Option<Flight> {
        let is_time = self.remaining_steps.is_multiple_of(SEARCH_STEPS)
            && self.vain_steps() >= self.weights.storey_steps
            && self.remaining_steps > self.weights.hurry_steps;
        let here_m = self.height_m;
        let far =
            |place: Place, height_m: f32| (height_m - here_m).abs() >= FLIGHT_M && !self.is_false(place);
        let stairs = if is_time { self.elevation.climb(stand.place, here_m, far) } else { None }?;
        let sign = (stairs.height_m - here_m).signum();
        let best_m = sign * here_m;
        Some(Flight { sign, best_m, vain_steps: 0, landing: None, turned_rad: 0.0, walked_from: None })
    }

    /// Whether what seemed to be stairs near a place was none.
    fn is_false(&self, place: Place) -> bool {
        self.false_stairs.iter().any(|known| known.distance_m(place) <= FALSE_M)
    }

    /// For how long it has sought what it heads for on this storey.
    fn vain_steps(&self) -> u32 {
        let sought = |source: usize| self.sources[source].sought_steps;
        match self.focus {
            Some(source) => sought(source),
            None => self.goals.active().map(sought).max().unwrap_or(0),
        }
    }
}
