//! Grounding: candidates of the active goals, S_ground, and viewpoints.

use crate::agent::PagNav;
use crate::candidate::{Candidate, Evidence, SoundSupport, best};
use crate::memory::Aim;
use crate::verify::Readiness;
use avln_client::Action;
use avln_client::nalgebra::Vector2;
use avln_kit::geometry::{FloorPoint, Pose2d};
use avln_kit::map::{Cell, NEUTRAL, ObjectHypothesis, ObjectMemory, range_m};
use avln_kit::path::ReachField;
use std::collections::BTreeMap;
use std::f32::consts::{PI, TAU};

/// A candidate is set aside after this many times `patience_steps`.
const MOST_PATIENCE: u32 = 3;
/// Distance from which every step counts as effort, metres; from afar one in so many steps.
const NEAR_M: f32 = 4.0;
const FAR_SHARE: u32 = 3;
/// Directions and distances of possible viewpoints around a candidate.
const DIRECTIONS: u32 = 16;
const RINGS: u32 = 3;
/// Distance to a viewpoint at which it is reached, and radius around a tried one without another, metres.
const AT_M: f32 = 0.3;
/// Steps for which a viewpoint stays the target.
const KEPT_STEPS: u32 = 25;
/// Least support of a source for an object at its place.
pub(crate) const LEAST_SUPPORT: f32 = 0.05;
/// Greatest path to a viewpoint, metres on open floor.
const FAR_M: f32 = 60.0;

impl PagNav {
    /// Returns o* = argmax S_ground over the candidates O_t(g) of the active goals.
    pub(crate) fn select(&self, pose: &Pose2d) -> Option<Candidate> {
        let kept = self.aim.as_ref().map(|aim| (aim.object, aim.goal));
        let candidates = self.mission.active().flat_map(|goal| {
            let all = self.here.objects.all().iter().enumerate();
            let associated = all.filter(move |(index, object)| {
                object.wrong_submits == 0
                    && object.vis(goal) >= self.weights.associate
                    && !self.is_set_aside(*index, object, goal)
            });
            associated.map(move |(index, object)| self.candidate(index, object, goal, pose))
        });
        best(candidates, kept, &self.weights)
    }

    /// Returns true for a candidate that was viewed without success, or sought for too long.
    fn is_set_aside(&self, index: usize, object: &ObjectHypothesis, goal: usize) -> bool {
        let is_supported =
            || self.source_of(object).is_some_and(|(source, sound)| self.is_heard(source, sound));
        let is_viewed = !self.ablation.no_gate && object.looks >= self.weights.verify_looks;
        let is_below = |floor: f32| object.vis(goal) < floor;
        let is_rejected = is_below(self.weights.verify_floor)
            || (is_below(self.weights.least_vis(false)) && !is_supported());
        let is_hurry = self.remaining_steps < self.weights.hurry_steps;
        let (sought_steps, most_steps) = (self.sought_steps(index, goal), self.most_steps());
        let is_late = sought_steps >= most_steps && (sought_steps >= 2 * most_steps || !is_supported());
        (is_viewed && is_rejected) || (!is_hurry && is_late)
    }

    /// Returns the steps after which a candidate is set aside, unless sound supports it.
    fn most_steps(&self) -> u32 {
        MOST_PATIENCE * self.weights.patience_steps
    }

    /// Returns true if a located source supports a candidate by `sound`, 0 to 1.
    fn is_heard(&self, source: usize, sound: f32) -> bool {
        const HEARD: f32 = 0.3;
        sound >= HEARD && self.here.sources[source].is_located(&self.weights)
    }

    /// Returns true if a located source supports the candidate.
    pub(crate) fn is_supported(&self, candidate: &Candidate) -> bool {
        candidate.source.is_some_and(|source| self.is_heard(source, candidate.evidence.sound))
    }

    /// Returns the steps spent on a candidate.
    pub(crate) fn sought_steps(&self, object: usize, goal: usize) -> u32 {
        self.here.sought.get(&(object, goal)).copied().unwrap_or(0)
    }

