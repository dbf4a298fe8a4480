//! Baseline agents with vision: explore until a goal's category is seen, then Submit.

use avln_client::{Action, Agent, GoalCue, Mission, Observation, Order, TaskSpec};
use avln_kit::LOOK_M;
use avln_kit::explorer::Explorer;
use avln_kit::map::{Cell, ObjectMemory};
use avln_kit::perception::{CueWords, NetworkRecognition, Query, Recognition};
use std::collections::BTreeMap;

/// Least fit of a detection, 0 to 1.
const DETECTED: f32 = 0.6;
/// Views over which the fit must hold.
const LOOKS: u32 = 2;

/// An agent that explores by the nearest frontier until it sees a goal's category, and submits there.
///
/// Modular like CoW (Gadre et al. 2023). Differences: the detector is the bundled network, not CLIP; of
/// sentences it uses only the noun, like CoW's category baseline; image cues are compared with the view.
#[derive(Default)]
pub struct Detector {
    memory: Option<VisualMemory>,
}

impl Agent for Detector {
    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        let goals = mission.goals.iter().map(category_alone).collect();
        self.memory = Some(VisualMemory::new(task, &Mission { goals, ..mission.clone() }));
    }

    fn act(&mut self, observation: &Observation) -> Action {
        let Some(memory) = &mut self.memory else { return Action::Stop };
        let in_view = memory.observe(observation);
        if memory.aim.is_none() {
            let detected = in_view.into_iter().filter(|&index| memory.objects.all()[index].looks >= LOOKS);
            let fits = detected.filter_map(|index| Some((index, memory.fit(index)?)));
            let best = fits.filter(|(_, (fit, _))| *fit >= DETECTED).max_by(|a, b| a.1.0.total_cmp(&b.1.0));
            if let Some((index, (_, goal))) = best {
                memory.head_for(index, goal);
            }
        }
        let onward = memory.pursue().unwrap_or_else(|| memory.explorer.explore());
        let action = allowed(onward, observation);
        memory.explorer.record(action);
        action
    }
}

/// Returns Stop for the last step and for a claim without Submits left, otherwise the action.
fn allowed(action: Action, observation: &Observation) -> Action {
    match action {
        _ if observation.remaining_steps <= 1 => Action::Stop,
        Action::Submit => observation.claim(),
        other => other,
    }
}

/// Reduces a cue to the category, if there is a category.
fn category_alone(cue: &GoalCue) -> GoalCue {
    match Query::new(cue) {
        Query::Words(CueWords { category, .. }) => GoalCue::Category(category),
        Query::Picture { .. } => cue.clone(),
    }
}

/// Least fit of a view with a goal to be preferred to frontiers, 0 to 1.
const WORTH: f32 = 0.55;
/// Decrease in a view's value per metre.
const PER_M: f32 = 0.01;

/// An agent that chooses between the remembered view that fits a goal best and the nearest frontier.
///
/// The memory follows 3D-Mem (Yang et al. 2025): snapshots cover all objects, each object in one snapshot.
/// Differences: the fit of cue and object decides, not a language model; snapshots are lists of objects.
#[derive(Default)]
pub struct Snapshot {
    memory: Option<VisualMemory>,
    snapshots: SnapshotMemory,
}

impl Agent for Snapshot {
    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        *self = Self { memory: Some(VisualMemory::new(task, mission)), snapshots: SnapshotMemory::default() };
    }

    fn act(&mut self, observation: &Observation) -> Action {
        let Some(memory) = &mut self.memory else { return Action::Stop };
        let in_view = memory.observe(observation);
        self.snapshots.take(in_view);
        let choice = self.snapshots.best(memory);
        match choice {
            Some((index, goal)) if memory.aim.is_none() => memory.head_for(index, goal),
            None => memory.aim = None,
            Some(_) => {}
        }
        let onward = memory.pursue().unwrap_or_else(|| memory.explorer.explore());
        let action = allowed(onward, observation);
        memory.explorer.record(action);
        action
    }
}

/// The snapshots: an object belongs to the largest view with it; views without objects are dropped.
#[derive(Clone, Debug, Default)]
struct SnapshotMemory {
    /// Objects by view number.
    views: BTreeMap<usize, Vec<usize>>,
    /// An object's view, and the view's object count.
    covered_by: BTreeMap<usize, (usize, usize)>,
    taken: usize,
}

impl SnapshotMemory {
    /// Adds a view. It is kept if it shows a new object, or more objects at once than the views that cover them.
    fn take(&mut self, detections: Vec<usize>) {
        let size = detections.len();
        self.taken += 1;
        for thing in detections {
            // Larger views win, so that few views cover everything.
            let known = self.covered_by.get(&thing).copied();
            if known.is_some_and(|(_, larger)| larger >= size) {
                continue;
            }
            if let Some((view, _)) = known {
                self.uncover(thing, view);
            }
            self.covered_by.insert(thing, (self.taken, size));
            self.views.entry(self.taken).or_default().push(thing);
        }
    }

    fn uncover(&mut self, thing: usize, view: usize) {
        let Some(detections) = self.views.get_mut(&view) else { return };
        detections.retain(|&other| other != thing);
        if detections.is_empty() {
            self.views.remove(&view);
        }
    }

