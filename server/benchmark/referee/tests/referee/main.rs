//! The referee from outside, on a hand-made floor: three boxes far apart, with the body in between. Replays.

mod facts;
mod rules;

use avln_episode::{
    Action::{self, MoveForward, Stop, Submit, TurnLeft},
    GoalCue, Mission, Modality, Order, Point3, Pose, Rules, Sensors,
};
use avln_referee::{Audio, Referee, RefereeError, StepOutcome};
use avln_truth::{EpisodeTruth, Record, Target};
use avln_world::{Aabb, Attributes, Body, InstanceId, Lighting, Material, Mesh, Object, Scene, SceneAssets};
use std::sync::{Arc, LazyLock};

const HALF_FLOOR_M: f32 = 10.0;
/// Centres of the three targets on the floor (x, z): ahead, to the left and to the right of the start.
const PLACES: [(f32, f32); 3] = [(0.0, -5.0), (-5.0, 0.0), (5.0, 0.0)];
/// Centre of another object in the first target's category, 6 m behind the start and 6 m to its right.
const DISTRACTOR: (f32, f32) = (6.0, 6.0);

fn quad(mesh: &mut Mesh, corners: [[f32; 3]; 4], instance: InstanceId) {
    let first = mesh.positions.len() as u32;
    for [x, y, z] in corners {
        mesh.positions.push(Point3::new(x, y, z));
        mesh.uvs.push(Default::default());
        mesh.colors.push([255; 3]);
    }
    for triangle in [[0, 1, 2], [0, 2, 3]] {
        mesh.triangles.push(triangle.map(|corner| first + corner));
        mesh.material_of.push(0);
        mesh.instance_of.push(instance);
    }
}

fn cube(mesh: &mut Mesh, b: &Aabb, instance: InstanceId) {
    let (l, h) = (b.min, b.max);
    quad(mesh, [[l.x, h.y, h.z], [h.x, h.y, h.z], [h.x, h.y, l.z], [l.x, h.y, l.z]], instance);
    quad(mesh, [[l.x, l.y, h.z], [h.x, l.y, h.z], [h.x, h.y, h.z], [l.x, h.y, h.z]], instance);
    quad(mesh, [[h.x, l.y, l.z], [l.x, l.y, l.z], [l.x, h.y, l.z], [h.x, h.y, l.z]], instance);
    quad(mesh, [[l.x, l.y, l.z], [l.x, l.y, h.z], [l.x, h.y, h.z], [l.x, h.y, l.z]], instance);
    quad(mesh, [[h.x, l.y, h.z], [h.x, l.y, l.z], [h.x, h.y, l.z], [h.x, h.y, h.z]], instance);
}

fn bounds((x, z): (f32, f32)) -> Aabb {
    Aabb::new(Point3::new(x - 0.25, 0.0, z - 0.25), Point3::new(x + 0.25, 1.0, z + 0.25))
}

fn prepare() -> Arc<SceneAssets> {
    let mut mesh = Mesh::default();
    let f = HALF_FLOOR_M;
    quad(&mut mesh, [[-f, 0.0, f], [f, 0.0, f], [f, 0.0, -f], [-f, 0.0, -f]], InstanceId::NONE);
    // A lid, so that the floor is not mistaken for a roof.
    quad(&mut mesh, [[-f, 3.0, -f], [f, 3.0, -f], [f, 3.0, f], [-f, 3.0, f]], InstanceId::NONE);
    let objects = PLACES.iter().chain([&DISTRACTOR]).enumerate().map(|(index, &place)| {
        let id = InstanceId(index as u32 + 1);
        cube(&mut mesh, &bounds(place), id);
        let attributes = Attributes::default();
        Object {
            id,
            category: format!("box{}", index % PLACES.len()),
            bounds: bounds(place),
            region: None,
            attributes,
        }
    });
    let objects = objects.collect();
    let material = Material {
        name: "plaster".to_owned(),
        base_color: [200, 200, 200, 255],
        texture: None,
        alpha_cutoff: None,
    };
    let scene = Scene {
        name: "floor".to_owned(),
        mesh,
        materials: vec![material],
        textures: vec![],
        regions: vec![],
        objects,
        lighting: Lighting::Painted,
    };
    Arc::new(SceneAssets::prepare(scene, &Body::default()).expect("one can walk on it"))
}

static ASSETS: LazyLock<Arc<SceneAssets>> = LazyLock::new(prepare);

fn target(index: usize) -> Target {
    let (x, z) = PLACES[index];
    let toward_start = Point3::new(x * 0.75, 0.0, z * 0.75);
    Target {
        instance: index as u32 + 1,
        category: format!("box{index}"),
        modality: Modality::Category,
        bounds: bounds(PLACES[index]),
        source: bounds(PLACES[index]).center(),
        floor_y_m: 0.0,
        region: vec![toward_start],
        viewpoints: vec![Pose::new(toward_start, 0.0)],
        start_distance_m: 3.75,
    }
}