    /// Sets a candidate aside, until the rest was searched.
    pub(crate) fn set_aside(&mut self, candidate: &Candidate) {
        self.set_object_aside(candidate.object, candidate.goal);
        self.aim = None;
    }

    /// Sets an object aside for a goal: the first time, until a located source supports it.
    pub(crate) fn set_object_aside(&mut self, object: usize, goal: usize) {
        let most_steps = self.most_steps();
        *self.here.sought.entry((object, goal)).or_default() += most_steps;
    }

    /// Moves efforts, refutations, aim and open claim to the same objects in the new frame, and drops the others. Without efforts, the
    /// agent would wait at a candidate for ever.
    pub(crate) fn keep_efforts(&mut self, last: &ObjectMemory) {
        let index = |object: usize| {
            let seen = &last.all().get(object)?.detection;
            self.here.objects.all().iter().position(|other| other.detection.is_same(seen))
        };
        // Two objects of the last frame may be one now: the greater effort counts.
        let moved = |efforts: &BTreeMap<(usize, usize), u32>| {
            let mut kept = BTreeMap::new();
            for (&(object, goal), &steps) in efforts {
                if let Some(object) = index(object) {
                    let most: &mut u32 = kept.entry((object, goal)).or_default();
                    *most = steps.max(*most);
                }
            }
            kept
        };
        let [sought, waited] = [&self.here.sought, &self.here.waited].map(moved);
        let aim = self.aim.take().and_then(|aim| Some(Aim { object: index(aim.object)?, ..aim }));
        let object = self.pending.and_then(|pending| index(pending.object?));
        let refuted = last.all().iter().enumerate().filter(|(_, seen)| seen.wrong_submits > 0);
        let refuted: Vec<usize> = refuted.filter_map(|(seen, _)| index(seen)).collect();
        refuted.into_iter().for_each(|object| self.here.objects.refute(object));
        (self.here.sought, self.here.waited, self.aim) = (sought, waited, aim);
        if let Some(pending) = &mut self.pending {
            pending.object = object;
        }
    }

    fn candidate(&self, index: usize, object: &ObjectHypothesis, goal: usize, pose: &Pose2d) -> Candidate {
        let source = self.source_of(object);
        let sound = match source {
            Some((_, support)) => support,
            None if self.weights.switches.source_positions => 0.0,
            None => self.intensity(object),
        };
        let evidence = Evidence { vis: object.vis(goal), context: self.context(index, goal), sound };
        let source = source.map(|(source, _)| source);
        let estimate = source.and_then(|source| self.here.sources[source].estimate);
        let place = match estimate {
            Some(estimate) => object.detection.nearest(estimate.place),
            None => object.detection.facing(pose.place),
        };
        Candidate { object: index, goal, source, place, evidence }
    }

    /// Returns P_ctx(g | o, R, O), 0 to 1.
    pub(crate) fn context(&self, object: usize, goal: usize) -> f32 {
        if self.ablation.no_priors {
            return NEUTRAL;
        }
        let place = self.here.objects.all()[object].detection.center();
        let mix = self.here.rooms.around(&self.here.map, place);
        self.priors[goal].context(&self.here.objects, object, &mix)
    }

    /// Returns s_int(o, g), 0 to 1: the nearness of a source by the highest level around the object in the intensity memory.
    fn intensity(&self, object: &ObjectHypothesis) -> f32 {
        if self.ablation.has_no_search_by_sound() {
            return 0.0;
        }
        self.here.intensity.nearness(|place| object.detection.distance_m(place), self.weights.intensity_m)
    }

