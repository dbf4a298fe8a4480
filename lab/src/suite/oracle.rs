//! The oracle: a privileged agent that walks the reference tour, for the suite, rollouts and leaderboards' upper bounds.

use super::hints::{EpisodeState, LiveEpisodes, TrueHints, bearing_rad, claimable};
use super::host::{self, client_order, mission_of};
use avln_arena::actions::{TokenRequest, issue, note};
use avln_arena::challenge::actor;
use avln_arena::{Arena, Failure, FailureKind, data::DataFolder, dataset::SplitFolder, now_unix_ms};
use avln_client::{
    Action, Agent, Client, Mission, Observation, Play, Pose, RunOptions, RunSummary, Sensors, TaskSpec,
};
use avln_episode::{Order, Rules};
use avln_geom::{Point3, Vector2, angle};
use avln_referee::Referee;
use avln_store::{Phase, Reference, Run, RunState, Store, TokenHash, TokenScope};
use avln_truth::{EpisodeTruth, Target};
use avln_world::InstanceId;
use std::f32::consts::PI;
use std::sync::Arc;

/// A world position on the floor: x and z, metres.
pub type FloorPoint = [f32; 2];

/// Distance within which a path corner counts as passed, metres.
pub const PASSED_M: f32 = 0.15;
const HALF_TURN_RAD: f32 = 15.0 * PI / 180.0;

/// Returns the distance between two positions, metres.
pub fn distance_m(a: FloorPoint, b: FloorPoint) -> f32 {
    Vector2::from([a[0] - b[0], a[1] - b[1]]).norm()
}

/// A path follower for agents with a known start pose.
pub struct Walker {
    start: FloorPoint,
    start_heading_rad: f32,
    before: FloorPoint,
    last: Action,
    /// Actions that free a stuck body, in reverse order.
    way_out: Vec<Action>,
    /// Last place where the body was stuck, and how often in a row.
    stuck: (FloorPoint, usize),
}

impl Walker {
    /// Creates a walker at a start pose.
    pub fn new(start: FloorPoint, start_heading_rad: f32) -> Self {
        let nowhere = [f32::MAX; 2];
        let (last, stuck) = (Action::TurnLeft, (nowhere, 0));
        Self { start, start_heading_rad, before: nowhere, last, way_out: vec![], stuck }
    }

    /// Converts an observed pose to a world position and heading.
    pub fn locate(&self, pose: &Pose) -> (FloorPoint, f32) {
        let (sin, cos) = angle::sin_cos(self.start_heading_rad);
        let [x, _, z] = pose.position();
        let place = [self.start[0] + x * cos + z * sin, self.start[1] - x * sin + z * cos];
        (place, self.start_heading_rad + pose.heading_rad())
    }

    /// Returns the next action on a path. A stuck body turns and walks on.
    pub fn step(&mut self, pose: &Pose, path: &[FloorPoint]) -> Action {
        let (place, heading_rad) = self.locate(pose);
        let ahead = path.iter().copied().find(|corner| distance_m(*corner, place) >= PASSED_M);
        let aim = ahead.or(path.last().copied()).unwrap_or(place);
        let turn_rad = bearing_rad(place, heading_rad, aim);
        let toward = if turn_rad > 0.0 { Action::TurnLeft } else { Action::TurnRight };
        // Sliding along a wall moves the body a little: less than 2 cm means stuck.
        if self.last == Action::MoveForward && distance_m(self.before, place) < 0.02 {
            self.way_out = self.way_out_of(place, toward);
        }
        let aligned = turn_rad.abs() <= HALF_TURN_RAD + 1e-3;
        let action = self.way_out.pop().unwrap_or(if aligned { Action::MoveForward } else { toward });
        (self.before, self.last) = (place, action);
        action
    }

    /// Returns the actions that free a body stuck at `place`, in reverse order: one turn, and one more each time that it is stuck
    /// there again, until it has looked all around.
    fn way_out_of(&mut self, place: FloorPoint, toward: Action) -> Vec<Action> {
        const SAME_M: f32 = 0.5;
        const MOST_TURNS: usize = 11;
        let is_same = distance_m(self.stuck.0, place) < SAME_M;
        self.stuck = (place, if is_same { self.stuck.1 % MOST_TURNS + 1 } else { 1 });
        let turns = std::iter::repeat_n(toward, self.stuck.1);
        std::iter::once(Action::MoveForward).chain(turns).collect()
    }
}

/// An oracle that walks the reference tour and submits at the border of every success region. Its success proves that missions
/// are solvable and that rules, reference tours and regions are consistent.
pub(super) struct ShortestPath {
    hints: Arc<TrueHints>,
    walker: Walker,
    /// Tried positions per goal that were not accepted.
    tried: Vec<(usize, Point3<f32>)>,
}

impl ShortestPath {
    pub(super) fn new(hints: Arc<TrueHints>) -> Self {
        Self { hints, walker: Walker::new([0.0; 2], 0.0), tried: Vec::new() }
    }

