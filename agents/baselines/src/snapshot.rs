use crate::memory::{Memory, away_m};
use avln_client::{Action, Agent, Mission, Observation, TaskSpec};
use std::collections::BTreeMap;

/// What a view must show of a goal to be worth more than any frontier, 0 to 1.
const WORTH: f32 = 0.55;
/// What a metre of way takes from the worth of a view.
const PER_M: f32 = 0.01;

/// Keeps few views that show every thing it has seen once, and chooses between the view that fits a goal best and the
/// nearest frontier. Hears nothing.
///
/// Remembers as 3D-Mem (Yang et al. 2025): memory snapshots cover all detected objects, each of them in one, and
/// frontiers stand for what is unknown. It is not 3D-Mem: no language model chooses, the fit of cue and thing does;
/// snapshots are lists of things and not pictures.
#[derive(Default)]
pub struct Snapshot {
    memory: Option<Memory>,
    snapshots: Snapshots,
}

impl Agent for Snapshot {
    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        *self = Self { memory: Some(Memory::new(task, mission)), snapshots: Snapshots::default() };
    }

    fn act(&mut self, observation: &Observation) -> Action {
        let Some(memory) = &mut self.memory else { return Action::Stop };
        let in_view = memory.observe(observation);
        self.snapshots.take(in_view);
        let choice = self.snapshots.best(memory);
        match choice {
            Some((index, goal)) if memory.aim().is_none() => memory.head_for(index, goal),
            None => memory.forget_aim(),
            Some(_) => {}
        }
        let onward = memory.pursue().unwrap_or_else(|| memory.scout.explore());
        let action = if observation.remaining_steps <= 1 { Action::Stop } else { onward };
        memory.scout.note(action);
        action
    }
}

/// Views that cover things: each thing is in the largest view that showed it, and views that cover nothing are dropped.
#[derive(Clone, Debug, Default)]
struct Snapshots {
    /// Things of each view, by its number.
    views: BTreeMap<usize, Vec<usize>>,
    /// The view that covers a thing, and how many things that view showed.
    covered_by: BTreeMap<usize, (usize, usize)>,
    taken: usize,
}

impl Snapshots {
    /// Takes in a view: it is kept when it shows something new, or more things at once than the views that showed them.
    fn take(&mut self, things: Vec<usize>) {
        let size = things.len();
        self.taken += 1;
        for thing in things {
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
        let Some(things) = self.views.get_mut(&view) else { return };
        things.retain(|&other| other != thing);
        if things.is_empty() {
            self.views.remove(&view);
        }
    }

    /// The thing, and its goal, for which the best view is worth going to.
    fn best(&self, memory: &Memory) -> Option<(usize, usize)> {
        let worth = |things: &Vec<usize>| {
            let fits = things.iter().filter_map(|&index| {
                let (fit, goal) = memory.fit(index)?;
                let place = memory.objects.all()[index].thing.center();
                (fit >= WORTH).then_some((fit - PER_M * away_m(&memory.scout, place), index, goal))
            });
            fits.max_by(|a, b| a.0.total_cmp(&b.0))
        };
        let best = self.views.values().filter_map(worth).max_by(|a, b| a.0.total_cmp(&b.0));
        best.map(|(_, index, goal)| (index, goal))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_thing_is_covered_once_and_by_few_views() {
        let mut snapshots = Snapshots::default();
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