    /// Returns the estimated source with the best support for an object, and the support; `None` without any.
    fn source_of(&self, object: &ObjectHypothesis) -> Option<(usize, f32)> {
        if !self.weights.switches.source_positions {
            return None;
        }
        let supports = self.open_sources().filter(|&source| self.is_right_goal(source));
        let supports = supports.map(|source| (source, self.support(object, source)));
        supports.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, support)| *support >= LEAST_SUPPORT)
    }

    /// Returns an object's consistency with an estimated source, 0 to 1.
    pub(crate) fn support(&self, object: &ObjectHypothesis, source: usize) -> f32 {
        let known = &self.here.sources[source];
        let Some(estimate) = &known.estimate else { return 0.0 };
        let place = object.detection.nearest(estimate.place);
        let heard = SoundSupport {
            off_m: place.distance_m(estimate.place),
            certainty: estimate.certainty,
            loudest_range_m: range_m(known.intensity.loudest()),
            explained: known.intensity.supports(|listener| listener.distance_m(place)),
        };
        heard.consistency(&self.weights)
    }

    /// Counts a step towards a candidate, and keeps the viewpoint of the same candidate.
    pub(crate) fn aim_at(&mut self, candidate: &Candidate, pose: &Pose2d) {
        let (object, goal) = (candidate.object, candidate.goal);
        let is_near = candidate.place.distance_m(pose.place) <= NEAR_M;
        let effort = u32::from(is_near || self.step.is_multiple_of(FAR_SHARE));
        *self.here.sought.entry((object, goal)).or_default() += effort;
        if self.aim.as_ref().is_none_or(|aim| (aim.object, aim.goal) != (object, goal)) {
            self.aim = Some(Aim { object, goal, viewpoint: None, steps_left: 0, tried: Vec::new() });
        }
    }

    /// Returns a step towards the candidate's viewpoint, or the turn that faces the candidate.
    pub(crate) fn approach(&mut self, candidate: &Candidate, pose: &Pose2d) -> Action {
        let viewpoint = self.viewpoint(candidate, pose);
        let Some(viewpoint) = viewpoint else { return self.approach_directly(candidate, pose) };
        if viewpoint.distance_m(pose.place) > AT_M {
            let path = self.follower.path_to(&self.here.map, pose.place, viewpoint, 0.6 * AT_M);
            if let Some(step) = self.motion.follow(&path, pose, &self.here.map) {
                return step;
            }
        }
        if let Some(turn) = self.face(pose, candidate.place) {
            return turn;
        }
        if self.waited_steps(candidate) > 0 && self.readiness(candidate) == Readiness::Wait {
            return self.wait(candidate, pose);
        }
        // The view from here did not verify the candidate: the next viewpoint may.
        if let Some(aim) = &mut self.aim {
            aim.tried.push(viewpoint);
            aim.viewpoint = None;
        }
        self.motion.turn_toward(pose.bearing_rad(candidate.place)).unwrap_or(Action::TurnLeft)
    }

    /// Walks to the nearest reachable point of a candidate without a viewpoint; at its end the candidate is set aside.
    fn approach_directly(&mut self, candidate: &Candidate, pose: &Pose2d) -> Action {
        let has_tried = self.aim.as_ref().is_some_and(|aim| !aim.tried.is_empty());
        if !has_tried && let Some((step, _)) = self.path_step(candidate.place, pose) {
            return step;
        }
        let facing = self.face(pose, candidate.place);
        if facing.is_none() {
            self.set_aside(candidate);
        }
        facing.unwrap_or(Action::TurnLeft)
    }

    /// Returns the kept viewpoint of the aim, or chooses one.
    fn viewpoint(&mut self, candidate: &Candidate, pose: &Pose2d) -> Option<FloorPoint> {
        let aim = self.aim.as_ref()?;
        let kept = aim.viewpoint.filter(|_| aim.steps_left > 0);
        let is_kept = kept.is_some();
        let viewpoint = kept.or_else(|| self.best_viewpoint(candidate, &aim.tried, pose));
        let aim = self.aim.as_mut()?;
        aim.steps_left = if is_kept { aim.steps_left - 1 } else { KEPT_STEPS };
        aim.viewpoint = viewpoint;
        viewpoint
    }

    /// Returns the free and reachable position around a candidate that shows it from the newest side at the shortest way.
    fn best_viewpoint(
        &self,
        candidate: &Candidate,
        tried: &[FloorPoint],
        pose: &Pose2d,
    ) -> Option<FloorPoint> {
        let map = &self.here.map;
        let object = &self.here.objects.all()[candidate.object];
        let center = candidate.place;
        let field = ReachField::new(map, pose.place, FAR_M, true);
        let far_m = self.weights.view_far_m.min(self.weights.submit_m);
        let views = (0..DIRECTIONS * RINGS).filter_map(|index| {
            let direction_rad = (index % DIRECTIONS) as f32 * TAU / DIRECTIONS as f32;
            let share = (index / DIRECTIONS) as f32 / (RINGS - 1) as f32;
            let range_m = self.weights.view_near_m + share * (far_m - self.weights.view_near_m).max(0.0);
            let (sin, cos) = libm::sincosf(direction_rad);
            let place = snapped(center + Vector2::new(cos, sin) * range_m);
            let cell = Cell::at(place);
            let is_fit = map.is_free(cell)
                && !map.is_blocked(cell)
                && object.detection.distance_m(place) >= 0.5 * self.weights.view_near_m
                && tried.iter().all(|other| other.distance_m(place) > AT_M)
                && map.has_clear_line(place, center);
            let way_m = if is_fit { field.cost_m(place) } else { None }?;
            let seen = object.viewed_from().iter().chain(tried);
            let change_rad = seen.map(|&from| angle_rad(from - center, place - center)).fold(PI, f32::min);
            Some((change_rad / PI - self.weights.view_way * way_m, place))
        });
        views.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, place)| place)
    }
}

