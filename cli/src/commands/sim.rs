//! Asks the simulator of a scene: how far it is to walk and where actions lead, by Habitat's rules, what a camera sees and
//! what ears hear.

mod bench;
mod ground;
mod hall;
mod listen;
mod listener;
mod render;
mod rir;
mod shot;
mod walk;
mod wav;

use crate::output::say;
use avln_arena::{Failure, FailureKind};
use avln_geom::Point3;
use avln_navmesh::NavMesh;
use clap::Subcommand;
use ground::Ground;
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};
use walk::{Motion, Start};

/// Commands about walking, seeing and hearing in a scene. Positions are in metres in Habitat's frame: Y up, heading 0 looks along
/// -Z, left turns are positive.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Print how far it is to walk between pairs of points
    Geodesic {
        /// Where to walk
        #[command(flatten)]
        ground: Ground,
        /// A JSON array of pairs [[x,y,z],[x,y,z]], metres
        #[arg(long, value_name = "FILE.json")]
        pairs: PathBuf,
        /// Measure the shortest of all paths; Habitat's own, pulled through one chain of polygons, can be longer
        #[arg(long)]
        exact: bool,
        /// Print a JSON array of metres, null where there is no way
        #[arg(long)]
        json: bool,
    },
    /// Print where a sequence of actions leads
    Walk {
        /// Where to walk
        #[command(flatten)]
        ground: Ground,
        /// Where to begin: x,y,z in metres and the heading in degrees
        #[arg(long, value_name = "X,Y,Z,HEADING", allow_hyphen_values = true)]
        start: Start,
        /// A JSON array of actions: MoveForward, TurnLeft, TurnRight or move_forward, turn_left, turn_right
        #[arg(long, value_name = "FILE.json")]
        actions: PathBuf,
        /// How the body moves
        #[command(flatten)]
        motion: Motion,
        /// Print {"poses": [[x,y,z,heading],...], "collided": [...]}: one of each for every action, after it
        #[arg(long)]
        json: bool,
    },
    /// Take pictures: colours, depth and the numbers of instances
    #[command(arg(crate::args::data_option()))]
    Render(Box<render::Options>),
    /// Measure how many pictures a second one core takes
    Bench(bench::Options),
    /// Compute the impulse response from a source to a listener, and measure it
    Rir(Box<rir::Options>),
    /// Render what is heard on a walk past sounding sources, step by step as in an episode
    Listen(Box<listen::Options>),
}

/// Carries out a command about walking, seeing or hearing.
///
/// # Errors
/// When the scene, the navmesh or the file of points, actions or poses cannot be used, or a picture or a sound
/// cannot be written.
pub fn run(data: &Path, command: Command) -> Result<(), Failure> {
    match command {
        Command::Geodesic { ground, pairs, exact, json } => geodesic(&ground, &pairs, exact, json),
        Command::Walk { ground, start, actions, motion, json } => {
            walk::run(&ground, &start, &actions, &motion, json)
        }
        Command::Render(options) => render::run(data, &options),
        Command::Bench(options) => bench::run(&options),
        Command::Rir(options) => rir::run(&options),
        Command::Listen(options) => listen::run(&options),
    }
}

fn geodesic(ground: &Ground, file: &Path, exact: bool, json: bool) -> Result<(), Failure> {
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

/// Reads a JSON file that holds `what`.
fn read<T: DeserializeOwned>(file: &Path, what: &str) -> Result<T, Failure> {
    let bytes = std::fs::read(file).map_err(|error| unusable(file, error, "check the path"))?;
    serde_json::from_slice(&bytes).map_err(|error| unusable(file, error, format!("the file holds {what}")))
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
