use crate::agent::{Claim, PagNav};
use crate::map::{Estimate, range_m};
use crate::perception::{Place, Query, Stand};
use crate::planner::path;
use avln_client::{Action, Observation};

/// Steps of sound whose mean tells how loud it is here.
const RECENT: usize = 3;
/// Within this distance of a believed source the way to it ends, metres.
const REACH_M: f32 = 0.5;
/// Looks at a source after which its association with goals is settled.
const LOOKS: u32 = 3;

/// The stages of the paper. Search looks for a source; Ground walks up to it, where what is seen updates the pairing
/// of sources and goals; Verify claims it through a gate that is acoustic, where the paper's is visual.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Search,
    Ground,
    Verify,
}

/// What a Submit depends on, besides the goal.
#[derive(Clone, Copy, Debug)]
struct Gate {
    /// The source is heard now.
    sounds: bool,
    /// No wall lies between.
    in_sight: bool,
    /// Distance to the believed source, metres.
    distance_m: f32,
    /// Distance that the loudness allows, metres.
    range_m: f32,
}

impl Gate {
    fn is_open(&self, limit_m: f32, range_limit_m: f32) -> bool {
        self.sounds && self.in_sight && self.distance_m <= limit_m && self.range_m <= range_limit_m
    }
}

impl PagNav {
    /// The next action.
    pub(crate) fn decide(&mut self, observation: &Observation, stand: &Stand) -> Action {
        if observation.remaining_steps <= 1 {
            return Action::Stop;
        }
        let in_hurry = observation.remaining_steps < self.weights.hurry_steps;
        let Some((focus, estimate)) = self.choose(stand, in_hurry) else { return Action::TurnLeft };
        self.sources[focus].sought_steps += 1;
        let way = path(&self.map, stand.place, estimate.place, REACH_M);
        let step = self.motion.along(&way, stand, &self.map);
        match self.stage(focus, &estimate, stand, step.is_none()) {
            Stage::Verify if self.may_submit(focus, in_hurry) => {
                self.face(stand, estimate.place).unwrap_or_else(|| {
                    self.claim = Some(Claim { source: focus, level: self.level() });
                    Action::Submit
                })
            }
            Stage::Ground | Stage::Verify => {
                step.or(self.face(stand, estimate.place)).unwrap_or(Action::TurnLeft)
            }
            Stage::Search => step
                .filter(|_| way.left_m <= self.weights.lost_m)
                .or_else(|| self.explore(focus, estimate.place, stand))
                .or(step)
                .unwrap_or(Action::TurnLeft),
        }
    }

    /// The source to head for: the right one once that is known, before that the one that can be looked at first.
    fn choose(&mut self, stand: &Stand, in_hurry: bool) -> Option<(usize, Estimate)> {
        let open = (0..self.sources.len()).filter(|&index| !self.turns.is_silent(index));
        let heard: Vec<(usize, Estimate)> =
            open.filter_map(|index| Some((index, self.sources[index].estimate?))).collect();
        let wanted =
            heard.iter().filter(|(index, _)| self.may_submit(*index, in_hurry) || !self.is_settled(*index));
        let cost = |(index, estimate): &(usize, Estimate)| self.cost_steps(*index, estimate, stand);
        let best = wanted.min_by(|a, b| cost(a).total_cmp(&cost(b))).or(heard.first()).copied();
        self.focus = best.map(|(index, _)| index);
        best
    }

    /// Steps until a source can be claimed: the way there, and its turn to sound.
    fn cost_steps(&self, index: usize, estimate: &Estimate, stand: &Stand) -> f32 {
        let walk_steps = estimate.place.distance_m(stand.place) * self.weights.steps_per_m;
        let loyalty_steps = if self.focus == Some(index) { self.weights.loyalty_steps } else { 0.0 };
        let vain_steps = self.weights.vain * self.sources[index].sought_steps as f32;
        walk_steps.max(self.turns.wait_steps(index) as f32) + vain_steps - loyalty_steps
    }

    /// Whether a source has been looked at often enough, or sought for so long that it will not be.
    fn is_settled(&self, index: usize) -> bool {
        let source = &self.sources[index];
        source.looks >= LOOKS || source.sought_steps >= self.weights.patience_steps
    }

