//! Numbers that files may not hold: JSON has no infinity, but a number too large for its type becomes one.

use crate::{cue::View, mission::ReferenceTour};
use avln_geom::{Point3, Pose};
use avln_truth::Target;

/// The first field that is not finite, by name.
pub(super) type Bad = Option<&'static str>;

pub(super) fn point(point: &Point3<f32>, what: &'static str) -> Bad {
    (!point.iter().all(|value| value.is_finite())).then_some(what)
}

pub(super) fn pose(pose: &Pose, what: &'static str) -> Bad {
    point(&pose.position, what).or((!pose.heading_rad.is_finite()).then_some(what))
}

pub(super) fn number(value: f64, what: &'static str) -> Bad {
    (!value.is_finite()).then_some(what)
}

pub(super) fn target(target: &Target) -> Bad {
    let bounds = &target.bounds;
    point(&bounds.min, "target.bounds")
        .or_else(|| point(&bounds.max, "target.bounds"))
        .or_else(|| point(&target.source, "target.source"))
        .or_else(|| number(f64::from(target.floor_y_m), "target.floor_y_m"))
        .or_else(|| target.region.iter().find_map(|place| point(place, "target.region")))
        .or_else(|| target.viewpoints.iter().find_map(|place| pose(place, "target.viewpoints")))
}

pub(super) fn view(view: &View) -> Bad {
    pose(&view.pose, "goals.view").or_else(|| number(f64::from(view.hfov_rad), "goals.view"))
}

pub(super) fn tour(tour: &ReferenceTour, what: &'static str) -> Bad {
    number(tour.length_m, what).or_else(|| tour.path.iter().find_map(|corner| point(corner, what)))
}
