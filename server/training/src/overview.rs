//! Parts of a picture of an episode for people: the agent's view and a map with path, sound and targets.

use crate::top_down::{MapFrame, StoreyMaps};
use avln_referee::Referee;
use avln_truth::EpisodeTruth;
use avln_world::{CameraView, Point3, Pose};
use serde::Serialize;

/// Cell side of the map, metres.
const CELL_M: f32 = 0.05;
/// Cells per side.
const SIDE: usize = 1024;

/// Parts of a picture. Places are columns and rows of the map, in cells from the top-left corner; the map shows the storey of the
/// agent, with -z of the scene at the top.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Overview {
    /// The agent's view without noise: `side × side × 3` bytes, sRGB.
    #[serde(skip)]
    pub view: Vec<u8>,
    /// Map, `map_side × map_side`: 0 unknown, 1 walkable, 2 obstacle.
    #[serde(skip)]
    pub map: Vec<u8>,
    /// Cells per side of the map.
    pub map_side: usize,
    /// Cell side, metres.
    pub cell_m: f32,
    /// Walked lines on this storey.
    pub paths: Vec<Vec<[f32; 2]>>,
    /// Agent.
    pub agent: [f32; 2],
    /// Agent's heading, radians, 0 to the top, left positive.
    pub heading_rad: f32,
    /// Targets in goal order.
    pub targets: Vec<TargetMark>,
    /// Sounding source, if it is on this storey.
    pub sound: Option<[f32; 2]>,
}

/// A target in a picture.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TargetMark {
    /// Centre.
    pub place: [f32; 2],
    /// True until it is found.
    pub is_open: bool,
    /// True if it is on the agent's storey.
    pub is_here: bool,
}

/// Returns the frame of the map: the scene's axes around the start.
pub(crate) fn frame(truth: &EpisodeTruth) -> MapFrame {
    MapFrame {
        origin: Pose::new(truth.start.position, 0.0),
        cell_m: CELL_M,
        side: SIDE,
        has_solid_walls: false,
    }
}

impl Overview {
    pub(crate) fn new(referee: &Referee, truth: &EpisodeTruth, maps: &mut StoreyMaps, side: u32) -> Self {
        let (world, frame) = (referee.world(), maps.frame);
        let pose = world.pose();
        let view = CameraView { width: side, height: side, hfov_rad: referee.sensors().hfov_rad };
        let storey = maps.storey(pose.position.y);
        let is_here = |y_m: f32| maps.storey(y_m) == storey;
        let is_open = referee.is_open();
        let mark = |(target, &is_open): (&avln_truth::Target, &bool)| TargetMark {
            place: frame.cells(&target.bounds.center()),
            is_open,
            is_here: is_here(target.floor_y_m),
        };
        // Sources are at most a room's height above their floor.
        let sound = referee.sounding_position().filter(|place| is_here(place.y - 1.0));
        Self {
            view: world.assets().render(&world.camera(view)).rgb,
            map_side: SIDE,
            cell_m: CELL_M,
            paths: paths(referee, truth, &frame, is_here),
            agent: frame.cells(&pose.position),
            heading_rad: pose.heading_rad,
            targets: truth.targets.iter().zip(&is_open).map(mark).collect(),
            sound: sound.map(|place| frame.cells(&place)),
            map: maps.map(world.assets(), storey).to_vec(),
        }
    }
}

/// Returns the parts of the walked path on a storey.
fn paths(
    referee: &Referee,
    truth: &EpisodeTruth,
    frame: &MapFrame,
    is_here: impl Fn(f32) -> bool,
) -> Vec<Vec<[f32; 2]>> {
    let steps = referee.facts().iter().map(|step| step.pose.position);
    let places: Vec<Point3<f32>> = std::iter::once(truth.start.position).chain(steps).collect();
    let parts = places.chunk_by(|a, b| is_here(a.y) == is_here(b.y));
    let here = parts.filter(|part| part.first().is_some_and(|place| is_here(place.y)));
    here.map(|part| part.iter().map(|place| frame.cells(place)).collect()).collect()
}
