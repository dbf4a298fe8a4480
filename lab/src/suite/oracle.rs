use super::{
    live_episodes::{EpisodeState, LiveEpisodes, TrueHints},
    walk::{PASSED_M, Walker, distance_m},
};
use avln_client::{Action, Agent, Mission, Observation, Pose, TaskSpec};
use avln_episode::{Order, Rules};
use avln_geom::Point3;
use avln_referee::Referee;
use avln_truth::{EpisodeTruth, Target};
use avln_world::InstanceId;
use std::sync::Arc;

/// An oracle that walks the reference tour and submits at the border of every success region. Its success proves that missions are
/// solvable and that rules, reference tours and regions are consistent.
pub(super) struct ShortestPath {
    hints: Arc<TrueHints>,
    walker: Walker,
    /// Tried positions per goal that were not accepted.
    tried: Vec<(usize, Point3<f32>)>,
}

/// The oracle for a single episode, without a server.
pub struct Oracle {
    live: Arc<LiveEpisodes>,
    agent: ShortestPath,
    has_begun: bool,
}

impl Oracle {
    /// Name of the variant, for files.
    pub const NAME: &str = "shortest-path";
    /// Name of its only episode between the live run and the hints.
    const HANDLE: &str = "episode";

    /// An oracle for the episode of this truth.
    pub fn new(truth: EpisodeTruth, rules: &Rules) -> Self {
        let live = Arc::new(LiveEpisodes::default());
        let hints = TrueHints::new(live.clone(), rules.clone());
        hints.follow(Self::HANDLE, truth);
        Self { live, agent: ShortestPath::new(Arc::new(hints)), has_begun: false }
    }

    /// Returns the next action for the referee's current pose.
    pub fn choose(&mut self, referee: &Referee) -> avln_episode::Action {
        self.live.note(Self::HANDLE, referee);
        if !self.has_begun {
            self.agent.begin(&TaskSpec::default(), &Mission::default());
            self.has_begun = true;
        }
        match self.agent.act(&Observation { pose: self.told_pose(referee), ..Observation::default() }) {
            Action::MoveForward => avln_episode::Action::MoveForward,
            Action::TurnLeft => avln_episode::Action::TurnLeft,
            Action::TurnRight => avln_episode::Action::TurnRight,
            Action::Submit => avln_episode::Action::Submit,
            Action::Stop => avln_episode::Action::Stop,
        }
    }

    /// The pose relative to the start, in whatever frame agents are told theirs.
    fn told_pose(&self, referee: &Referee) -> Pose {
        let here = referee.world().pose();
        let told = self.agent.hints.now().map_or(here, |(truth, _)| here.relative_to(&truth.start));
        Pose { position: told.position.coords.into(), heading_rad: told.heading_rad }
    }
}

impl ShortestPath {
    pub(super) fn new(hints: Arc<TrueHints>) -> Self {
        Self { hints, walker: Walker::new([0.0; 2], 0.0), tried: Vec::new() }
    }

    /// Returns the next action towards the next goal of the tour.
    fn walk(&mut self, truth: &EpisodeTruth, now: &EpisodeState, seen: &Observation) -> Action {
        let Some(goal) = visits(truth).into_iter().find(|&goal| now.is_open[goal]) else {
            return Action::Stop;
        };
        let here = now.pose.position;
        let aim = self.aim(truth, goal, &here).unwrap_or(here);
        let ends = [here, aim].map(|end| now.assets.navmesh.snap(&end, 0.5));
        let leg = match ends {
            [Some(from), Some(to)] => now.assets.navmesh.path(&from, &to).unwrap_or_default(),
            _ => Vec::new(),
        };
        self.walker.step(&seen.pose, &leg.iter().map(flat).collect::<Vec<_>>())
    }

    /// Returns the position of a goal on the tour; after a rejected Submit, the nearest untried position of its region.
    fn aim(&mut self, truth: &EpisodeTruth, goal: usize, here: &Point3<f32>) -> Option<Point3<f32>> {
        let corner = tour_corner(truth, goal).map(|corner| truth.reference_path[corner]);
        let places: Vec<_> = corner.iter().chain(&truth.targets[goal].region).copied().collect();
        let away_m = |place: &Point3<f32>| distance_m(flat(place), flat(here));
        let passed = places.iter().filter(|place| away_m(place) < PASSED_M);
        self.tried.extend(passed.map(|place| (goal, *place)));
        let open = |place: &Point3<f32>| !self.tried.contains(&(goal, *place));
        let nearest = || places.iter().copied().filter(open).min_by(|a, b| away_m(a).total_cmp(&away_m(b)));
        corner.filter(open).or_else(nearest)
    }
}

impl Agent for ShortestPath {
    fn begin(&mut self, _task: &TaskSpec, _mission: &Mission) {
        let walker = self
            .hints
            .now()
            .map(|(truth, _)| Walker::new(flat(&truth.start.position), truth.start.heading_rad));
        (self.walker, self.tried) = (walker.unwrap_or(Walker::new([0.0; 2], 0.0)), Vec::new());
    }

    fn act(&mut self, observation: &Observation) -> Action {
        let Some((truth, now)) = self.hints.now() else { return Action::Stop };
        let open: Vec<usize> = (0..truth.targets.len()).filter(|&goal| now.is_open[goal]).collect();
        let claimable = if truth.order == Order::Ordered { &open[..open.len().min(1)] } else { &open[..] };
        let is_there =
            claimable.iter().any(|&goal| is_in_region(&truth.targets[goal], &now, &self.hints.rules));
        match (is_there, open.len()) {
            (_, 0) | (true, 1) => Action::Stop,
            (true, _) => Action::Submit,
            (false, _) => self.walk(&truth, &now, observation),
        }
    }
}

fn is_in_region(target: &Target, now: &EpisodeState, rules: &Rules) -> bool {
    let sees =
        |eye: &Point3<f32>, half_view_rad| now.assets.sees(eye, InstanceId(target.instance), half_view_rad);
    target.distance_within_region(&now.pose.position, rules, sees).is_some()
}

/// Returns the goals in the order of the reference tour.
fn visits(truth: &EpisodeTruth) -> Vec<usize> {
    let mut goals: Vec<usize> = (0..truth.targets.len()).collect();
    if truth.order == Order::Unordered {
        goals.sort_by_key(|&goal| tour_corner(truth, goal));
    }
    goals
}

/// Returns the corner of the reference tour in the region of a goal.
fn tour_corner(truth: &EpisodeTruth, goal: usize) -> Option<usize> {
    let region = &truth.targets[goal].region;
    let is_in =
        |corner: &Point3<f32>| region.iter().any(|place| distance_m(flat(corner), flat(place)) < 1e-3);
    truth.reference_path.iter().position(is_in)
}

fn flat(place: &Point3<f32>) -> [f32; 2] {
    [place.x, place.z]
}