    /// Returns object and goal from the best worthwhile view.
    fn best(&self, memory: &VisualMemory) -> Option<(usize, usize)> {
        let worth = |detections: &Vec<usize>| {
            let fits = detections.iter().filter_map(|&index| {
                let (fit, goal) = memory.fit(index)?;
                let place = memory.objects.all()[index].detection.center();
                let distance_m = place.distance_m(memory.explorer.pose().place);
                (fit >= WORTH).then_some((fit - PER_M * distance_m, index, goal))
            });
            fits.max_by(|a, b| a.0.total_cmp(&b.0))
        };
        let best = self.views.values().filter_map(worth).max_by(|a, b| a.0.total_cmp(&b.0));
        best.map(|(_, index, goal)| (index, goal))
    }
}

/// Largest distance, metres, and bearing, radians, at a Submit.
const SUBMIT_M: f32 = 1.2;
const SUBMIT_RAD: f32 = 0.6;
/// Distance to an object at which a path ends, metres.
const REACH_M: f32 = 0.5;
/// Steps towards an object before giving up.
const PATIENCE_STEPS: u32 = 150;

/// The state of agents that see and do not hear; every Submit counts as correct.
struct VisualMemory {
    explorer: Explorer,
    objects: ObjectMemory,
    perception: Box<dyn Recognition>,
    goals: usize,
    ordered: bool,
    done: Vec<bool>,
    /// Excluded objects: submitted or unreachable.
    closed: Vec<usize>,
    /// Current object and goal, and steps towards them.
    aim: Option<(usize, usize)>,
    aimed_steps: u32,
}

impl VisualMemory {
    fn new(task: &TaskSpec, mission: &Mission) -> Self {
        let goals = mission.goals.len();
        let mut perception = Box::<NetworkRecognition>::default();
        perception.begin(task, mission);
        Self {
            explorer: Explorer::new(task),
            objects: ObjectMemory::new(goals),
            perception,
            goals,
            ordered: mission.order == Order::Ordered,
            done: vec![false; goals],
            closed: Vec::new(),
            aim: None,
            aimed_steps: 0,
        }
    }

    /// Adds an observation and returns the indices in view.
    fn observe(&mut self, observation: &Observation) -> Vec<usize> {
        self.explorer.observe(observation);
        let (pose, map) = (self.explorer.pose(), &self.explorer.map);
        let detections = self.perception.see(&pose, observation, &|place| map.is_wall(Cell::at(place)));
        self.objects.see(detections.unwrap_or_default());
        self.objects.look(map, &pose, LOOK_M, |detection, goal| self.perception.fit(detection, goal))
    }

    /// Returns the goals that a Submit may be for.
    fn active(&self) -> impl Iterator<Item = usize> {
        let count = if self.ordered { 1 } else { self.goals };
        (0..self.goals).filter(|&goal| !self.done[goal]).take(count)
    }

    /// Returns an open object's best fit with an active goal, and that goal.
    fn fit(&self, index: usize) -> Option<(f32, usize)> {
        let object = self.objects.all().get(index).filter(|_| !self.closed.contains(&index))?;
        self.active().map(|goal| (object.vis(goal), goal)).max_by(|a, b| a.0.total_cmp(&b.0))
    }

    fn head_for(&mut self, index: usize, goal: usize) {
        (self.aim, self.aimed_steps) = (Some((index, goal)), 0);
    }

    /// Returns the next action towards the current object, or the Submit there; `None` without a reachable object.
    fn pursue(&mut self) -> Option<Action> {
        let (index, goal) = self.aim?;
        let pose = self.explorer.pose();
        let place = self.objects.all().get(index)?.detection.nearest(pose.place);
        let facing = self.explorer.face(place, SUBMIT_RAD);
        self.aimed_steps += 1;
        if place.distance_m(pose.place) <= SUBMIT_M
            && facing.is_none()
            && self.explorer.map.has_clear_line(pose.place, place)
        {
            self.close(index);
            self.done[goal] = true;
            return Some(Action::Submit);
        }
        let step = self.explorer.go_to(place, REACH_M).or(facing);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn last_claim_and_last_step_are_stops() {
        let seen = |remaining_steps, remaining_submits| Observation {
            remaining_steps,
            remaining_submits,
            ..Observation::default()
        };
        assert_eq!(allowed(Action::Submit, &seen(9, 1)), Action::Submit);
        assert_eq!(allowed(Action::Submit, &seen(9, 0)), Action::Stop);
        assert_eq!(allowed(Action::TurnLeft, &seen(9, 0)), Action::TurnLeft);
        assert_eq!(allowed(Action::TurnLeft, &seen(1, 1)), Action::Stop);
    }

    #[test]
    fn sentences_are_reduced_to_their_noun() {
        let sentence = GoalCue::Description("the large red sofa near the bed".into());
        assert_eq!(category_alone(&sentence), GoalCue::Category("sofa".into()));
    }

    #[test]
    fn few_views_cover_each_object_once() {
        let mut snapshots = SnapshotMemory::default();
        snapshots.take(vec![1]);
        snapshots.take(vec![1, 2]);
        assert_eq!(snapshots.views.values().collect::<Vec<_>>(), [&vec![1, 2]]);
        snapshots.take(vec![2]);
        assert_eq!(snapshots.views.len(), 1);
        snapshots.take(vec![2, 3, 4]);
        let covered: Vec<_> = snapshots.views.values().cloned().collect();
        assert_eq!(covered, [vec![1], vec![2, 3, 4]]);
    }
}
