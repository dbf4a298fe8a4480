use crate::PagNav;
use crate::agent::Claim;
use crate::planner::Stage;
use serde::Serialize;

/// What of the agent's state changes rarely.
#[derive(Clone, Default)]
pub(super) struct Moment {
    stage: Option<Stage>,
    focus: Option<usize>,
    claim: Option<Claim>,
    silent: Vec<bool>,
    located: Vec<bool>,
}

/// A change of that.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub(super) enum Event {
    Found { source: usize, goal: usize, object: usize },
    Missed { source: usize, goal: usize, object: usize },
    Silenced { source: usize },
    Located { source: usize },
    Stage { stage: Stage },
    Focus { source: Option<usize> },
    Claimed { source: usize, goal: usize, object: usize },
}

impl Moment {
    pub(super) fn of(agent: &PagNav) -> Self {
        let sources = 0..agent.sources.len();
        let is_located = |source: usize| {
            let estimate = agent.sources[source].estimate;
            !agent.turns.is_silent(source) && estimate.is_some_and(|e| agent.is_located(source, &e))
        };
        Self {
            stage: agent.thought.stage,
            focus: agent.focus,
            claim: agent.claim,
            silent: sources.clone().map(|source| agent.turns.is_silent(source)).collect(),
            located: sources.map(is_located).collect(),
        }
    }

    /// What happened from this moment to the next: first what was found out, then what was decided.
    pub(super) fn until(&self, next: &Self) -> Vec<Event> {
        let settled = self
            .claim
            .filter(|_| next.claim.is_none())
            .map(|claim| claim.settled(next.silent.get(claim.source) == Some(&true)));
        let silenced = risen(&self.silent, &next.silent).map(|source| Event::Silenced { source });
        let located = risen(&self.located, &next.located).map(|source| Event::Located { source });
        let stage = next.stage.filter(|_| self.stage != next.stage).map(|stage| Event::Stage { stage });
        let focus = (self.focus != next.focus).then_some(Event::Focus { source: next.focus });
        let known = settled.into_iter().chain(silenced).chain(located);
        let made = next.claim.filter(|_| self.claim.is_none()).map(Claim::made);
        known.chain(stage).chain(focus).chain(made).collect()
    }
}

impl Claim {
    fn made(self) -> Event {
        Event::Claimed { source: self.source, goal: self.goal, object: self.object }
    }

    fn settled(self, is_found: bool) -> Event {
        let Self { source, goal, object, .. } = self;
        if is_found { Event::Found { source, goal, object } } else { Event::Missed { source, goal, object } }
    }
}

/// Where something holds that did not hold before.
fn risen(before: &[bool], after: &[bool]) -> impl Iterator<Item = usize> {
    let pairs = before.iter().zip(after).enumerate();
    pairs.filter(|(_, (before, after))| !**before && **after).map(|(index, _)| index)
}
