use crate::agent::PagNav;
use avln_client::Action;
use avln_kit::{
    map::{Estimate, Occupancy},
    perception::{Place, Stand},
};

/// Within this distance of a believed source the way to it ends, metres.
const REACH_M: f32 = 0.5;
/// The same for a frontier, metres.
const FRONTIER_M: f32 = 0.2;
/// Nearer frontiers are seen past, metres.
const NEAR_M: f32 = 0.4;
/// Steps for which it keeps to a frontier.
const KEPT_STEPS: u32 = 12;

impl PagNav {
    /// Cue-guided search: towards a source, where the way there is known, else by way of the best frontier; at the
    /// source it looks around.
    pub(crate) fn search(&mut self, stand: &Stand) -> Action {
        let Some((source, estimate)) = self.choose(stand) else { return Action::TurnLeft };
        self.head_for(source);
        let is_there = estimate.certainty >= self.weights.certain
            && estimate.place.distance_m(stand.place) <= self.weights.arrived_m
            && self.map.hears(stand.place, estimate.place);
        if is_there {
            self.suppose(source, estimate.place);
        }
        let onward = self.go_to(estimate.place, is_there, stand);
        let onward = onward.or_else(|| self.face(stand, estimate.place).filter(|_| is_there));
        onward.unwrap_or(Action::TurnLeft)
    }

    /// A step towards a place: straight there where a way leads to where it can be seen, else by way of the best frontier.
    /// `None` where it has come as near as it can.
    pub(crate) fn go_to(&mut self, place: Place, is_seen: bool, stand: &Stand) -> Option<Action> {
        let way = self.course.way(&self.map, stand.place, place, REACH_M);
        let step = self.motion.along(&way, stand, &self.map);
        let end = way.places.last().copied().unwrap_or(stand.place);
        let leads_there = way.left_m <= self.weights.lost_m && self.map.hears(end, place);
        if is_seen || (leads_there && step.is_some()) {
            return step;
        }
        self.explore(place, stand).or(step)
    }

    /// Where a source was looked at in vain, since pictures show nothing there that could be it, something is supposed.
    fn suppose(&mut self, source: usize, place: Place) {
        const AT_M: f32 = 0.2;
        let is_known = || self.objects.all().iter().any(|object| object.thing.distance_m(place) <= AT_M);
        if self.is_settled(source) && !is_known() {
            self.objects.suppose(place);
        }
    }

    /// The source to head for: the right one where that is known, else one that has not been looked at, else any; of these
    /// the one that can be looked at first.
    fn choose(&self, stand: &Stand) -> Option<(usize, Estimate)> {
        let open = (0..self.sources.len()).filter(|&source| !self.turns.is_silent(source));
        let heard: Vec<(usize, Estimate)> =
            open.filter_map(|source| Some((source, self.sources[source].estimate?))).collect();
        let cost = |(source, estimate): &(usize, Estimate)| {
            let is_located = self.is_located(*source, estimate);
            let wait_steps = if is_located { 0 } else { self.turns.wait_steps(*source) };
            let doubt_steps = self.weights.doubt_steps * (1.0 - self.goals.right(*source));
            self.cost_steps(*source, estimate.place, wait_steps, stand) + doubt_steps
        };
        let first = |wanted: &dyn Fn(usize) -> bool| {
            let wanted = heard.iter().filter(|(source, _)| wanted(*source));
            wanted.min_by(|a, b| cost(a).total_cmp(&cost(b))).copied()
        };
        first(&|source| self.is_right_goal(source) && !self.is_settled(source))
            .or_else(|| first(&|source| !self.is_settled(source)))
            .or_else(|| first(&|source| self.is_right_goal(source) && self.is_looked_at(source)))
            .or_else(|| first(&|source| !self.is_looked_at(source)))
            .or_else(|| first(&|_| true))
    }

    /// Steps until something can be done at a source: the way to `place`, and `wait_steps` for its turn to sound.
    pub(crate) fn cost_steps(&self, source: usize, place: Place, wait_steps: u32, stand: &Stand) -> f32 {
        let walk_steps = place.distance_m(stand.place) * self.weights.steps_per_m;
        let loyalty_steps = if self.focus == Some(source) { self.weights.loyalty_steps } else { 0.0 };
        let vain_steps = self.weights.vain * self.sources[source].sought_steps as f32;
        walk_steps.max(wait_steps as f32) + vain_steps - loyalty_steps
    }

    /// Notes that this step goes to a source.
    pub(crate) fn head_for(&mut self, source: usize) {
        self.focus = Some(source);
        self.sources[source].sought_steps += 1;
    }