    /// Returns the next action towards the tour's next goal.
    fn walk(&mut self, truth: &EpisodeTruth, now: &EpisodeState, seen: &Observation) -> Action {
        let Some(goal) = visits(truth).into_iter().find(|&goal| now.is_open[goal]) else {
            return Action::Stop;
        };
        let here = now.pose.position;
        let aim = self.aim(truth, goal, &here).unwrap_or(here);
        let ends = [here, aim].map(|end| now.assets.navmesh.snap(&end, 0.5));
        let path = match ends {
            [Some(from), Some(to)] => now.assets.navmesh.path(&from, &to).unwrap_or_default(),
            _ => Vec::new(),
        };
        self.walker.step(&seen.pose, &path.iter().map(flat).collect::<Vec<_>>())
    }

    /// Returns a goal's position on the tour; after a rejected Submit, the nearest untried position in the region.
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
        let truth = self.hints.now().map(|(truth, _)| truth);
        self.walker = truth.map_or_else(
            || Walker::new([0.0; 2], 0.0),
            |truth| Walker::new(flat(&truth.start.position), truth.start.heading_rad),
        );
        self.tried.clear();
    }

    fn act(&mut self, observation: &Observation) -> Action {
        let Some((truth, now)) = self.hints.now() else { return Action::Stop };
        let open: Vec<usize> = (0..truth.targets.len()).filter(|&goal| now.is_open[goal]).collect();
        let mut claimable = claimable(truth.order, &open).iter();
        let is_there = claimable.any(|&goal| is_in_region(&truth.targets[goal], &now, &self.hints.rules));
        match (is_there, open.len()) {
            (_, 0) | (true, 1) => Action::Stop,
            (true, _) => observation.claim(),
            (false, _) => self.walk(&truth, &now, observation),
        }
    }
}

fn is_in_region(target: &Target, now: &EpisodeState, rules: &Rules) -> bool {
    let instance = InstanceId(target.instance);
    let to_mesh_m = |eye: &Point3<f32>| now.assets.distance_to_mesh_m(eye, instance);
    let sees = |eye: &Point3<f32>, half_view_rad| now.assets.sees(eye, instance, half_view_rad);
    target.distance_within_region(&now.pose.position, rules, to_mesh_m, sees).is_some()
}

/// Returns the goals in the reference tour's order.
fn visits(truth: &EpisodeTruth) -> Vec<usize> {
    let mut goals: Vec<usize> = (0..truth.targets.len()).collect();
    if truth.order == Order::Unordered {
        goals.sort_by_key(|&goal| tour_corner(truth, goal));
    }
    goals
}

/// Returns the reference tour's corner in a goal's region.
fn tour_corner(truth: &EpisodeTruth, goal: usize) -> Option<usize> {
    let region = &truth.targets[goal].region;
    let is_in =
        |corner: &Point3<f32>| region.iter().any(|place| distance_m(flat(corner), flat(place)) < 1e-3);
    truth.reference_path.iter().position(is_in)
}

fn flat(place: &Point3<f32>) -> FloorPoint {
    [place.x, place.z]
}

/// The oracle for a single episode, without a server.
pub struct Oracle {
    live: Arc<LiveEpisodes>,
    agent: ShortestPath,
    has_begun: bool,
}

impl Oracle {
    /// Name in files.
    pub const NAME: &str = "shortest-path";
    const HANDLE: &str = "episode";

    /// Creates an oracle for an episode.
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
        let (pose, remaining_submits) = (self.pose(referee), referee.remaining_submits());
        let action = self.agent.act(&Observation { pose, remaining_submits, ..Observation::default() });
        // Client and server number the actions alike.
        avln_episode::Action::ALL[action as usize]
    }

    /// Returns the pose relative to the start, in the walker's frame under any rule set.
    fn pose(&self, referee: &Referee) -> Pose {
        let here = referee.world().pose();
        let relative = self.agent.hints.now().map_or(here, |(truth, _)| here.relative_to(&truth.start));
        Pose::new(relative.position.coords.into(), relative.heading_rad)
    }
}

/// Team of the oracle.
const TEAM: &str = "Oracle";
const VERSION: &str = env!("CARGO_PKG_VERSION");
/// Lifetime of the oracle's token, which is revoked after the runs, milliseconds.
const TOKEN_MS: i64 = 86_400_000;