/// Returns the centre of a point's cell.
fn snapped(place: FloorPoint) -> FloorPoint {
    Cell::at(place).center()
}

/// Returns the angle between two directions, 0 to π.
fn angle_rad(a: Vector2<f32>, b: Vector2<f32>) -> f32 {
    libm::atan2f(a.perp(&b).abs(), a.dot(&b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::preset::Preset;
    use avln_client::{Agent, DepthImage, GoalCue, Mission, Pose, TaskSpec};
    use avln_kit::geometry::PinholeCamera;
    use avln_kit::map::expected_level;
    use avln_kit::perception::DetectedObject;
    use std::f32::consts::FRAC_PI_2;

    const SIDE: u32 = 64;

    fn pose(x: f32, z: f32) -> Pose2d {
        Pose2d::new(&Pose::new([x, 0.0, z], 0.0))
    }

    /// An agent in a closed room, 6 m by 6 m, with an object of this fit in the middle, seen from the given positions.
    fn agent(fit: f32, seen_from: &[Pose2d]) -> PagNav {
        let depth_m = |row: u32| match (row as f32 + 0.5 - 32.0) / 32.0 {
            down if down > 0.0 => (1.0 / down).min(3.02),
            _ => 3.02,
        };
        let metres = (0..SIDE * SIDE).map(|pixel| depth_m(pixel / SIDE)).collect();
        let depth = DepthImage { width: SIDE, height: SIDE, metres };
        let task = TaskSpec { width: SIDE, height: SIDE, ..TaskSpec::default() };
        let mut agent = PagNav::preset(Preset::PagNav);
        let goals = vec![GoalCue::Category("bed".to_owned()); 2];
        agent.begin(&task, &Mission { goals, ..Mission::default() });
        for quarter in 0..4 {
            let pose = Pose2d::new(&Pose::new([0.0; 3], quarter as f32 * FRAC_PI_2));
            (0..3).for_each(|_| agent.here.map.see(&PinholeCamera::new(&task), &pose, &depth));
        }
        for from in seen_from {
            let seen = DetectedObject {
                min: FloorPoint::new(-0.1, -0.1),
                max: FloorPoint::new(0.1, 0.1),
                high_m: 0.6,
                embedding: vec![1.0],
                views: 1,
                ..DetectedObject::default()
            };
            agent.here.objects.recognise(from, vec![seen], |_, goal| if goal == 0 { fit } else { 0.0 });
        }
        agent
    }

    #[test]
    fn candidates_need_no_sound() {
        let here = pose(0.0, 2.0);
        let candidate = agent(0.9, &[here]).select(&here).expect("a candidate");
        assert_eq!((candidate.object, candidate.goal, candidate.source), (0, 0, None));
        assert_eq!((candidate.evidence.vis, candidate.evidence.sound), (0.9, 0.0));
        assert_eq!(agent(0.1, &[here]).select(&here), None);
    }

    #[test]
    fn levels_near_a_candidate_support_it() {
        let here = pose(0.0, 2.0);
        let mut agent = agent(0.9, &[here]);
        agent.here.intensity.hear(FloorPoint::new(0.5, 0.5), expected_level(3.0));
        agent.here.intensity.hear(FloorPoint::new(0.0, 2.0), expected_level(1.0));
        assert!((agent.select(&here).unwrap().evidence.sound - 0.5).abs() < 1e-3);
        agent.ablation.no_search_sound = true;
        assert_eq!(agent.select(&here).unwrap().evidence.sound, 0.0);
    }

    #[test]
    fn viewed_candidates_below_the_floor_are_set_aside() {
        let views: Vec<Pose2d> = (0..3).map(|step| pose(0.4 * step as f32, 2.0)).collect();
        let mut agent = agent(0.22, &views);
        agent.weights.plausible = 0.0;
        assert_eq!(agent.select(&views[0]), None);
        agent.weights.verify_looks = 4;
        assert!(agent.select(&views[0]).is_some());
    }

    #[test]
    fn viewpoints_show_a_new_side() {
        let here = pose(0.0, 1.2);
        let agent = agent(0.9, &[here, pose(0.2, 1.2), pose(-0.2, 1.2)]);
        let candidate = agent.select(&here).unwrap();
        let view = agent.best_viewpoint(&candidate, &[], &here).expect("a viewpoint");
        let range_m = view.distance_m(candidate.place);
        assert!(angle_rad(here.place - candidate.place, view - candidate.place) > 0.5, "{view:?}");
        assert!(range_m > 0.7 && range_m <= agent.weights.submit_m + 0.05, "{range_m}");
        let next = agent.best_viewpoint(&candidate, &[view], &here).expect("another viewpoint");
        assert!(next.distance_m(view) > AT_M);
    }

    #[test]
    fn efforts_follow_objects_into_the_next_frame() {
        let here = pose(0.0, 2.0);
        let (mut agent, before) = (agent(0.9, &[here]), agent(0.9, &[here]).here.objects);
        let candidate = agent.select(&here).unwrap();
        agent.aim_at(&candidate, &here);
        agent.here.waited.insert((0, 0), 7);
        agent.keep_efforts(&before);
        assert!(agent.sought_steps(0, 0) > 0 && agent.waited_steps(&candidate) == 7 && agent.aim.is_some());
        agent.here.objects = ObjectMemory::new(2);
        agent.keep_efforts(&before);
        assert!(agent.sought_steps(0, 0) == 0 && agent.waited_steps(&candidate) == 0 && agent.aim.is_none());
    }

    #[test]
    fn merged_objects_keep_the_greater_effort() {
        let part = |x0: f32, x1: f32| DetectedObject {
            min: FloorPoint::new(x0, -0.1),
            max: FloorPoint::new(x1, 0.1),
            high_m: 0.6,
            embedding: vec![1.0],
            views: 1,
            ..DetectedObject::default()
        };
        let (mut agent, here, mut last) = (agent(0.9, &[]), pose(0.0, 2.0), ObjectMemory::new(2));
        last.recognise(&here, vec![part(-0.3, -0.2), part(0.2, 0.3)], |_, _| 0.9);
        last.refute(1);
        agent.here.objects.recognise(&here, vec![part(-0.3, 0.3)], |_, _| 0.9);
        agent.here.waited.extend([((0, 0), 7), ((1, 0), 3)]);
        agent.keep_efforts(&last);
        assert_eq!(agent.here.waited, BTreeMap::from([((0, 0), 7)]));
        assert_eq!(agent.here.objects.all()[0].wrong_submits, 1);
    }

    #[test]
    fn late_candidates_are_set_aside() {
        let here = pose(0.0, 2.0);
        let mut agent = agent(0.9, &[here]);
        let candidate = agent.select(&here).unwrap();
        for _ in 0..MOST_PATIENCE * agent.weights.patience_steps {
            assert!(agent.select(&here).is_some());
            agent.aim_at(&candidate, &here);
        }
        assert_eq!(agent.select(&here), None);
    }
}
