//! How often the thing that fits a goal best is the one that is meant.

use super::{
    truth::Instance,
    walk::{Goal, Modality, Walk},
};
use avln_kit::map::{Object, Objects};
use std::collections::BTreeMap;

/// A box is that of an instance where this much of both is in both, at least.
const SAME: f32 = 0.1;
/// Things this near to a place are what stands there, metres.
const AT_M: f32 = 0.4;

#[derive(Default)]
pub(crate) struct Tally {
    /// Goals found among all things, found among the instances of their category, and all.
    found: BTreeMap<Modality, [usize; 3]>,
    chance: BTreeMap<Modality, f64>,
    /// Goals whose place was told among that of two others, and all.
    told: BTreeMap<Modality, [usize; 2]>,
}

impl Tally {
    pub(crate) fn add(&mut self, walk: &Walk, objects: &Objects) {
        for (number, goal) in walk.goals.iter().enumerate() {
            let best = |of: &dyn Fn(&Object) -> bool| {
                let seen = objects.all().iter().filter(|object| object.looks > 0 && of(object));
                seen.max_by(|a, b| a.vis(number).total_cmp(&b.vis(number)))
            };
            let is_right = |object: Option<&Object>| {
                object
                    .and_then(|object| instance(walk, object))
                    .is_some_and(|found| goal.right.contains(&found.id))
            };
            let kind = walk.instances.iter().find(|i| goal.right.contains(&i.id)).map(|i| i.category);
            let is_kind = |object: &Object| instance(walk, object).map(|found| found.category) == kind;
            let counts = self.found.entry(goal.modality).or_default();
            counts[0] += usize::from(is_right(best(&|_| true)));
            counts[1] += usize::from(is_right(best(&is_kind)));
            counts[2] += 1;
            let rivals = walk.instances.iter().filter(|instance| Some(instance.category) == kind).count();
            *self.chance.entry(goal.modality).or_default() += goal.right.len() as f64 / rivals.max(1) as f64;
        }
        self.tell(walk, objects);
    }

    /// Each goal against the two that come a third and two thirds of all goals later: where is it, of three places?
    fn tell(&mut self, walk: &Walk, objects: &Objects) {
        let count = walk.goals.len();
        for first in 0..count {
            let trio = [first, (first + count / 3) % count, (first + 2 * count / 3) % count];
            let places = trio.map(|goal| place(walk, &walk.goals[goal]));
            let [Some(a), Some(b), Some(c)] = places else { continue };
            if a.id == b.id || b.id == c.id || a.id == c.id {
                continue;
            }
            let fit = |at: &Instance| fit_at(objects, at, first);
            let counts = self.told.entry(walk.goals[first].modality).or_default();
            counts[0] += usize::from(fit(a) > fit(b) && fit(a) > fit(c));
            counts[1] += 1;
        }
    }
}

fn place<'a>(walk: &'a Walk, goal: &Goal) -> Option<&'a Instance> {
    walk.instances.iter().find(|instance| goal.right.contains(&instance.id))
}

/// How well the best of the things where an instance stands fits a goal.
fn fit_at(objects: &Objects, at: &Instance, goal: usize) -> f32 {
    let near = objects.all().iter().filter(|object| object.thing.distance_m(at.center()) <= AT_M);
    near.map(|object| object.vis(goal)).fold(0.0, f32::max)
}

/// The instance that a remembered thing is.
fn instance<'a>(walk: &'a Walk, object: &Object) -> Option<&'a Instance> {
    let overlaps = walk.instances.iter().map(|instance| (instance.overlap(&object.thing), instance));
    let (overlap, best) = overlaps.max_by(|a, b| a.0.total_cmp(&b.0))?;
    (overlap >= SAME).then_some(best)
}

pub(crate) fn print(names: &[&str], tallies: &[Tally]) {
    println!(
        "| goal | by | found among all things, % | among its category, % | by chance, % | n | told from two others, % | n |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for modality in [Modality::Category, Modality::Sentence, Modality::Picture] {
        for (name, tally) in names.iter().zip(tallies) {
            let [found, of_kind, all] = tally.found.get(&modality).copied().unwrap_or_default();
            let [told, asked] = tally.told.get(&modality).copied().unwrap_or_default();
            let chance = tally.chance.get(&modality).copied().unwrap_or_default();
            let percent = |share: f64, all: usize| format!("{:.1}", 100.0 * share / all.max(1) as f64);
            println!(
                "| {modality:?} | {name} | {} | {} | {} | {all} | {} | {asked} |",
                percent(found as f64, all),
                percent(of_kind as f64, all),
                percent(chance, all),
                percent(told as f64, asked)
            );
        }
    }
}
