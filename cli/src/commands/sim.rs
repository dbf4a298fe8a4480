//! Simulator queries: distances, paths and walks by Habitat's rules, pictures and sounds.

use crate::output::say;
use avln_arena::Failure;
use avln_formats::open;
use avln_geom::{Point3, Vector3, angle};
use avln_navmesh::{Body, NavMesh, NavMeshSettings};
use clap::{Args, Subcommand};
use serde::{Serialize, de::DeserializeOwned};
use std::{
    fmt::Display,
    path::{Path, PathBuf},
    str::FromStr,
};

mod bench;
mod render;
mod sound;
mod surroundings;

#[derive(Debug, Subcommand)]
pub(crate) enum SimCommand {
    /// Print geodesic distances between point pairs
    Geodesic {
        #[command(flatten)]
        ground: GroundArgs,
        /// JSON array with pairs [[x,y,z],[x,y,z]] in metres
        #[arg(long, value_name = "FILE.json")]
        pairs: PathBuf,
        /// Use the shortest path; Habitat's path through a fixed polygon chain can be longer
        #[arg(long)]
        exact: bool,
        /// Print a JSON array in metres; null without a path
        #[arg(long)]
        json: bool,
    },
    /// Print the poses after each action in a sequence
    Walk {
        #[command(flatten)]
        ground: GroundArgs,
        /// Start pose: x,y,z in metres and the heading in degrees
        #[arg(long, value_name = "X,Y,Z,HEADING", allow_hyphen_values = true)]
        start: StartPose,
        /// JSON array with actions: MoveForward, TurnLeft, TurnRight or move_forward, turn_left, turn_right
        #[arg(long, value_name = "FILE.json")]
        actions: PathBuf,
        #[command(flatten)]
        motion: MotionArgs,
        /// Print {"poses": [[x,y,z,heading],...], "collided": [...]}, with an entry per action
        #[arg(long)]
        json: bool,
    },
    /// Render pictures: colours, depth and instance ids
    #[command(arg(crate::data_option()))]
    Render(Box<render::RenderArgs>),
    /// Measure the frame rate on a single core
    Bench(bench::BenchArgs),
    /// Compute and measure the impulse response from a source to a listener
    Rir(Box<sound::RirArgs>),
    /// Render the sound at the ears on a walk, step by step as in an episode
    Listen(Box<sound::ListenArgs>),
}

pub(crate) fn run(data: &Path, command: SimCommand) -> Result<(), Failure> {
    match command {
        SimCommand::Geodesic { ground, pairs, exact, json } => geodesic(&ground, &pairs, exact, json),
        SimCommand::Walk { ground, start, actions, motion, json } => {
            run_walk(&ground, &start, &actions, &motion, json)
        }
        SimCommand::Render(args) => render::run(data, &args),
        SimCommand::Bench(args) => bench::run(&args),
        SimCommand::Rir(args) => sound::run_rir(&args),
        SimCommand::Listen(args) => sound::run_listen(&args),
    }
}

/// A navmesh, built from a scene with Habitat's settings or read from a Habitat file.
#[derive(Debug, Args)]
pub(crate) struct GroundArgs {
    /// Scene file or folder, in any supported layout
    #[arg(long, value_name = "PATH", required_unless_present = "navmesh")]
    scene: Option<PathBuf>,
    /// Habitat .navmesh file, instead of building one
    #[arg(long, value_name = "FILE.navmesh")]
    navmesh: Option<PathBuf>,
    /// Body radius, metres
    #[arg(long, value_name = "METRES", default_value_t = 0.1)]
    agent_radius: f32,
    /// Body height, metres
    #[arg(long, value_name = "METRES", default_value_t = 1.5)]
    agent_height: f32,
    /// Highest step, metres
    #[arg(long, value_name = "METRES", default_value_t = 0.2)]
    max_climb: f32,
    /// Steepest slope, degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 45.0)]
    max_slope: f32,
    /// Voxel width, metres
    #[arg(long, value_name = "METRES", default_value_t = 0.05)]
    cell_size: f32,
    /// Voxel height, metres
    #[arg(long, value_name = "METRES", default_value_t = 0.2)]
    cell_height: f32,
}