    /// Search without sound: by way of the frontier with the best S_search. When all has been seen, verification asks for
    /// less, and the map is drawn anew.
    pub(crate) fn wander(&mut self, stand: &Stand) -> Action {
        if let Some(step) = self.explore(stand.place, stand) {
            return step;
        }
        let goals: Vec<usize> = self.goals.active().collect();
        goals.into_iter().for_each(|goal| self.sources[goal].sought_steps += self.weights.patience_steps);
        self.map = Occupancy::default();
        Action::TurnLeft
    }

    /// A step towards the frontier with the best S_search, which is kept to for a while: x* of the paper.
    fn explore(&mut self, heard: Place, stand: &Stand) -> Option<Action> {
        let kept =
            self.frontier.filter(|(place, _, steps)| *steps > 0 && place.distance_m(stand.place) > NEAR_M);
        let best = kept.map(|(place, score, _)| (place, score)).or_else(|| self.frontier(heard, stand))?;
        let steps = kept.map_or(KEPT_STEPS, |(_, _, steps)| steps) - 1;
        self.frontier = Some((best.0, best.1, steps));
        self.thought.frontier = Some(best);
        let way = self.scouting.way(&self.map, stand.place, best.0, FRONTIER_M);
        self.motion.along(&way, stand, &self.map)
    }

    /// The frontier with the best S_search, and that.
    fn frontier(&self, heard: Place, stand: &Stand) -> Option<(Place, f32)> {
        const LOOKED_AT: usize = 8;
        let sound = |place: Place| {
            self.weights.search_audio * (-place.distance_m(heard) / self.weights.search_scale_m).exp()
                - self.weights.search_way * place.distance_m(stand.place)
        };
        let frontiers = self.map.frontiers().into_iter().map(|(place, _)| (sound(place), place));
        let mut scored: Vec<(f32, Place)> =
            frontiers.filter(|(_, place)| place.distance_m(stand.place) > NEAR_M).collect();
        scored.sort_by(|a, b| b.0.total_cmp(&a.0));
        scored.truncate(LOOKED_AT);
        for (score, place) in &mut scored {
            *score += self.weights.search_context * self.expects(*place);
        }
        scored.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).map(|(score, place)| (place, score))
    }

    /// What rooms and things around a frontier say for the goals that may be next (P_room and P_obj), 0 to 1.
    fn expects(&self, place: Place) -> f32 {
        let fits = self.goals.active().map(|goal| self.context(place, goal));
        fits.fold(0.0, f32::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planner::Weights;
    use avln_client::{DepthImage, Pose, TaskSpec};
    use avln_kit::perception::View;
    use std::f32::consts::FRAC_PI_2;

    const SIDE: u32 = 64;

    fn stand(position: [f32; 3]) -> Stand {
        Stand::new(&Pose { position, heading_rad: 0.0 })
    }

    /// An agent that has looked around in the middle of a closed room of 6 m by 6 m.
    fn agent() -> PagNav {
        let depth_m = |row: u32| match (row as f32 + 0.5 - 32.0) / 32.0 {
            down if down > 0.0 => (1.0 / down).min(3.02),
            _ => 3.02,
        };
        let metres = (0..SIDE * SIDE).map(|pixel| depth_m(pixel / SIDE)).collect();
        let depth = DepthImage { width: SIDE, height: SIDE, metres };
        let mut agent = PagNav::new(Weights::default());
        let task = TaskSpec { width: SIDE, height: SIDE, ..TaskSpec::default() };
        for quarter in 0..4 {
            let heading_rad = quarter as f32 * FRAC_PI_2;
            let stand = Stand::new(&Pose { position: [0.0; 3], heading_rad });
            (0..3).for_each(|_| agent.map.see(&View::new(&task), &stand, &depth));
        }
        agent
    }

    #[test]
    fn where_a_wall_ends_the_way_it_explores() {
        let mut agent = agent();
        let beyond = Place::new(0.0, -6.0);
        assert!(agent.go_to(beyond, false, &stand([0.0, 0.0, -1.0])).is_some());
        assert!(agent.thought.frontier.is_some());
    }

    #[test]
    fn where_a_way_leads_to_a_place_it_takes_it() {
        let mut agent = agent();
        let ahead = Place::new(0.0, -2.0);
        assert_eq!(agent.go_to(ahead, true, &stand([0.0; 3])), Some(Action::MoveForward));
        assert!(agent.go_to(ahead, false, &stand([0.0; 3])).is_some() && agent.thought.frontier.is_none());
        assert_eq!(agent.go_to(ahead, true, &stand([0.0, 0.0, -1.8])), None);
    }
}
