//! Simulator queries: distances and paths by Habitat's rules, pictures and sounds.

mod bench;
mod camera;
mod hall;
mod listen;
mod render;
mod rir;
mod walk;

use crate::output::say;
use avln_arena::{Failure, FailureKind};
use avln_formats::open;
use avln_geom::Point3;
use avln_navmesh::{Body, NavMesh, NavMeshSettings};
use clap::{Args, Subcommand};
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};
use walk::{MotionArgs, StartPose};

/// Commands on a simulated scene. Positions are in metres in Habitat's frame: Y up, heading 0 is -Z, left turns are positive.
#[derive(Debug, Subcommand)]
pub enum SimCommand {
    /// Print geodesic distances between pairs of points
    Geodesic {
        /// Navmesh
        #[command(flatten)]
        ground: GroundArgs,
        /// JSON array of pairs [[x,y,z],[x,y,z]] in metres
        /// Reason, for the audit list
        #[arg(long, value_name = "FILE.json")]
        pairs: PathBuf,
        /// Use the shortest of all paths; Habitat's path through one chain of polygons can be longer
        /// Reason, for the audit list
        #[arg(long)]
        exact: bool,
        /// Print a JSON array of metres; null if there is no path
        /// Reason, for the audit list
        #[arg(long)]
        json: bool,
    },
    /// Print the poses after a sequence of actions
    Walk {
        /// Navmesh
        #[command(flatten)]
        ground: GroundArgs,
        /// Start pose: x,y,z in metres and the heading in degrees
        /// Reason, for the audit list
        #[arg(long, value_name = "X,Y,Z,HEADING", allow_hyphen_values = true)]
        start: StartPose,
        /// JSON array of actions: MoveForward, TurnLeft, TurnRight or move_forward, turn_left, turn_right
        /// Reason, for the audit list
        #[arg(long, value_name = "FILE.json")]
        actions: PathBuf,
        /// Motion
        #[command(flatten)]
        motion: MotionArgs,
        /// Print {"poses": [[x,y,z,heading],...], "collided": [...]}, with one entry per action
        /// Reason, for the audit list
        #[arg(long)]
        json: bool,
    },
    /// Render pictures: colours, depth and instance ids
    #[command(arg(crate::args::data_option()))]
    Render(Box<render::RenderArgs>),
    /// Measure the frame rate of one core
    Bench(bench::BenchArgs),
    /// Compute and measure the impulse response from a source to a listener
    Rir(Box<rir::RirArgs>),
    /// Render the sound at the ears along a walk, step by step as in an episode
    Listen(Box<listen::ListenArgs>),
}

/// Runs a simulator query.
///
/// # Errors
/// If the scene, the navmesh or the input file cannot be used, or the output cannot be written.
pub fn run(data: &Path, command: SimCommand) -> Result<(), Failure> {
    match command {
        SimCommand::Geodesic { ground, pairs, exact, json } => geodesic(&ground, &pairs, exact, json),
        SimCommand::Walk { ground, start, actions, motion, json } => {
            walk::run(&ground, &start, &actions, &motion, json)
        }
        SimCommand::Render(args) => render::run(data, &args),
        SimCommand::Bench(args) => bench::run(&args),
        SimCommand::Rir(args) => rir::run(&args),
        SimCommand::Listen(args) => listen::run(&args),
    }
}

/// A navmesh, built from a scene with Habitat's settings or read from a Habitat file.
#[derive(Debug, Args)]
pub struct GroundArgs {
    /// Scene file or folder, in any supported layout
    #[arg(long, value_name = "PATH", required_unless_present = "navmesh")]
    scene: Option<PathBuf>,
    /// Habitat .navmesh file, instead of building one
    #[arg(long, value_name = "FILE.navmesh")]
    navmesh: Option<PathBuf>,
    /// Radius of the body, metres
    #[arg(long, value_name = "METRES", default_value_t = 0.1)]
    agent_radius: f32,
    /// Height of the body, metres
    #[arg(long, value_name = "METRES", default_value_t = 1.5)]
    agent_height: f32,
    /// Highest step, metres
    #[arg(long, value_name = "METRES", default_value_t = 0.2)]
    max_climb: f32,
    /// Steepest slope, degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 45.0)]
    max_slope: f32,
    /// Width of voxels, metres
    #[arg(long, value_name = "METRES", default_value_t = 0.05)]
    cell_size: f32,
    /// Height of voxels, metres
    #[arg(long, value_name = "METRES", default_value_t = 0.2)]
    cell_height: f32,
}

impl GroundArgs {
    /// Reads or builds the navmesh.
    fn mesh(&self) -> Result<NavMesh, Failure> {
        let failed = |error: &dyn std::fmt::Display| Failure::new(FailureKind::Scene, error);
        if let Some(file) = &self.navmesh {
            let named = |error: &dyn std::fmt::Display| failed(&format!("{}: {error}", file.display()));
            let bytes = std::fs::read(file).map_err(|error| named(&error))?;
            return NavMesh::from_detour(&bytes).map_err(|error| named(&error));
        }
        let path = self.scene.clone().unwrap_or_default();
        let scene = open::open(&path).map_err(|error| failed(&error))?;
        NavMesh::build_with(&scene, &self.settings()).map_err(|error| failed(&error))
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

/// Reads a JSON file; `what` describes the expected contents.
fn read<T: DeserializeOwned>(file: &Path, what: &str) -> Result<T, Failure> {
    let bytes = std::fs::read(file).map_err(|error| unusable(file, error, "check the path"))?;
    serde_json::from_slice(&bytes)
        .map_err(|error| unusable(file, error, format!("the file must contain {what}")))
}

fn unusable(file: &Path, why: impl std::fmt::Display, hint: impl std::fmt::Display) -> Failure {
    Failure::new(FailureKind::Data, format!("cannot use {}: {why}", file.display())).hinted(hint)
}

fn text(value: &impl serde::Serialize) -> Result<String, Failure> {
    serde_json::to_string(value).map_err(|error| Failure::new(FailureKind::Internal, error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_that_hold_something_else_are_refused_with_a_hint() {
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
}