impl GroundArgs {
    fn mesh(&self) -> Result<NavMesh, Failure> {
        if let Some(file) = &self.navmesh {
            let named = |error: &dyn Display| Failure::scene(format!("{}: {error}", file.display()));
            let bytes = std::fs::read(file).map_err(|error| named(&error))?;
            return NavMesh::from_detour(&bytes).map_err(|error| named(&error));
        }
        let path = self.scene.clone().unwrap_or_default();
        let scene = open::open(&path).map_err(Failure::scene)?;
        NavMesh::build_with(&scene, &self.settings()).map_err(Failure::scene)
    }

    fn settings(&self) -> NavMeshSettings {
        let body = Body {
            radius_m: self.agent_radius,
            height_m: self.agent_height,
            climb_m: self.max_climb,
            slope_deg: self.max_slope,
        };
        NavMeshSettings { body, cell_m: self.cell_size, level_m: self.cell_height, ..Default::default() }
    }
}

fn geodesic(ground: &GroundArgs, file: &Path, exact: bool, json: bool) -> Result<(), Failure> {
    let pairs: Vec<[[f32; 3]; 2]> = read(file, "an array of [[x,y,z],[x,y,z]]")?;
    if let Some(index) = pairs.iter().position(|pair| !pair.as_flattened().iter().all(|v| v.is_finite())) {
        return Err(unusable(file, format!("pair {index} is not finite"), "write metres"));
    }
    let mesh = ground.mesh()?;
    let distance_m = if exact { NavMesh::shortest_m } else { NavMesh::geodesic_m };
    let metres = pairs.iter().map(|[a, b]| distance_m(&mesh, &Point3::from(*a), &Point3::from(*b)));
    let metres: Vec<_> = metres.collect();
    if json {
        say!("{}", text(&metres)?);
        return Ok(());
    }
    for distance_m in metres {
        match distance_m {
            Some(distance_m) => say!("{distance_m:.4}"),
            None => say!("no way"),
        }
    }
    Ok(())
}

fn numbers<T: FromStr<Err: Display>>(words: &str, separators: &[char]) -> Result<Vec<T>, String> {
    let parse = |word: &str| word.trim().parse().map_err(|error| format!("'{word}': {error}"));
    words.split(separators).map(parse).collect()
}

/// Reads a JSON file; `what` describes the expected contents.
fn read<T: DeserializeOwned>(file: &Path, what: &str) -> Result<T, Failure> {
    let bytes = std::fs::read(file).map_err(|error| unusable(file, error, "check the path"))?;
    serde_json::from_slice(&bytes)
        .map_err(|error| unusable(file, error, format!("the file must contain {what}")))
}

fn unusable(file: &Path, why: impl Display, hint: impl Display) -> Failure {
    Failure::data(format!("cannot use {}: {why}", file.display())).hinted(hint)
}

fn text(value: &impl serde::Serialize) -> Result<String, Failure> {
    serde_json::to_string(value).map_err(Failure::internal)
}

/// A step that is shorter than requested by more than this is a collision, square metres (habitat-sim, `object_controls.py`).
const COLLIDED_M2: f32 = 1e-5;

#[derive(Debug, Args)]
pub(crate) struct MotionArgs {
    /// Forward step length, metres
    #[arg(long, value_name = "METRES", default_value_t = 0.25)]
    forward: f32,
    /// Turn angle, degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 30.0)]
    turn: f64,
    /// Stop at walls instead of sliding
    #[arg(long)]
    no_sliding: bool,
}

