use crate::memory::Memory;
use avln_client::{Action, Agent, GoalCue, Mission, Observation, TaskSpec};
use avln_kit::perception::{Query, Words};

/// Fit from which on something is taken for a goal, 0 to 1.
const DETECTED: f32 = 0.6;
/// Looks over which the fit must hold.
const LOOKS: u32 = 2;

/// Explores by the nearest frontier until it sees something of a goal's category, goes there and submits. Hears nothing.
///
/// Modular as CoW (Gadre et al. 2023): exploration, a detector, and a way to what was detected. It is not CoW: the detector
/// is our own network, which knows the categories of the houses, and not CLIP; of sentences it takes the noun alone, as the
/// method's category baseline does; pictures, which name no category, are compared with the view.
#[derive(Default)]
pub struct Detector {
    memory: Option<Memory>,
}

impl Agent for Detector {
    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        let goals = mission.goals.iter().map(category_alone).collect();
        self.memory = Some(Memory::new(task, &Mission { goals, ..mission.clone() }));
    }

    fn act(&mut self, observation: &Observation) -> Action {
        let Some(memory) = &mut self.memory else { return Action::Stop };
        let in_view = memory.observe(observation);
        if memory.aim().is_none() {
            let detected = in_view.into_iter().filter(|&index| memory.objects.all()[index].looks >= LOOKS);
            let fits = detected.filter_map(|index| Some((index, memory.fit(index)?)));
            let best = fits.filter(|(_, (fit, _))| *fit >= DETECTED).max_by(|a, b| a.1.0.total_cmp(&b.1.0));
            best.into_iter().for_each(|(index, (_, goal))| memory.head_for(index, goal));
        }
        let onward = memory.pursue().unwrap_or_else(|| memory.scout.explore());
        let action = if observation.remaining_steps <= 1 { Action::Stop } else { onward };
        memory.scout.note(action);
        action
    }
}

/// The same cue with nothing but its category, where it has one.
fn category_alone(cue: &GoalCue) -> GoalCue {
    match Query::new(cue) {
        Query::Words(Words { category, .. }) => GoalCue::Category(category),
        Query::Picture { .. } => cue.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_a_sentence_the_noun_stays() {
        let sentence = GoalCue::Description("the large red sofa near the bed".into());
        assert_eq!(category_alone(&sentence), GoalCue::Category("sofa".into()));
    }
}
