//! The reference tours of an imported mission.

use crate::{
    mission::{GoalSpec, ReferenceTour},
    reference::{Atlas, Tour, ordered, reference_steps, unordered},
};
use avln_episode::Rules;
use avln_geom::Pose;
use avln_world::{NavPoint, SceneAssets};

/// The reference tours, ordered and unordered; `None` where no walk leads through all goals.
pub(super) fn tours(
    assets: &SceneAssets,
    rules: &Rules,
    pose: &Pose,
    start: NavPoint,
    goals: &[GoalSpec],
) -> Option<[ReferenceTour; 2]> {
    let snap = |place| assets.navmesh.snap(place, 0.1);
    let regions: Vec<Vec<NavPoint>> =
        goals.iter().map(|goal| goal.target.region.iter().filter_map(snap).collect()).collect();
    let atlas = Atlas::new(&assets.navmesh, &regions, 0.0);
    let departure = atlas.departure(&start);
    let all: Vec<usize> = (0..goals.len()).collect();
    let reference = |tour: Tour| {
        let steps = reference_steps(rules, pose, &tour.path, tour.length_m, goals.len());
        ReferenceTour { length_m: tour.length_m, steps, path: tour.path }
    };
    Some([
        ordered(&atlas, &departure, &all).map(reference)?,
        unordered(&atlas, &departure, &all).map(reference)?,
    ])
}
