use avln_client::{Action, Mission, Observation, Order, TaskSpec};
use avln_kit::{
    LOOK_M, Scout,
    map::{Cell, Objects},
    perception::{Place, Recognition, Sight},
};

/// It submits nearer than this, metres, and within this of straight ahead, radians.
const SUBMIT_M: f32 = 1.2;
const SUBMIT_RAD: f32 = 0.6;
/// Within this distance the way to a thing ends, metres.
const REACH_M: f32 = 0.5;
/// Steps for which it heads for one thing before it gives that up.
const PATIENCE_STEPS: u32 = 150;

/// What agents have in common that remember things and hear nothing: a map, the things on it with how well each fits each
/// goal, and the goals that are open. Nobody tells them what became of a Submit, so they take it for right.
pub(crate) struct Memory {
    pub(crate) scout: Scout,
    pub(crate) objects: Objects,
    perception: Box<dyn Recognition>,
    goals: usize,
    ordered: bool,
    done: Vec<bool>,
    /// Things that are heard of no more: submitted, or not to be reached.
    closed: Vec<usize>,
    /// What it heads for, and for how many steps.
    aim: Option<(usize, usize)>,
    aimed_steps: u32,
}

impl Memory {
    pub(crate) fn new(task: &TaskSpec, mission: &Mission) -> Self {
        let goals = mission.goals.len();
        let mut perception = Box::<Sight>::default();
        perception.begin(task, mission);
        Self {
            scout: Scout::new(task),
            objects: Objects::new(goals),
            perception,
            goals,
            ordered: mission.order == Order::Ordered,
            done: vec![false; goals],
            closed: Vec::new(),
            aim: None,
            aimed_steps: 0,
        }
    }

    /// Takes in one observation; gives back the indices of the things in view.
    pub(crate) fn observe(&mut self, observation: &Observation) -> Vec<usize> {
        self.scout.observe(observation);
        let (stand, map) = (self.scout.stand(), &self.scout.map);
        let things = self.perception.see(&stand, observation, &|place| map.is_wall(Cell::at(place)));
        self.objects.see(things.unwrap_or_default());
        let mut in_view = Vec::new();
        for (index, object) in self.objects.iter_mut().enumerate() {
            if map.is_in_view(&stand, object.thing.center(), LOOK_M) {
                let fits: Vec<f32> =
                    (0..self.goals).map(|goal| self.perception.fit(&object.thing, goal)).collect();
                object.look(&fits);
                in_view.push(index);
            }
        }
        in_view
    }

    /// The goals that a Submit may be for.
    pub(crate) fn active(&self) -> impl Iterator<Item = usize> {
        let count = if self.ordered { 1 } else { self.goals };
        (0..self.goals).filter(|&goal| !self.done[goal]).take(count)
    }

    /// How well an open thing fits the active goal that it fits best, and that goal.
    pub(crate) fn fit(&self, index: usize) -> Option<(f32, usize)> {
        let object = self.objects.all().get(index).filter(|_| !self.closed.contains(&index))?;
        self.active().map(|goal| (object.vis(goal), goal)).max_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// What it heads for, while that is open.
    pub(crate) fn aim(&self) -> Option<usize> {
        self.aim.map(|(index, _)| index)
    }

    /// Heads for a thing as a goal from now on.
    pub(crate) fn head_for(&mut self, index: usize, goal: usize) {
        (self.aim, self.aimed_steps) = (Some((index, goal)), 0);
    }

    /// Heads for nothing.
    pub(crate) fn forget_aim(&mut self) {
        self.aim = None;
    }

    /// The next action towards what it heads for, or the Submit there; `None` when it heads for nothing or cannot get there.
    pub(crate) fn pursue(&mut self) -> Option<Action> {
        let (index, goal) = self.aim?;
        let stand = self.scout.stand();
        let place = self.objects.all().get(index)?.thing.nearest(stand.place);
        let facing = self.scout.face(place, SUBMIT_RAD);
        self.aimed_steps += 1;
        if place.distance_m(stand.place) <= SUBMIT_M
            && facing.is_none()
            && self.scout.map.hears(stand.place, place)
        {
            self.close(index);
            self.done[goal] = true;
            return Some(Action::Submit);
        }
        let step = self.scout.go(place, REACH_M).or(facing);
        if step.is_none() || self.aimed_steps > PATIENCE_STEPS {
            self.close(index);
        }
        step
    }

    fn close(&mut self, index: usize) {
        self.closed.push(index);
        self.aim = None;
    }
}

/// How far away a place is, metres.
pub(crate) fn away_m(scout: &Scout, place: Place) -> f32 {
    place.distance_m(scout.stand().place)
}