    /// Whether a Submit at a source is likely to be for the right goal, as far as that can still be found out.
    fn may_submit(&self, index: usize, in_hurry: bool) -> bool {
        let right = self.goals.right(index);
        let open = || (0..self.sources.len()).filter(|&other| !self.turns.is_silent(other));
        let no_better = || open().all(|other| self.goals.right(other) <= right);
        let all_settled = in_hurry || open().all(|other| self.is_settled(other));
        right >= self.weights.commit || (all_settled && no_better())
    }

    fn stage(&self, index: usize, estimate: &Estimate, stand: &Stand, at_end: bool) -> Stage {
        if estimate.certainty < self.weights.submit_certainty {
            return Stage::Search;
        }
        match self.is_near(index, estimate, stand, at_end) {
            true => Stage::Verify,
            false if estimate.place.distance_m(stand.place) <= self.weights.submit_range_m => Stage::Ground,
            false => Stage::Search,
        }
    }

    /// Near enough, without a wall between, and loud enough to be in sight. The paper asks for a visual match here; what
    /// was seen enters through [`Self::may_submit`] alone, which tells goals apart in ordered missions.
    fn is_near(&self, index: usize, estimate: &Estimate, stand: &Stand, at_end: bool) -> bool {
        let weights = &self.weights;
        let nearer = weights.nearer.powi(self.sources[index].wrong_submits);
        let patience = if self.sources[index].sought_steps < weights.patience_steps { 1.0 } else { 1.3 };
        let limit_m = nearer * if at_end { weights.submit_blocked_m } else { weights.submit_m };
        let gate = Gate {
            sounds: self.turns.current() == index && self.levels.len() >= RECENT,
            in_sight: self.map.hears(stand.place, estimate.place),
            distance_m: estimate.place.distance_m(stand.place),
            range_m: range_m(self.level()),
        };
        gate.is_open(limit_m, patience * weights.submit_range_m)
    }

    /// The turn that brings a place into view; `None` when it is.
    fn face(&self, stand: &Stand, place: Place) -> Option<Action> {
        let bearing_rad = stand.bearing_rad(place);
        self.motion.toward(bearing_rad).filter(|_| bearing_rad.abs() > self.weights.submit_rad)
    }

    /// A step towards the frontier from which the believed source is most likely to be found (S_search of the paper).
    fn explore(&mut self, source: usize, goal: Place, stand: &Stand) -> Option<Action> {
        const LOOKED_AT: usize = 8;
        const NEAR_M: f32 = 0.4;
        let weights = &self.weights;
        let heard = |place: Place| {
            weights.search_audio * (-place.distance_m(goal) / weights.search_scale_m).exp()
                - weights.search_way * place.distance_m(stand.place)
        };
        let frontiers = self.map.frontiers().into_iter().map(|(place, _)| (heard(place), place));
        let mut scored: Vec<(f32, Place)> =
            frontiers.filter(|(_, place)| place.distance_m(stand.place) > NEAR_M).collect();
        scored.sort_by(|a, b| b.0.total_cmp(&a.0));
        scored.truncate(LOOKED_AT);
        let query = self.queries.get(self.goals.next().unwrap_or(source))?;
        for (score, place) in &mut scored {
            *score += weights.search_context * self.context(*place, query);
        }
        let (_, best) = scored.into_iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
        let way = path(&self.map, stand.place, best, 0.2);
        self.motion.along(&way, stand, &self.map)
    }

    /// What rooms and things around a frontier say for a goal (P_room and P_obj of the paper), 0 to 1.
    fn context(&self, place: Place, query: &Query) -> f32 {
        match query {
            Query::Words(words) => self.things.expects(place, words),
            Query::Picture { .. } => 0.0,
        }
    }

    /// Level of the current source here, over the last steps.
    pub(crate) fn level(&self) -> f32 {
        let recent = &self.levels[self.levels.len().saturating_sub(RECENT)..];
        recent.iter().sum::<f32>() / recent.len().max(1) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gate_opens_only_when_all_is_right() {
        for case in 0..16 {
            let right = |bit: u32| case >> bit & 1 == 1;
            let gate = Gate {
                sounds: right(0),
                in_sight: right(1),
                distance_m: if right(2) { 1.2 } else { 1.3 },
                range_m: if right(3) { 2.0 } else { 2.3 },
            };
            assert_eq!(gate.is_open(1.2, 2.2), case == 15, "{gate:?}");
        }
    }
}