/// Truth with the first three objects as targets.
fn truth(order: Order) -> EpisodeTruth {
    EpisodeTruth {
        episode: "floor-0000".to_owned(),
        scene: "floor".to_owned(),
        seed: 9,
        start: Pose::new(Point3::origin(), 0.0),
        order,
        targets: (0..3).map(target).collect(),
        distractor_sources: Vec::new(),
        reference_m: 12.0,
        reference_path: vec![],
    }
}

/// Mission for the same episode.
fn mission(order: Order) -> Mission {
    Mission { order, goals: (0..3).map(|index| GoalCue::Category(format!("box{index}"))).collect() }
}

fn try_play(
    mission: Mission,
    truth: EpisodeTruth,
    rules: Rules,
    sensors: Sensors,
) -> Result<Referee, RefereeError> {
    Referee::new(ASSETS.clone(), mission, truth, rules, sensors, &Audio::default())
}

fn episode(order: Order, rules: Rules, sensors: Sensors) -> Referee {
    try_play(mission(order), truth(order), rules, sensors).expect("a legal episode")
}

fn blind() -> Sensors {
    Sensors { rgb: false, depth: false, audio: false, ..Sensors::all(64, 64) }
}

fn quick(order: Order) -> Referee {
    episode(order, Rules::paper(), blind())
}

fn go(referee: &mut Referee, actions: &[(Action, usize)]) -> StepOutcome {
    let each = actions.iter().flat_map(|&(action, times)| std::iter::repeat_n(action, times));
    each.map(|action| referee.step(action).expect("still running")).last().expect("at least one action")
}

fn record(referee: Referee) -> Record {
    referee.into_record().1
}

/// From the start to the success region of the target ahead, and back.
const AHEAD: [(Action, usize); 1] = [(MoveForward, 12)];
const BACK: [(Action, usize); 2] = [(TurnLeft, 6), (MoveForward, 12)];

const WALK: [Action; 12] = [
    MoveForward,
    TurnLeft,
    MoveForward,
    MoveForward,
    Submit,
    TurnLeft,
    TurnLeft,
    MoveForward,
    MoveForward,
    MoveForward,
    TurnLeft,
    Stop,
];

fn noisy() -> Referee {
    episode(Order::Unordered, Rules::noisy(), Sensors::all(64, 64))
}

fn step(referee: &mut Referee, action: Action) -> (Action, u64) {
    referee.step(action).expect("still running");
    (action, referee.state_hash())
}

#[test]
fn replay_continues_bit_by_bit_from_any_step() {
    let mut whole = noisy();
    whole.start();
    let outcomes: Vec<_> = WALK.iter().map(|&action| whole.step(action).expect("still running")).collect();
    let mut taken = Vec::new();
    let mut tape = noisy();
    for cut in 1..WALK.len() {
        taken.push(step(&mut tape, WALK[cut - 1]));
        let mut resumed = noisy();
        assert_eq!(resumed.replay(&taken).expect("the same world").as_ref(), Some(&outcomes[cut - 1]));
        for (&action, outcome) in WALK.iter().zip(&outcomes).skip(cut) {
            assert_eq!(&resumed.step(action).expect("still running"), outcome, "cut after {cut}");
        }
    }
    assert_eq!(whole.end(), outcomes.last().expect("twelve").end);
}

#[test]
fn replayed_episode_has_equal_facts() {
    let mut whole = noisy();
    let taken: Vec<_> = WALK.iter().map(|&action| step(&mut whole, action)).collect();
    let mut resumed = noisy();
    resumed.replay(&taken).expect("the same world");
    assert_eq!(resumed.into_record(), whole.into_record());
}

#[test]
fn divergence_names_the_step() {
    let mut referee = quick(Order::Ordered);
    let mut taken: Vec<_> = WALK[..4].iter().map(|&action| step(&mut referee, action)).collect();
    taken[2].1 ^= 1;
    let error = quick(Order::Ordered).replay(&taken).expect_err("a state that never was");
    assert!(matches!(error, RefereeError::Diverged { step: 3, .. }), "{error}");
    assert!(quick(Order::Ordered).replay(&[]).expect("nothing to do").is_none());
}

#[test]
fn actions_after_the_end_are_no_episode() {
    let mut referee = quick(Order::Ordered);
    let end = step(&mut referee, Stop);
    let error = quick(Order::Ordered).replay(&[end, end]).expect_err("Stop is the end");
    assert!(matches!(error, RefereeError::Over { steps: 1, .. }), "{error}");
}