#[derive(Clone, Debug)]
pub(crate) struct StartPose {
    pub(super) position: Point3<f32>,
    pub(super) heading_deg: f64,
}

impl FromStr for StartPose {
    type Err = String;
    fn from_str(words: &str) -> Result<Self, String> {
        let values: Vec<f64> = numbers(words, &[','])?;
        match *values.as_slice() {
            [x, y, z, heading_deg] if values.iter().all(|value| value.abs() < 1e6) => {
                Ok(Self { position: Point3::new(x as f32, y as f32, z as f32), heading_deg })
            }
            _ => Err("four numbers are needed: x,y,z in metres and the heading in degrees".to_owned()),
        }
    }
}

#[derive(Debug, Default, Serialize)]
struct WalkResult {
    /// After each action: x, y, z in metres, heading in degrees from -180 (excluded) to 180.
    poses: Vec<(f32, f32, f32, f64)>,
    /// Collision flag per action.
    collided: Vec<bool>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum BodyAction {
    Forward,
    Left,
    Right,
    Stay,
}

impl BodyAction {
    fn from_name(name: &str) -> Option<Self> {
        match name {
            "MoveForward" | "move_forward" => Some(Self::Forward),
            "TurnLeft" | "turn_left" => Some(Self::Left),
            "TurnRight" | "turn_right" => Some(Self::Right),
            "Submit" | "submit" | "Stop" | "stop" => Some(Self::Stay),
            _ => None,
        }
    }
}

fn run_walk(
    ground: &GroundArgs,
    start: &StartPose,
    file: &Path,
    motion: &MotionArgs,
    json: bool,
) -> Result<(), Failure> {
    let names: Vec<String> = read(file, "an array of action names")?;
    let action = |(index, name): (usize, &String)| {
        BodyAction::from_name(name).ok_or_else(|| {
            let hint = "use MoveForward, TurnLeft, TurnRight, Submit or Stop";
            unusable(file, format!("action {index} is '{name}'"), hint)
        })
    };
    let actions: Vec<_> = names.iter().enumerate().map(action).collect::<Result<_, _>>()?;
    let walked = walk(&ground.mesh()?, start, &actions, motion);
    if json {
        say!("{}", text(&walked)?);
        return Ok(());
    }
    for ((x, y, z, heading_deg), collided) in walked.poses.iter().zip(&walked.collided) {
        say!("{x:9.4} {y:9.4} {z:9.4} {heading_deg:7.1}{}", if *collided { "  collided" } else { "" });
    }
    Ok(())
}

fn walk(mesh: &NavMesh, start: &StartPose, actions: &[BodyAction], motion: &MotionArgs) -> WalkResult {
    let (mut at, mut heading_deg) = (start.position, start.heading_deg);
    let mut walked = WalkResult::default();
    for action in actions {
        let mut collided = false;
        match action {
            BodyAction::Forward => (at, collided) = step(mesh, &at, heading_deg, motion),
            BodyAction::Left => heading_deg += motion.turn,
            BodyAction::Right => heading_deg -= motion.turn,
            BodyAction::Stay => {}
        }
        heading_deg = wrapped(heading_deg);
        walked.poses.push((at.x, at.y, at.z, heading_deg));
        walked.collided.push(collided);
    }
    walked
}

/// Steps forward; returns the new position, and true after a collision.
fn step(mesh: &NavMesh, at: &Point3<f32>, heading_deg: f64, motion: &MotionArgs) -> (Point3<f32>, bool) {
    let (sin, cos) = angle::sin_cos(heading_deg.to_radians() as f32);
    let asked = Vector3::new(-sin, 0.0, -cos) * motion.forward;
    let end = mesh.try_step(at, &(at + asked), !motion.no_sliding);
    let collided = (end - at).norm_squared() + COLLIDED_M2 < asked.norm_squared();
    (end, collided)
}

/// Wraps a heading to (-180, 180] degrees.
fn wrapped(heading_deg: f64) -> f64 {
    let turned = heading_deg.rem_euclid(360.0);
    if turned > 180.0 { turned - 360.0 } else { turned }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_arena::FailureKind;

    #[test]
    fn foreign_file_error_has_hint() {
        let folder = tempfile::tempdir().expect("a folder for temporary files");
        let file = folder.path().join("pairs.json");
        for text in ["", "{}", "[[1,2,3]]", "[[[0,0,0],[0,0]]]", "[[[0,0,0],[0,0,1e999]]]"] {
            std::fs::write(&file, text).expect("a file");
            let refused = read::<Vec<[[f32; 3]; 2]>>(&file, "pairs").err();
            assert!(refused.is_some_and(|failure| failure.kind() == FailureKind::Data), "{text}");
        }
        std::fs::write(&file, "[[[0, 1, 2.5], [3, 4, 5]]]").expect("a file");
        let pairs: Vec<[[f32; 3]; 2]> = read(&file, "pairs").expect("pairs");
        assert_eq!(pairs, [[[0.0, 1.0, 2.5], [3.0, 4.0, 5.0]]]);
        assert!(read::<Vec<String>>(&folder.path().join("none.json"), "names").is_err());
    }

    #[test]
    fn no_way_is_null() {
        assert_eq!(text(&[Some(1.5), None]).expect("text"), "[1.5,null]");
    }

    #[test]
    fn starts_are_four_numbers() {
        let start: StartPose = "-1.5, 0.2,3,-90".parse().expect("a start");
        assert_eq!((start.position, start.heading_deg), (Point3::new(-1.5, 0.2, 3.0), -90.0));
        for bad in ["1,2,3", "1,2,3,4,5", "1,2,three,4", "1,2,NaN,4", "1,2,1e9,4", ""] {
            assert!(bad.parse::<StartPose>().is_err(), "{bad}");
        }
    }

    #[test]
    fn walk_slides_along_walls_and_reports_it() {
        let scene = avln_houses::house("house-1", 1, &Default::default());
        let mesh = NavMesh::build_with(&scene, &Default::default()).expect("a house to walk in");
        let on_floor = mesh.sample(&mut avln_geom::Rng::new(2), mesh.largest_island());
        let start = StartPose { position: on_floor.position(), heading_deg: 170.0 };
        let motion = MotionArgs { forward: 0.25, turn: 30.0, no_sliding: false };
        // Straight ahead beyond the house's length: the last steps are blocked completely.
        let actions =
            [vec![BodyAction::Left], vec![BodyAction::Forward; 200], vec![BodyAction::Stay; 2]].concat();
        let walked = walk(&mesh, &start, &actions, &motion);
        assert_eq!((walked.poses.len(), walked.collided.len()), (203, 203));
        assert_eq!((walked.poses[0].3, walked.collided[0]), (-160.0, false));
        assert!(walked.collided[200] && !walked.collided[202]);
        let (before, last) = (walked.poses[190], walked.poses[202]);
        assert!((before.0 - last.0).hypot(before.2 - last.2) < 1e-3, "{before:?} {last:?}");
        for pair in walked.poses.windows(2) {
            let moved = (pair[1].0 - pair[0].0).hypot(pair[1].2 - pair[0].2);
            assert!(moved < 0.51, "{pair:?}");
        }
    }

    #[test]
    fn headings_stay_within_one_turn() {
        assert_eq!(
            (wrapped(190.0), wrapped(-180.0), wrapped(-30.0), wrapped(720.0)),
            (-170.0, 180.0, -30.0, 0.0)
        );
    }

    #[test]
    fn actions_have_two_spellings() {
        assert_eq!(BodyAction::from_name("MoveForward"), BodyAction::from_name("move_forward"));
        assert_eq!(BodyAction::from_name("turn_left"), Some(BodyAction::Left));
        assert_eq!(BodyAction::from_name("fly"), None);
    }
}
