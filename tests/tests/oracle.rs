//! The oracle knows everything, follows the shortest tour through the real protocol, and must succeed: this proves
//! that every mission can be solved and that rules, references and regions agree with each other.

use avln_client::{Action, Arena, Order, Pose, RunOptions, Sensors};
use avln_server::arena::{data::DataFolder, register};
use avln_tests::{House, PHASE, Plan};
use avln_truth::Target;

/// A place on the floor: x and z in the world, metres.
type Place = [f32; 2];

/// Follows a polyline; knows where the body is from the start pose and what the agent is told.
struct Walker {
    start: Place,
    start_heading_rad: f32,
    corners: Vec<Place>,
    next: usize,
}

/// A corner nearer than this is passed, metres.
const PASSED_M: f32 = 0.2;
const HALF_TURN_RAD: f32 = 15.0 * std::f32::consts::PI / 180.0;

fn distance_m(a: Place, b: Place) -> f32 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

impl Walker {
    /// The told pose in the world: place and heading.
    fn locate(&self, told: &Pose) -> (Place, f32) {
        let (sin, cos) = self.start_heading_rad.sin_cos();
        let [x, _, z] = told.position;
        let place = [self.start[0] + x * cos + z * sin, self.start[1] - x * sin + z * cos];
        (place, self.start_heading_rad + told.heading_rad)
    }

    /// The next move along the corners; at the last one, toward `inner`.
    fn step(&mut self, told: &Pose, inner: Place) -> Action {
        let (place, heading_rad) = self.locate(told);
        while self.next < self.corners.len() && distance_m(self.corners[self.next], place) < PASSED_M {
            self.next += 1;
        }
        let aim = self.corners.get(self.next).copied().unwrap_or(inner);
        let bearing_rad = (place[0] - aim[0]).atan2(place[1] - aim[1]);
        let turn_rad = (bearing_rad - heading_rad + std::f32::consts::PI).rem_euclid(std::f32::consts::TAU)
            - std::f32::consts::PI;
        match turn_rad {
            turn if turn > HALF_TURN_RAD + 1e-3 => Action::TurnLeft,
            turn if turn < -HALF_TURN_RAD - 1e-3 => Action::TurnRight,
            _ => Action::MoveForward,
        }
    }
}

/// The place of the region nearest to the target's box: where one goes when the tour's own point is not enough.
fn innermost(target: &Target) -> Place {
    let nearest = |a: &&_, b: &&_| target.bounds.distance_m(a).total_cmp(&target.bounds.distance_m(b));
    let place = target.region.iter().min_by(nearest).expect("regions have places");
    [place.x, place.z]
}

async fn play(house: &House, order: Order) -> avln_client::RunSummary {
    let data = DataFolder::open(house.folder.path()).expect("the data folder");
    let split = data.split(PHASE).expect("its split");
    let rules = register::rules_of(&split).expect("its rules");
    let arena = Arena::connect(house.agents_url(), &house.token).await.expect("the door is open");
    let run = arena.start_run(RunOptions::new(PHASE, "oracle").order(order)).await.expect("a run");
    let blind = Sensors { rgb: false, depth: false, audio: false, ..Sensors::default() };
    let mut play = arena.play(&run, blind).await.expect("a stream");
    while let Some(mut episode) = play.next_episode().await.expect("an episode or the end") {
        let spec = &split.episodes[episode.ordinal() as usize - 1];
        let truth = spec
            .truth(if order == Order::Ordered { "ordered" } else { "unordered" }.parse().expect("an order"));
        let assets = split.scene(&spec.scene).expect("its scene").open(&rules).expect("it opens");
        let mut walker = Walker {
            start: [truth.start.position.x, truth.start.position.z],
            start_heading_rad: truth.start.heading_rad,
            corners: truth.reference_path.iter().map(|corner| [corner.x, corner.z]).collect(),
            next: 0,
        };
        let mut open: Vec<usize> = (0..truth.targets.len()).collect();
        while !episode.is_over() {
            let told = episode.observation().pose;
            let (place, _) = walker.locate(&told);
            let mut base = truth.start.position;
            (base.x, base.y, base.z) = (place[0], truth.start.position.y + told.position[1], place[1]);
            let candidates = if order == Order::Ordered { &open[..1] } else { &open[..] };
            let reached = candidates.iter().copied().filter_map(|goal| {
                let target: &Target = &truth.targets[goal];
                let object = assets.scene.objects.iter().find(|object| object.id.0 == target.instance)?;
                let sees = |eye: &_, half_view_rad| assets.sees(eye, object.id, half_view_rad);
                Some((target.distance_within_region(&base, &rules, sees)?, goal))
            });
            let here = reached.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, goal)| goal);
            let action = match here {
                Some(_) if open.len() == 1 => Action::Stop,
                Some(goal) => {
                    open.retain(|&other| other != goal);
                    Action::Submit
                }
                None => walker.step(&told, innermost(&truth.targets[open[0]])),
            };
            episode.step(action).await.expect("a legal step");
        }
    }
    play.finish().await.expect("a summary")
}

async fn oracle_succeeds(order: Order) {
    let house = House::open(&Plan { houses: 3, missions: 4, ..Plan::default() }).await;
    let summary = play(&house, order).await;
    let value = |name: &str| {
        summary
            .metric(name)
            .map(|metric| metric.value)
            .unwrap_or_else(|| panic!("{name} is shown: {summary}"))
    };
    assert_eq!(value("sr"), 1.0, "{summary}");
    assert_eq!(value("osr"), 1.0, "{summary}");
    assert!(value("spl") > 0.9, "{summary}");
    house.doors.close().await.expect("both doors close");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_oracle_completes_every_ordered_mission_on_a_short_path() {
    oracle_succeeds(Order::Ordered).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_oracle_completes_every_unordered_mission_on_a_short_path() {
    oracle_succeeds(Order::Unordered).await;
}
