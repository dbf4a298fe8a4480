use super::{GroundArgs, read, text, unusable};
use crate::output::say;
use avln_arena::Failure;
use avln_geom::{Point3, Vector3, angle};
use avln_navmesh::NavMesh;
use clap::Args;
use serde::Serialize;
use std::path::Path;
use std::str::FromStr;

/// A step that is shorter than requested by more than this is a collision, square metres (habitat-sim, `object_controls.py`).
const COLLIDED_M2: f32 = 1e-5;

/// Arguments of the body's motion.
#[derive(Debug, Args)]
pub struct MotionArgs {
    /// Length of a step forward, metres
    #[arg(long, value_name = "METRES", default_value_t = 0.25)]
    forward: f32,
    /// Angle of a turn, degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 30.0)]
    turn: f64,
    /// Stop at walls instead of sliding along them
    #[arg(long)]
    no_sliding: bool,
}

/// Start pose of a walk.
#[derive(Clone, Debug)]
pub struct StartPose {
    pub(super) position: Point3<f32>,
    pub(super) heading_deg: f64,
}

impl FromStr for StartPose {
    type Err = String;

    fn from_str(words: &str) -> Result<Self, String> {
        let values: Vec<f64> = words
            .split(',')
            .map(|word| word.trim().parse().map_err(|error| format!("'{word}': {error}")))
            .collect::<Result<_, _>>()?;
        match *values.as_slice() {
            [x, y, z, heading_deg] if values.iter().all(|value| value.abs() < 1e6) => {
                Ok(Self { position: Point3::new(x as f32, y as f32, z as f32), heading_deg })
            }
            _ => Err("four numbers are needed: x,y,z in metres and the heading in degrees".to_owned()),
        }
    }
}

/// The result of a walk.
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

pub(super) fn run(
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

/// A step forward, and whether it collided.
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

    #[test]
    fn starts_are_four_numbers() {
        let start: StartPose = "-1.5, 0.2,3,-90".parse().expect("a start");
        assert_eq!((start.position, start.heading_deg), (Point3::new(-1.5, 0.2, 3.0), -90.0));
        for bad in ["1,2,3", "1,2,3,4,5", "1,2,three,4", "1,2,NaN,4", "1,2,1e9,4", ""] {
            assert!(bad.parse::<StartPose>().is_err(), "{bad}");
        }
    }

    #[test]
    fn a_walk_slides_along_walls_and_says_so() {
        let scene = avln_houses::house("house-1", 1, &Default::default());
        let mesh = NavMesh::build_with(&scene, &Default::default()).expect("a house to walk in");
        let on_floor = mesh.sample(&mut avln_geom::Rng::new(2), mesh.largest_island());
        let start = StartPose { position: on_floor.position(), heading_deg: 170.0 };
        let motion = MotionArgs { forward: 0.25, turn: 30.0, no_sliding: false };
        // Straight on for longer than the house is: in the end nothing is left of a step.
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