/// Plays a phase with the oracle, as the upper bound on leaderboards, in the orders without a completed run of this version.
/// Passes every order to `on_run`, with the result of a new run. No server may use the folder.
///
/// # Errors
/// If a server uses the folder, there is no such phase, it accepts no runs, or a run fails.
pub async fn play_oracle(
    data: &DataFolder,
    phase: &str,
    on_run: &mut (dyn FnMut(Order, Option<&RunSummary>) + Send),
) -> Result<(), Failure> {
    // Before the database is opened, which may migrate it.
    let lock = data.lock()?;
    let store = data.store().await?;
    let phase = store.phases().await?.into_iter().find(|known| known.id == phase).ok_or_else(|| {
        Failure::new(FailureKind::Data, format!("there is no phase '{phase}'"))
            .hinted("list phases with: avln challenge show")
    })?;
    let missing = missing_orders(&store, &phase).await?;
    for &order in phase.orders.iter().filter(|order| !missing.contains(order)) {
        on_run(order, None);
    }
    if !missing.is_empty() {
        let arena = Arena::open_phase(lock, data, store.clone(), &phase.id).await?;
        let split = data.missions(&phase.split)?;
        play_orders(arena, &store, phase, split, &missing, on_run).await?;
    }
    store.close().await;
    Ok(())
}

/// Returns the orders without a completed run of this version's oracle.
async fn missing_orders(store: &Store, phase: &Phase) -> Result<Vec<Order>, Failure> {
    let is_ours = |run: &Run| {
        run.phase == phase.id
            && run.method.name == Oracle::NAME
            && run.method.version == VERSION
            && run.state == RunState::Completed
            && run.ruling.disqualified.is_none()
    };
    let mut missing = phase.orders.clone();
    for run in store.runs_of(TEAM).await?.iter().filter(|run| is_ours(run)) {
        missing.retain(|order| *order != run.order);
    }
    Ok(missing)
}

async fn play_orders(
    arena: Arena,
    store: &Store,
    phase: Phase,
    split: SplitFolder,
    orders: &[Order],
    on_run: &mut (dyn FnMut(Order, Option<&RunSummary>) + Send),
) -> Result<(), Failure> {
    let (servers, live) = host::serve(arena, store).await?;
    let token = admit_oracle(store, &phase).await?;
    let play = async {
        let client = Client::connect(servers.grpc_url(), token.as_str()).await.map_err(Failure::run)?;
        let oracle = OracleRuns { client, store: store.clone(), live, phase, split };
        for &order in orders {
            on_run(order, Some(&oracle.run(order).await?));
        }
        Ok::<_, Failure>(())
    };
    let played = play.await;
    // Also after a failure: a token that remains valid could start runs in the name of the oracle.
    let revoked = revoke(store, &token).await;
    servers.close().await?;
    played.and(revoked)
}

/// Admits and, where the phase requires it, approves the oracle's team; returns an account token.
async fn admit_oracle(store: &Store, phase: &Phase) -> Result<String, Failure> {
    let now = now_unix_ms();
    store.create_team(TEAM, Some(Reference::Oracle), now).await?;
    if phase.admission.approval {
        let what = format!("approved in phase {}", phase.id);
        let approved = note(&actor(), format!("team {TEAM}"), &what, "a reference does not compete");
        store.approve(&phase.id, TEAM, true, approved, now).await?;
    }
    let request = TokenRequest {
        kind: TokenScope::Participant,
        name: "leaderboard oracle",
        team: Some(TEAM),
        expires_unix_ms: Some(now + TOKEN_MS),
    };
    Ok(issue(store, &request, &actor(), now).await?)
}

async fn revoke(store: &Store, token: &str) -> Result<(), Failure> {
    let hash = TokenHash::of(token);
    let revoked = note(&actor(), format!("token {}", hash.id()), "revoked", "the oracle has played");
    Ok(store.revoke_token(hash.id(), revoked, now_unix_ms()).await?)
}

struct OracleRuns {
    client: Client,
    store: Store,
    live: Arc<LiveEpisodes>,
    phase: Phase,
    split: SplitFolder,
}

impl OracleRuns {
    async fn run(&self, order: Order) -> Result<RunSummary, Failure> {
        let options = RunOptions::new(&self.phase.id, Oracle::NAME).method_version(VERSION);
        let run = self.client.start_run(options.order(client_order(order))).await.map_err(Failure::run)?;
        let none = Sensors { rgb: false, depth: false, audio: false, ..Sensors::square(64) };
        let mut play = self.client.play(&run, none).await.map_err(Failure::run)?;
        let hints = Arc::new(TrueHints::new(self.live.clone(), self.phase.rules.clone()));
        while self.episode(&mut play, &hints, order).await? {}
        play.finish().await.map_err(Failure::run)
    }

    /// Plays the next episode. Returns `false` if there is none.
    async fn episode(&self, play: &mut Play, hints: &Arc<TrueHints>, order: Order) -> Result<bool, Failure> {
        let (task, run) = (play.task().clone(), play.run().to_owned());
        let Some(mut episode) = play.next_episode().await.map_err(Failure::run)? else { return Ok(false) };
        let handle = episode.id().to_owned();
        let spec = mission_of(&self.store, &self.split, &run, &handle).await?;
        hints.follow(&handle, spec.truth(order));
        let mut agent = ShortestPath::new(hints.clone());
        agent.begin(&task, episode.mission());
        while !episode.is_over() {
            let action = agent.act(episode.observation());
            episode.step(action).await.map_err(Failure::run)?;
        }
        self.live.forget(&handle);
        Ok(true)
    }
}
