//! What a mission needs beside its goals.

use crate::{
    cue::CueSpec,
    mission::{GoalSpec, ReferenceTour},
    reference::Tour,
};
use avln_episode::Rules;
use avln_geom::Pose;
use avln_scene::Scene;
use avln_truth::Target;
use avln_world::{NavPoint, SceneAssets};

/// A goal of ours.
pub(super) fn goal(target: Target, cue: CueSpec, _scene: &Scene) -> GoalSpec {
    GoalSpec { target, cue }
}

/// The reference tours, ordered and unordered; `None` where no walk leads through all goals.
pub(super) fn tours(
    assets: &SceneAssets,
    _rules: &Rules,
    _pose: &Pose,
    start: NavPoint,
    goals: &[GoalSpec],
) -> Option<[ReferenceTour; 2]> {
    let snap = |place| assets.navmesh.snap(place, 0.1);
    let regions: Vec<Vec<NavPoint>> =
        goals.iter().map(|goal| goal.target.region.iter().filter_map(snap).collect()).collect();
    let tour = Tour::new(&assets.navmesh, start, &regions);
    let reference = |(length_m, path)| ReferenceTour { length_m, path };
    Some([tour.ordered().map(reference)?, tour.unordered().map(reference)?])
}
